import numpy as np
import pytest

from studies import time_to_beat
from tests.train.small import ALGORITHMS, PARAMETERS


def test_a_rule_is_beaten_only_if_the_interval_is_above_zero() -> None:
    theirs = np.zeros(40)
    surely, hardly = np.full(40, 1.0), np.linspace(-9.0, 10.0, 40)
    assert time_to_beat.difference(surely, theirs).low == pytest.approx(1.0)
    assert time_to_beat.difference(hardly, theirs).value == pytest.approx(0.5)
    assert time_to_beat.difference(hardly, theirs).low < 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ppo", "analytic_gradient"])
def test_the_clock_runs_until_the_rule_is_beaten(name: str) -> None:
    easy, hard = np.full(2, -1e9), np.full(2, 1e9)
    parameters = PARAMETERS[name]
    half = time_to_beat.time_to_beat(ALGORITHMS[name], 0, easy, 1024, parameters)
    assert 0.0 < half < np.inf
    assert time_to_beat.time_to_beat(ALGORITHMS[name], 0, hard, 1024, parameters) == np.inf


@pytest.mark.parametrize(("times", "status"), [([3.0, 5.0], 0), ([3.0, np.inf], 1)])
def test_the_exit_status_says_whether_all_have_beaten_it(
    times: list[float], status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    left = iter(times)
    monkeypatch.setattr(time_to_beat, "time_to_beat", lambda *arguments: next(left))
    arguments = ["--seeds", "2", "--rule", "fixed_tuned", "--tuning-seeds", "2"]
    assert time_to_beat.main(arguments) == status
    assert f"median {np.median(times):.0f} s (3 to {times[1]:.0f})" in capsys.readouterr().out
