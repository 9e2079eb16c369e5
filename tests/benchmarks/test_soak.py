"""Lathes that run for long: the short form of ``python -m benchmarks.soak``."""

from benchmarks.soak import __main__ as soak
from benchmarks.soak import lathes


def test_a_million_intervals_neither_grow_nor_drift() -> None:
    came = lathes.steps(1_000_000, checked=2)
    assert came.steps == 999_424
    assert came.episodes > 1024
    assert came.differing == 0
    assert came.growth <= soak.MAX_GROWTH


def test_a_thousand_resets_a_second_do_not_grow() -> None:
    came = lathes.resets(5000)
    assert came.differing == 0
    assert came.growth <= soak.MAX_GROWTH
    assert came.steps / came.seconds > 1000 / 10  # the machine may be busy with other things


def test_what_grows_is_found_out() -> None:
    kept: list[bytes] = []
    growth, _ = lathes._repeated(lambda: kept.append(bytes(range(256)) * 400), 200, "leak", 1)
    assert growth > soak.MAX_GROWTH
