"""The constant-force law: its equation, its threshold, its bounds, its network, and what it does to the force and the surface."""

import numpy as np
import pytest
from numpy.typing import NDArray

from baselines.constant_force import (
    ENGAGED_TIME,
    THRESHOLD,
    ConstantForce,
    ConstantForceNetwork,
    feed_of_roughness,
    force_of_roughness,
    recommended_feed,
)
from baselines.models.part_program import PartProgram
from tests.turning_env.playing import changed
from turning_env import Scenario
from turning_env.observation import bounds
from turning_env.physics.quantities import OBS

SURFACE = Scenario.load("surface")
HELD = changed(SURFACE, surface={"reference_min": 1.6, "reference_max": 1.6})
NEEDED = round(ENGAGED_TIME / HELD.control.interval)


def observations(scenario: Scenario, force: float, feed: float = 0.2, commanded: float = 0.2) -> NDArray[np.float32]:
    """Observations in metal at a measured force [N], an actual and a commanded feed [mm/rev]."""
    machine = scenario.machine
    seen = np.zeros((1, len(bounds(scenario)[0])), np.float32)
    seen[:, OBS.thrust_force] = 5.0 * (force / scenario.limits.thrust_force - 1.0)
    span = np.log(machine.feed_max / machine.feed_min)
    for place, value in ((OBS.feed, feed), (OBS.commanded_feed, commanded)):
        seen[:, place] = 2.0 * np.log(value / machine.feed_min) / span - 1.0
    seen[:, OBS.cutting] = 1.0
    return seen


def override(policy: ConstantForce, seen: NDArray[np.float32], times: int = 1) -> NDArray[np.float64]:
    """Override [-] commanded after so many of the same observations."""
    for _ in range(times):
        actions = policy.act(seen)
    return 0.5 * (actions[:, 0].astype(np.float64) + 1.0) * HELD.control.override_max


def law(scenario: Scenario = HELD, num_envs: int = 1, **arguments: bool | float) -> ConstantForce:
    return ConstantForce(PartProgram(scenario, {}), num_envs, **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(("on_command", "before"), [(False, 0.2), (True, 0.1)])
def test_the_feed_is_the_one_before_times_reference_over_force(on_command: bool, before: float) -> None:
    seen = observations(HELD, 500.0, feed=0.2, commanded=0.1)
    expected = before / 0.2 * force_of_roughness(HELD.surface, np.array([1.6])) / 500.0
    assert override(law(on_command=on_command), seen, NEEDED) == pytest.approx(expected, rel=1e-5)


def test_the_tool_enters_with_the_recommended_feed_and_the_override_acts_on_it() -> None:
    policy, wanted = ConstantForceNetwork(PartProgram(HELD, {}), 1), np.array([1.6])
    (recommended,) = recommended_feed(HELD)(wanted) / HELD.control.initial_feed
    assert recommended * HELD.control.initial_feed == pytest.approx(feed_of_roughness(HELD, wanted)[0], rel=0.005)
    assert override(policy, observations(HELD, 0.0)) == pytest.approx(recommended, rel=1e-5)
    seen = observations(HELD, 500.0)
    assert override(policy, seen, NEEDED - 1) == pytest.approx(recommended, rel=1e-5)
    assert override(policy, seen) == override(law(), seen, NEEDED)
    assert override(policy, observations(HELD, THRESHOLD + 1.0)) == pytest.approx(1.5 * recommended, rel=1e-5)
