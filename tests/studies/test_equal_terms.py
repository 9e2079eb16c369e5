"""The comparison on equal terms trains what it says, keeps it, and takes one term away at a time."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leaderboard.result import Result, Task
from studies import equal_terms
from studies.equal_terms import ALGORITHMS, TERMS, Played, parameters, terms
from tests.train.small import PARAMETERS, SCENARIO
from train.run import Run, hyperparameters
from turning_env import Scenario
from turning_env.scoring.policy import PolicySpec
from turning_env.scoring.seeds import held_out_seeds

AGENTS = ["ppo", "ppo-position", "analytic_gradient"]


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trainings of some hundred intervals, on edges that wear out soon, and one split."""
    monkeypatch.setattr(
        "train.run.hyperparameters", lambda algorithm, env_id: hyperparameters(algorithm, env_id) | PARAMETERS[algorithm]
    )
    monkeypatch.setattr(equal_terms, "TUNED", {name: {} for name in ALGORITHMS})
    monkeypatch.setattr(equal_terms, "SPLITS", ("harder_lot",))
    monkeypatch.setattr(equal_terms, "IDS", {equal_terms.ENV_ID: SCENARIO})


@pytest.mark.slow
@pytest.mark.usefixtures("small")
def test_agents_are_trained_and_played_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, runs = tmp_path / "equal_terms.md", tmp_path / "runs"
    arguments = ["--agents", *AGENTS, "--seeds", "2", "--seeds-apart", "1", "--steps", "300", "--episodes", "2"]
    arguments += ["--runs", str(runs), "--out", str(out)]
    assert equal_terms.main(arguments) == 0
    page = out.read_text("utf-8")
    assert page == capsys.readouterr().out.removesuffix("\n")
    assert {line.split(" | ")[0] for line in page.splitlines() if line.startswith("| `")} == {"| `ppo`", "| `analytic_gradient`"}
    trained = {
        name: Run.read(runs / "equal_terms" / name / equal_terms.ENV_ID / SCENARIO.name / "ppo-seed0") for name in AGENTS[:2]
    }
    assert [run.parameters["position"] for run in trained.values()] == [True, False]
    monkeypatch.setattr(equal_terms, "play", None)
    assert equal_terms.main(arguments) == 0
    assert out.read_text("utf-8") == page
    more = [*arguments, "--trained", "--seeds", "9", "--seeds-apart", "9"]
    assert equal_terms.main(more) == 0  # nothing but what was trained
    assert out.read_text("utf-8").split("```")[2] == page.split("```")[2]
    with pytest.raises(SystemExit):
        equal_terms.main([*more, "--agents", "sac"])
    assert "--trained finds no agent" in capsys.readouterr().err


@pytest.mark.parametrize("term", TERMS)
def test_one_term_is_taken_away(monkeypatch: pytest.MonkeyPatch, term: str) -> None:
    monkeypatch.setattr(equal_terms, "TUNED", {name: {} for name in ALGORITHMS})
    for name in [name for name in ALGORITHMS if term in terms(name)]:
        whole, less = parameters(name), parameters(f"{name}-{term}")
        assert {key for key in whole if whole[key] != less[key]} == set(terms(name)[term][0])


def test_trainings_are_for_names_that_their_files_know() -> None:
    for name in equal_terms.AGENTS:
        assert set(parameters(name)) <= set(hyperparameters(name.partition("-")[0], equal_terms.ENV_ID))


def test_differences_are_paired_by_held_out_seed() -> None:
    """Seeds differ by far more than the agents do."""
    draws = np.linspace(-500.0, 500.0, 40)
    rows = {name: [played(name, seed, draws + more) for seed, more in enumerate(mores)] for name, mores in RETURNS.items()}
    first, second = (line.split(" | ") for line in equal_terms.compared(rows)[2:])
    assert (first[0], first[2]) == ("| `ppo`", "")
    assert (second[0], second[2], second[3]) == ("| `sac`", "-30.0 (-32.0 to -28.0)", "-30 to -28")


RETURNS = {"sac": (-30.0, -28.0), "ppo": (0.0, 2.0)}


def played(name: str, seed: int, returns: Any) -> Played:
    """An agent with these returns on a scenario without splits."""
    task = Task(env_id=equal_terms.ENV_ID, scenario=Scenario(), seeds=held_out_seeds(len(returns)))
    spec = PolicySpec(name=name, kind="agent", training_seed=seed)
    return Played({"home": Result.of(task, spec, dict.fromkeys(Result.FIELDS, np.ones(len(returns))) | {"return": returns})}, 1.0)
