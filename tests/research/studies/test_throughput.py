"""Speed is measured in turns, beside peers that run here and beside another checkout."""

from pathlib import Path

import pytest

from research.studies import throughput
from research.studies.throughput import Case, Timing


def test_ratios_are_taken_within_a_turn() -> None:
    cases = [Case(name, 1, 1, lambda: None) for name in ("reference", "other")]
    # The machine was half as fast in the second turn. In the third, the other case waited for a
    # core.
    reference_timings = [Timing(100.0, 100.0), Timing(50.0, 100.0), Timing(100.0, 100.0)]
    other_timings = [Timing(300.0, 300.0), Timing(150.0, 300.0), Timing(200.0, 300.0)]
    *_, other_line = throughput.medians_table(cases, [reference_timings, other_timings])
    assert other_line == "| other | 1 | 200.0 | 300.0 | 3 (2 to 3) |"


@pytest.mark.slow
def test_two_checkouts_take_turns(capsys: pytest.CaptureFixture[str]) -> None:
    root = Path(throughput.__file__).parents[2]
    arguments = ["--against", str(root), "--repeats", "2", "--seconds", "0.01"]
    assert throughput.main(arguments) == 0
    single, batch = capsys.readouterr().out.splitlines()
    assert single.startswith("one RoughTurning-v0: ")
    assert batch.startswith("1024 environments: ")


def test_a_folder_that_is_no_checkout_is_refused(tmp_path: Path) -> None:
    assert throughput.main(["--against", str(tmp_path)]) == 2
