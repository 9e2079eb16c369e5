import pytest

from baselines.oracles.clairvoyant import Grid
from studies import bound
from turning_env import Scenario


def test_every_step_is_halved_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bound, "GRID", Grid(20.0, 30, 4))
    rows = bound.measure(Scenario.load("rough_turning"), 1)
    assert [row[0] for row in rows] == ["as used", "cell halved", "lives halved", "speeds halved", "all halved"]
    assert rows[0][2:4] == (0.0, 0.0)
    assert all(row[1] == pytest.approx(rows[0][1] + row[2]) for row in rows)
    assert len({row[1] for row in rows}) > 3
