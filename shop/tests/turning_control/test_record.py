"""A record goes on after the connection is lost."""

from collections.abc import Iterator
from datetime import UTC, datetime

import pytest
from turning_control.machine_log.record import Runs, Sample, reconnecting

SAMPLE = Sample(time=datetime(2026, 1, 1, tzinfo=UTC))


class Interrupted:
    """A source whose connections end in an error; some of them bring no sample before."""

    def __init__(self, *brings: bool) -> None:
        self.brings = list(brings)

    def found(self) -> list[str]:
        return []

    def samples(self, last: Sample | None, runs: Runs) -> Iterator[Sample]:
        if self.brings.pop(0):
            yield SAMPLE
        raise OSError("no answer")


def test_a_machine_that_stays_away_is_named_once(capsys: pytest.CaptureFixture[str]) -> None:
    source = Interrupted(True, False, False, True)
    samples = list(
        reconnecting(
            source,
            None,
            lambda: bool(source.brings),
            pause=0.0,
        )
    )
    assert len(samples) == 2
    said = capsys.readouterr().err.splitlines()
    lost = "lost: no answer; trying again"
    assert said == [lost, "connected again", lost]


def test_a_first_connection_that_fails_is_an_error() -> None:
    with pytest.raises(OSError, match="no answer"):
        list(reconnecting(Interrupted(False), None, lambda: True))
