"""Studies train and play what they say, once, and compare variants seed by seed."""

from pathlib import Path

import numpy as np
import pytest

from research.studies.compare import STUDIES, Played, Study, main, table, with_changes
from tests.train.small import PARAMETERS
from turning_env import Scenario
from turning_env.scoring.play import EPISODE_FIELDS
from turning_env.scoring.statistics import Floats

SMALL = PARAMETERS["ppo"] | {"total_timesteps": 600, "n_steps": 32, "batch_size": 64}
TRAINED = f"""
question = "Does it train?"
task = "RoughTurning-v0"
episodes = 2
trainings = 2
settings = {{ {", ".join(f"{key} = {value}" for key, value in SMALL.items())} }}

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


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split(" | ")]


def test_every_study_asks_for_what_there_is() -> None:
    assert all(Study.read(name).question for name in STUDIES)


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
        wear = 0.25 if name.endswith("-at_0.25") else 0.1
        for law in ("thrust_force", "power"):
            expected = getattr(papers, law)(**start, wear=wear)
            assert getattr(material, law)(**start, wear=wear) == pytest.approx(expected, rel=1e-6)
            if getattr(material, law) != getattr(papers, law):
                compared.add(name)
    assert {"loads_wear-0.68-0.22", "loads_affine-4.2-0.83", "measured_laws"} <= compared


def test_laws_that_are_unknown_are_those_of_the_papers() -> None:
    scenarios = assumed_scenarios()
    unknown = [name for name in scenarios if name.endswith("-unknown")]
    assert len(unknown) == 2
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
    kept = {
        path: path.stat().st_mtime_ns
        for path in tmp_path.rglob("*")
        if path.name in ("policy.zip", "episodes")
    }
    assert len(kept) == 3 + 1
    assert main(arguments) == 0
    assert capsys.readouterr().out.splitlines() == lines
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert main([*arguments, "--variants", "rule", "--episodes", "3"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 3


def test_leads_are_over_another_variant_seed_by_seed() -> None:
    """Seeds differ by far more than the variants do."""
    study = Study.read("overload_price").model_copy(update={"episodes": 40})
    returns = np.linspace(-500.0, 500.0, 40)
    variants = {
        name: [_played(rough_turning=returns + more)]
        for name, more in (("margin_1", 0.0), ("margin_0.9", 30.0))
    }
    headings, _, first, second = (cells(line) for line in table(study, variants).splitlines())
    column = headings.index("Difference [s]")
    assert (first[column], second[column]) == ("", "30.0 (30.0 to 30.0)")
    assert (
        second[headings.index("Median [s]")],
        second[headings.index("Better [% of seeds]")],
    ) == ("30.0", "100")
    assert second[headings.index("At price 10 [s]")] == "19"
    assert second[headings.index("By > 5 % [%]")] == "100.00, infeasible"


def test_rankings_are_compared_with_that_of_the_first_scenario() -> None:
    study = Study.read("assumptions").model_copy(update={"episodes": 4})
    costs = {"predictive": (1.0, 2.0), "optimiser": (2.0, 1.0), "fixed_tuned": (3.0, 3.0)}
    variants = {
        name: [_played(a=np.full(4, -a), b=np.full(4, -b))] for name, (a, b) in costs.items()
    }
    _, _, home, other = (cells(line) for line in table(study, variants).splitlines())
    assert home[:3] == ["`a`", "1.00", "`predictive`"]
    assert other == ["`b`", "0.33", "`optimiser`", "", "`optimiser` before `predictive`"]


def _played(**returns: Floats) -> Played:
    """Return made-up episodes by scenario, of given returns."""
    ones = {
        name: dict.fromkeys(EPISODE_FIELDS, np.ones(len(values)))
        for name, values in returns.items()
    }
    return Played({name: ones[name] | {"return": values} for name, values in returns.items()}, None)


@pytest.mark.slow
def test_a_controller_is_told_the_truth_on_jobs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [
        "--variants",
        "as_it_is",
        "true_laws",
        "--episodes",
        "1",
        "--runs",
        str(tmp_path / "runs"),
    ]
    assert main(["family_ablation", *arguments]) == 0
    _, _, told, true = (cells(line)[1] for line in capsys.readouterr().out.splitlines())
    assert told != true


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("episodes = 2", "episodes = 0"), "episodes"),
        (('like = "whole"', 'like = "none"'), "like is 'none'"),
        (('like = "whole"', 'like = "set_point"'), "like is 'set_point'"),
        (('algorithm = "ppo"', 'algorithm = "dqn"'), "algorithm is 'dqn'"),
        (("gamma = 0.5", "gammas = 0.5"), "settings has 'gammas'"),
        (("scenario.control.action", "scenario.controls.action"), "controls"),
        (('policy = "fixed_tuned"', ""), "needs one of algorithm, policy and like"),
        (("RoughTurning-v0", "RoughTurning-v9"), "task is 'RoughTurning-v9'"),
        (("[variants.rule]", "[variants.rule"), "Expected ']'"),
    ],
)
def test_a_wrong_study_is_refused(
    change: tuple[str, str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.toml").write_text(TRAINED.replace(*change))
    assert main([str(tmp_path / "mine.toml")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert said in line
