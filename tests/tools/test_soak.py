"""Environments that run for long: the short form of ``python -m tools.soak``."""

from tools import soak


def test_many_steps_neither_grow_nor_drift() -> None:
    report = soak.step_long(200_000, num_envs=256, checked=2)
    assert report.steps == 199_936
    assert report.episodes > 256
    assert report.differing == 0
    assert report.growth <= soak.MAX_GROWTH
