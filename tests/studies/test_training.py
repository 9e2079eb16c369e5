from pathlib import Path

import pytest

from studies import training
from turning_env import Scenario


@pytest.mark.slow
def test_every_question_gets_an_answer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(training, "MANY_ENVS", training.MANY_ENVS | {"batch_size": 32})
    parameters = training.ppo_run(tmp_path).parameters
    assert parameters["num_envs"] * parameters["rollout"] > 1000
    small = {"num_envs": 8, "rollout": 16, "batch_size": 32}
    monkeypatch.setattr(training, "ppo_run", lambda folder: _small(folder, small))
    measured = training.measure(2, 4, tmp_path)
    assert all(len(turns) == 2 for turns in measured.values())
    assert all(value > 0.0 for turns in measured.values() for value in turns)
    assert max(measured["share"]) < 1.0


def _small(folder: Path, overrides: dict[str, object]) -> training.Run:
    return training.Run.plan("ppo", training.MAIN, Scenario.load("rough_turning"), 0, folder, "", overrides)


@pytest.mark.parametrize(("share", "status", "verdict"), [(0.05, 0, "met     PPO as"), (0.2, 1, "FAILED  PPO as")])
def test_the_exit_status_is_the_verdict(
    share: float, status: int, verdict: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answers = {"stepping": [30.0, 40.0, 50.0], "training": [3.0] * 3, "share": [share] * 3}
    monkeypatch.setattr(training, "measure", lambda *arguments: answers)
    assert training.main([]) == status
    printed = capsys.readouterr().out
    assert verdict in printed
    assert "40 times (30 to 50)" in printed
