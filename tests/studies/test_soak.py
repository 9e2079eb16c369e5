"""Environments that run for long: the short form of ``python -m studies.soak``."""

from mmap import mmap

from studies import soak


def test_many_steps_neither_grow_nor_drift() -> None:
    came = soak.step_long(200_000, num_envs=256, checked=2)
    assert came.steps == 199_936
    assert came.episodes > 256
    assert came.differing == 0
    assert came.growth <= soak.MAX_GROWTH


def test_growth_is_found_out() -> None:
    kept: list[mmap] = []  # never memory that was freed before

    def leak() -> None:
        kept.append(mmap(-1, 1_000_000))
        kept[-1].write(bytes(1_000_000))

    growth, _ = soak.repeat(leak, 20, "leak")
    assert growth > soak.MAX_GROWTH
