"""Environments that run for long: the short form of ``python -m tools.soak``."""

from tools import soak


def test_many_steps_neither_grow_nor_drift() -> None:
    came = soak.step_long(200_000, num_envs=256, checked=2)
    assert came.steps == 199_936
    assert came.episodes > 256
    assert came.differing == 0
    assert came.growth <= soak.MAX_GROWTH
