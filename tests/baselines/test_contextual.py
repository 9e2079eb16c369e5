"""The rule whose constants follow from the catalogue's numbers, and its tuning."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from gymnasium.vector import AutoresetMode

from baselines.catalogue import names, names_on, spec
from baselines.contextual import RULES, log_speeds
from baselines.guided import START_SHARE
from leaderboard.family import family_task
from leaderboard.policies import named, one_named
from leaderboard.result import ResultError
from train import tune_contextual
from train.tune_contextual import LOG_SPEEDS, Grid, Plays, candidates
from turning_env import Family, FamilyVectorEnv

FAMILY = Family.load("unmodelled")
FIXED: Any = RULES["contextual"].fixed
SHORT = {
    "name": "short",
    "jobs": 16,
    "held_out_jobs": 16,
    "variables": {"hard": {"uniform": [0.8, 1.2], "unit": "-", "source": "test"}},
    "shown": ["hard"],
    "splits": {"train": [], "validation": []},
    "fields": {
        "control.time_limit": 0.5,
        "sensors.inspects_edges": True,
        "material.power.coefficient": "0.3034 * hard",
    },
}


def environments(*jobs: int) -> tuple[FamilyVectorEnv, Any]:
    """Return environments of training jobs, and their first observations."""
    env = FamilyVectorEnv(
        len(jobs), FAMILY, context="hidden", autoreset_mode=AutoresetMode.DISABLED
    )
    observations, _ = env.reset(seed=list(jobs))
    return env, observations


def test_the_log_speed_is_linear_in_the_numbers_of_the_catalogue() -> None:
    law = {
        "speed": -0.3,
        "speed_heat": -1.0,
        "speed_toughness": 0.5,
        "change_at": 0.8,
    }
    numbers = [{"heat": 0.5, "toughness": 0.5}, {"heat": 0.7, "toughness": 0.1}]
    first, second = log_speeds(law, numbers)
    # Numbers count from 0.5, the middle of the catalogue's scale.
    by_heat = -1.0 * (0.7 - 0.5)
    by_toughness = 0.5 * (0.1 - 0.5)
    assert first == pytest.approx(-0.3)
    assert second == pytest.approx(-0.3 + by_heat + by_toughness)
    with pytest.raises(ValueError, match="toughness"):
        log_speeds(law, [{"heat": 0.5}])


def test_a_job_has_the_numbers_of_its_context() -> None:
    job = FAMILY.job(5)
    assert tuple(job.numbers) == FAMILY.context_names
    mean, spread = FAMILY.context_scale
    numbers = np.array(list(job.numbers.values()))
    scaled = np.clip((numbers - mean) / spread, -10.0, 10.0)
    np.testing.assert_allclose(scaled, job.context)


def test_no_job_is_cut_faster_than_its_law_allows() -> None:
    env, observations = environments(5, 7)
    jobs = [FAMILY.job(5), FAMILY.job(7)]
    models = [job.scenario.nominal() for job in jobs]
    numbers = [job.numbers for job in jobs]
    law = {"speed": -0.8, "speed_heat": -0.5, "change_at": 0.8}
    policy = RULES["contextual"].controller(
        models,
        2,
        numbers=numbers,
        **FIXED,
        **law,
    )
    fastest = np.zeros(2)
    for step in range(120):
        observations, *_, infos = env.step(policy.act(observations))
        if step > 60:  # a job starts at a speed of its own
            fastest = np.maximum(fastest, infos["commanded_cutting_speed"])
    max_speeds = np.array([model.machine.cutting_speed_max for model in models])
    allowed = START_SHARE * max_speeds * np.exp(log_speeds(law, numbers))
    assert (fastest <= allowed * (1.0 + 1e-6)).all()
    assert (fastest > 0.9 * allowed).any()


def test_it_plays_families_that_it_was_tuned_on_and_nothing_else() -> None:
    shop = family_task("shop", "validation", 1)
    unmodelled = family_task("unmodelled", "validation", 1)
    parameters = one_named("contextual", unmodelled).parameters
    assert {"speed", "change_at", "speed_heat_resistance"} <= parameters.keys()
    assert "contextual" in names_on(FAMILY)
    with pytest.raises(ResultError, match="contextual"):
        named(["contextual"], shop)
    scenario = FAMILY.job(0).scenario
    assert "contextual" not in names(scenario)
    with pytest.raises(ValueError, match="numbers"):
        spec("contextual", scenario)


def test_candidates_find_the_law_that_made_the_returns() -> None:
    names = ("heat", "grade", "other")
    numbers = np.random.default_rng(3).uniform(-0.5, 0.5, (200, len(names)))
    heat = numbers[:, names.index("heat")]
    grade = numbers[:, names.index("grade")]
    best_log_speeds = -0.2 + 0.8 * heat - 0.4 * grade
    misses = np.array(LOG_SPEEDS) - best_log_speeds[:, np.newaxis]
    # Too fast costs three times as much as too slow.
    returns = -1000.0 * np.where(misses > 0.0, 3.0 * misses, -misses)
    grid = Grid(returns, numbers, names=names)

    laws = candidates(grid, names)
    constant = laws["constant"]
    best_law = laws["best law"]
    assert list(laws) == ["constant", "regression", "best law", "best law of two numbers"]
    for law in (best_law, laws["best law of two numbers"]):
        assert law["speed_heat"] == pytest.approx(0.8, abs=0.1)
        assert law["speed_grade"] == pytest.approx(-0.4, abs=0.1)
        assert abs(law.get("speed_other", 0.0)) < 0.1
    assert grid.mean_return_of_law(constant) < grid.mean_return_of_law(best_law)
    # Without numbers there is only one.
    assert list(candidates(grid, ())) == ["constant"]


def test_batches_that_were_played_come_from_the_log(tmp_path: Path) -> None:
    family = Family.load(SHORT)
    log = tmp_path / "log"
    laws = [{"speed": -0.3, "change_at": 0.8}, {"speed": 0.2, "change_at": 0.8}]
    returns = Plays(family, log).laws("test", laws, "train", 3)
    assert returns.shape == (2, 3)
    # Under the heading is a line for the batch: what was played, and its returns.
    _, entry, *_ = log.read_text("utf-8").split("\n")
    batch, _ = json.loads(entry)
    made_up = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    made_up_entry = json.dumps([batch, made_up])
    log.write_text(f'{made_up_entry}\n["cut short', "utf-8")
    plays = Plays(family, log)
    logged = plays.laws("test", laws, "train", 3)
    assert sorted(logged.ravel()) == made_up
    fewer = plays.laws("test", laws, "train", 2)
    assert fewer.shape == (2, 2)


@pytest.mark.slow
def test_the_command_writes_the_same_file_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = tmp_path / "short.toml"
    target = tmp_path / "found.json"
    source.write_text(tomli_w.dumps(SHORT), "utf-8")
    arguments = [str(source), "--jobs", "16", "--out", str(target)]
    written = []
    for _ in range(2):
        assert tune_contextual.main(arguments) == 0
        written.append(target.read_text("utf-8"))
    first, second = written
    assert first == second
    entry = json.loads(first)["rules"]["contextual"]
    assert {"speed", "change_at"} <= entry["parameters"].keys()
    assert entry["candidate"] in entry["validation_returns"]
    assert {path.name for path in tmp_path.iterdir()} == {source.name, target.name}
    capsys.readouterr()


@pytest.mark.parametrize(
    "arguments",
    [
        pytest.param(["missing.toml"], id="no file"),
        pytest.param(["shop", "--jobs", "3"], id="too few jobs"),
    ],
)
def test_the_command_refuses_what_it_cannot_tune(
    tmp_path: Path, arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "found.json"
    assert tune_contextual.main([*arguments, "--out", str(target)]) == 2
    assert list(tmp_path.iterdir()) == []
    assert capsys.readouterr().err.startswith("error: ")
