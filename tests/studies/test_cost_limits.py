"""The cost-limit benchmark trains, plays, prints and draws, and a second call trains nothing."""

from pathlib import Path

import pytest

from studies import cost_limits
from tests.train.small import PARAMETERS, SCENARIO
from train.run import hyperparameters
from turning_env import Scenario


@pytest.mark.slow
def test_every_algorithm_is_trained_at_every_target_played_and_drawn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("train.run.hyperparameters", lambda name, env_id: hyperparameters(name, env_id) | PARAMETERS[name])
    short = Scenario.model_validate(SCENARIO.model_dump() | {"name": "rough_turning"})
    monkeypatch.setattr(cost_limits, "Scenario", type("Short", (), {"load": lambda name: short}))
    plot = tmp_path / "made.png"
    arguments = ["--shares", "2", "0.5", "--seeds", "1", "--steps", "600", "--episodes", "3", "--runs", str(tmp_path)]
    assert cost_limits.main([*arguments, "--out", str(plot)]) == 0
    table = capsys.readouterr().out
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
    assert [row[:2] for row in rows] == [[f"`{name}`", share] for name in cost_limits.ALGORITHMS for share in ("2.5", "10")]
    assert plot.read_bytes().startswith(b"\x89PNG")
    folders = sorted(path.parent for path in tmp_path.rglob("policy.zip"))
    assert len(folders) == len(rows)
    written = [(folder / "policy.zip").stat().st_mtime_ns for folder in folders]
    assert cost_limits.main(arguments) == 0
    assert capsys.readouterr().out == table
    assert [(folder / "policy.zip").stat().st_mtime_ns for folder in folders] == written
