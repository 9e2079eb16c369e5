"""Studies train and play their variants once, and compare them seed by seed."""

from pathlib import Path

import numpy as np
import pytest

from leaderboard.family import FamilyPlay
from leaderboard.play import EPISODE_FIELDS
from leaderboard.statistics import Floats
from research.studies.compare import (
    STUDIES,
    Study,
    VariantEpisodes,
    home_of,
    main,
    variants_table,
    with_changes,
)
from tests.train.small import PARAMETERS
from turning_env import Family, Scenario
from turning_env.console import UserError

SMALL = PARAMETERS["ppo"] | {"total_timesteps": 600, "n_steps": 32, "batch_size": 64}
SETTINGS = ", ".join(f"{key} = {value}" for key, value in SMALL.items())
TRAINED = f"""
question = "Does it train?"
task = "RoughTurning-v0"
episodes = 2
trainings = 2
settings = {{ {SETTINGS} }}

[variants.whole]
algorithm = "ppo"
[variants.set_point]
like = "whole"
trainings = 1
settings = {{ gamma = 0.5 }}
scenario.control.action = "set_point"
[variants.rule]
policy = "fixed_tuned"
"""

ON_JOBS = """
question = "What is the truth worth?"
task = "RoughTurning-Family-v1"
seeds = "training_jobs"
episodes = 1

[variants.nominal_optimum]
policy = "fixed_nominal_optimum"
"""


def cells(line: str) -> list[str]:
    """Return the cells of a line of a table."""
    return [cell.strip() for cell in line.strip("|").split(" | ")]


def records(text: str) -> list[dict[str, str]]:
    """Return the lines of a table as cells by heading."""
    headings, _, *lines = text.splitlines()
    return [dict(zip(cells(headings), cells(line), strict=True)) for line in lines]


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_that_ships_can_be_read_and_asks_a_question(name: str) -> None:
    assert Study.read(name).question


def assumed_scenarios() -> dict[str, Scenario]:
    study = Study.read("assumptions")
    scenarios = {}
    for name, changes in study.scenarios.items():
        scenarios[name] = with_changes(study.task, changes, name)
    return scenarios


def test_other_laws_keep_the_loads_at_one_wear_and_the_life_at_the_start() -> None:
    """Otherwise a study of the form of a law would compare lathes of other sizes."""
    papers = Scenario().material
    start = {"cutting_speed": 125.0, "feed": 0.25, "depth_of_cut": 2.5}
    compared = set()
    for name, scenario in assumed_scenarios().items():
        material = scenario.material
        life = (0.3 / material.wear(**start)) ** (1.0 / material.wear.time)
        assert life == pytest.approx(38.236, rel=1e-4)
        wear = 0.25 if "-at_0.25" in name else 0.1
        for law in ("thrust_force", "power"):
            expected = getattr(papers, law)(**start, wear=wear)
            assert getattr(material, law)(**start, wear=wear) == pytest.approx(expected, rel=1e-6)
            if getattr(material, law) != getattr(papers, law):
                compared.add(name)
    assert {"loads_wear-0.68-0.22", "loads_affine-4.2-0.83", "measured_laws"} <= compared


def test_laws_that_are_unknown_are_those_of_the_papers() -> None:
    scenarios = assumed_scenarios()
    unknown = [name for name in scenarios if name.endswith("-unknown")]
    assert len(unknown) == 4
    for name in unknown:
        known = scenarios[name.removesuffix("-unknown")]
        assert scenarios[name].material == known.material
        assert scenarios[name].sensors == known.sensors
        assert scenarios[name].nominal().material == Scenario().material


@pytest.mark.slow
def test_what_was_trained_and_played_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.toml").write_text(TRAINED)
    arguments = [str(tmp_path / "mine.toml"), "--runs", str(tmp_path / "runs")]
    assert main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [cells(line)[0] for line in lines[2:]] == ["`whole`", "`set_point`", "`rule`"]
    # Three trained agents, and one file of all episodes.
    kept = [path for path in tmp_path.rglob("*") if path.name in ("policy.zip", "episodes")]
    written_at = [path.stat().st_mtime_ns for path in kept]
    assert len(kept) == 3 + 1

    assert main(arguments) == 0
    assert capsys.readouterr().out.splitlines() == lines
    assert [path.stat().st_mtime_ns for path in kept] == written_at

    # Episodes stand for their training.
    for policy in tmp_path.rglob("policy.zip"):
        policy.unlink()
    assert main(arguments) == 0
    assert capsys.readouterr().out.splitlines() == lines
    assert not [*tmp_path.rglob("policy.zip")]

    assert main([*arguments, "--variants", "rule", "--episodes", "3"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 3


@pytest.mark.slow
def test_agents_of_a_family_learn_on_as_many_lathes_with_such_sensors_as_a_study_says() -> None:
    curves = Study.read("curves")
    few = home_of(curves, curves.variant("ppo_16_lathes"))
    all_lathes = home_of(curves, curves.variant("ppo"))
    assert isinstance(few, Family)
    assert few.job(16).scenario == few.job(0).scenario
    assert few.job(16, "validation").scenario != few.job(0, "validation").scenario
    assert all_lathes == Family.load("shop")


def test_leads_are_over_another_variant_seed_by_seed() -> None:
    """Seeds differ by far more than the variants do."""
    study = Study.read("overload_price").model_copy(update={"episodes": 40})
    returns = np.linspace(-500.0, 500.0, 40)
    variants = {
        "margin_1": [_played(rough_turning=returns)],
        "margin_0.9": [_played(rough_turning=returns + 30.0)],
    }
    first, second = records(variants_table(study, variants))
    assert first["Difference [s]"] == ""
    assert second["Difference [s]"] == "30.0 (30.0 to 30.0)"
    assert second["Median [s]"] == "30.0"
    assert second["Better [% of seeds]"] == "100"
    assert second["At price 10 [s]"] == "19"
    assert second["By > 5 % [%]"] == "100.00, infeasible"


def test_scores_are_0_and_100_for_the_ends_of_the_scale() -> None:
    study = Study.read("curves").model_copy(update={"episodes": 4})
    returns = np.linspace(-500.0, 500.0, 4)
    variants = {
        "fixed_nominal_share": [_played(shop=returns - 200.0)],
        "causal": [_played(shop=returns + 200.0)],
        "ppo": [_played(shop=returns + 100.0)],
    }
    scores = [row["Score"] for row in records(variants_table(study, variants))]
    assert scores == ["0.0 (0.0 to 0.0)", "100.0 (100.0 to 100.0)", "75.0 (75.0 to 75.0)"]


def test_rankings_are_compared_with_that_of_the_first_scenario() -> None:
    study = Study.read("assumptions").model_copy(update={"episodes": 4})
    # The first two change places in the second scenario.
    variants = {
        "predictive": [_played(a=np.full(4, -1.0), b=np.full(4, -2.0))],
        "optimiser": [_played(a=np.full(4, -2.0), b=np.full(4, -1.0))],
        "fixed_tuned": [_played(a=np.full(4, -3.0), b=np.full(4, -3.0))],
    }
    _, _, first, second = variants_table(study, variants).splitlines()
    assert cells(first)[:3] == ["`a`", "1.00", "`predictive`"]
    expected = ["`b`", "0.33", "`optimiser`", "", "`optimiser` before `predictive`"]
    assert cells(second) == expected


def _played(**returns: Floats) -> VariantEpisodes:
    """Return made-up episodes by scenario, of given returns."""
    episodes = {}
    for scenario, values in returns.items():
        episodes[scenario] = dict.fromkeys(EPISODE_FIELDS, np.ones(len(values)))
        episodes[scenario]["return"] = values
    return VariantEpisodes(episodes, None)


@pytest.mark.slow
def test_a_controller_plays_the_jobs_of_a_family(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = tmp_path / "on_jobs.toml"
    study.write_text(ON_JOBS)
    assert main([str(study), "--runs", str(tmp_path / "runs")]) == 0
    _, _, row = capsys.readouterr().out.splitlines()
    family = Family.load("shop")
    play = FamilyPlay(family, "train", "fixed_nominal_optimum", forgets=False)
    episodes = play(family.job(0).scenario, [0], lambda ended: None)
    mean_return = float(cells(row)[1].split()[0])
    assert mean_return == pytest.approx(episodes["return"][0], abs=0.1)


def test_parameters_of_a_controller_on_jobs_are_refused(tmp_path: Path) -> None:
    study = tmp_path / "mine.toml"
    study.write_text(f"{ON_JOBS}settings = {{ top_speed = 0.5 }}\n")
    with pytest.raises(UserError, match="plays jobs with its own parameters"):
        Study.read(str(study))


@pytest.mark.parametrize(
    ("text", "wrong", "complaint"),
    [
        pytest.param("episodes = 2", "episodes = 0", "episodes", id="no episodes"),
        pytest.param(
            'like = "whole"', 'like = "none"', "like is 'none'", id="like an unknown variant"
        ),
        pytest.param(
            'like = "whole"', 'like = "set_point"', "like is 'set_point'", id="like itself"
        ),
        pytest.param(
            'algorithm = "ppo"',
            'algorithm = "dqn"',
            "algorithm is 'dqn'",
            id="unknown algorithm",
        ),
        pytest.param("gamma = 0.5", "gammas = 0.5", "settings has 'gammas'", id="unknown setting"),
        pytest.param(
            "scenario.control.action", "scenario.controls.action", "controls", id="unknown section"
        ),
        pytest.param(
            'policy = "fixed_tuned"',
            "",
            "needs one of algorithm, policy and like",
            id="nothing to play",
        ),
        pytest.param(
            "RoughTurning-v0", "RoughTurning-v9", "task is 'RoughTurning-v9'", id="unknown task"
        ),
        pytest.param("[variants.rule]", "[variants.rule", "Expected ']'", id="no TOML"),
    ],
)
def test_a_wrong_study_is_refused(
    text: str, wrong: str, complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert text in TRAINED
    (tmp_path / "mine.toml").write_text(TRAINED.replace(text, wrong))
    assert main([str(tmp_path / "mine.toml")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert complaint in line
