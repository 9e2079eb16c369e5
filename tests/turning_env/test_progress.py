"""Progress of long commands without a terminal."""

import sys

import pytest
from tqdm import tqdm

from turning_env import progress


def shown_by_a_training(capsys: pytest.CaptureFixture[str]) -> str:
    """Return what ten steps and a note in between print on stderr."""
    bar = progress.progress(total=10, unit="step", desc="ppo, seed 0")
    for _ in range(10):
        bar.set_postfix_str("return per episode -3 s", refresh=False)
        bar.update()
        tqdm.write("a note", file=sys.stderr)
    bar.close()
    return capsys.readouterr().err


def test_lines_say_how_far_a_command_is(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "LINE_EVERY", 0.0)
    lines = [line for line in shown_by_a_training(capsys).splitlines() if line != "a note"]
    assert lines[-1].startswith("ppo, seed 0: 100 %, 10 of 10 steps, ")
    assert all(" left" in line for line in lines)
    assert lines[-1].endswith(", return per episode -3 s")


def test_the_first_steps_foretell_no_time(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "LINE_EVERY", 0.0)
    with progress.progress(total=1000, unit="step", mininterval=0.0) as bar:
        for _ in range(500):
            bar.update()
    lines = capsys.readouterr().err.splitlines()
    few = [line for line in lines if " 5 of 1000 steps" in line]
    many = [line for line in lines if " 500 of 1000 steps" in line]
    assert few
    assert many
    assert all(line.endswith("? left") for line in few)
    assert not any("? left" in line for line in many)


def test_a_short_command_prints_no_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert set(shown_by_a_training(capsys).splitlines()) == {"a note"}


def test_a_counter_goes_on_from_where_the_bar_stands() -> None:
    with progress.progress(total=10) as bar:
        bar.update(4)
        count = progress.Counter(bar)
        for done in (1, 1, 3):
            count(done)
        assert bar.n == 7
