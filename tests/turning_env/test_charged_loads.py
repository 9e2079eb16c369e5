"""Observed loads are what a policy is charged for.

Without noise and lags, overload is charged by the excess of the observed loads over their limits.
"""

from typing import NamedTuple

import numpy as np
import pytest

from tests.turning_env.playing import changed
from turning_env import IDS, Family, RoughTurningVectorEnv, Scenario
from turning_env.physics.quantities import DEVIATION_SCALE, MAX_RATIO, OBS, action_size
from turning_env.scenario.family import families

NUM_ENVS = 8
STEPS = 60
JOBS = range(6)
"""Jobs of a family that are compared: some of each cut below the spindle's base speed."""
LIMIT_SHARE = 0.2
"""Share of the scenario's limits, so that there are overloads."""
MIN_COMPARED = 100
MIN_OVERLOADED = 10
MEASURED_AT_ONCE = {
    "power_noise": 0.0,
    "force_noise": 0.0,
    "power_time_constant": 0.0,
    "force_time_constant": 0.0,
}
"""Sensors that read the truth at the end of a step."""
ONE_SUB_STEP = {"sub_steps": 1}
"""The mean excess of a step is then that at its end."""


class Compared(NamedTuple):
    """Excess of power and of thrust force over their limits, summed up [-], step by step."""

    observed: np.ndarray
    charged: np.ndarray  # mean over the time in metal


def scenarios_of(name):
    """Return the scenario of a preset, or those of some jobs of a family."""
    if name not in families():
        return [Scenario.load(name)]
    family = Family.load(name)
    return [family.job(number).scenario for number in JOBS]


def hard_actions(scenario):
    """Return random actions that rather raise the feed, so that there are overloads.

    Edges are kept, and parts have one pass, which observation and charge are both of.
    """
    random = np.random.default_rng(0)
    actions = random.uniform(-1.0, 1.0, (STEPS, NUM_ENVS, action_size(scenario)))
    feed = 0 if scenario.control.action == "override" else 1
    actions[:, :, feed] = np.abs(actions[:, :, feed])
    if scenario.control.action == "part":
        actions[:, :, 0] = -1.0
    if scenario.control.edge_changes == "commanded":
        actions[:, :, -1] = -1.0
    return actions.astype(np.float32)


def plain(scenario):
    """Return a scenario that measures at once, with limits that are often exceeded."""
    limits = {}
    for name in ("thrust_force", "power"):
        limits[name] = LIMIT_SHARE * getattr(scenario.limits, name)
    return changed(
        scenario,
        sensors=MEASURED_AT_ONCE,
        control=ONE_SUB_STEP,
        limits=limits,
        tool={"edge_strength": 1e6},
    )


def compared(name):
    """Return the observed and the charged excess in a play of a preset, or of a family's jobs."""
    observed = []
    charged = []
    for noisy in scenarios_of(name):
        scenario = plain(noisy)
        envs = RoughTurningVectorEnv(NUM_ENVS, scenario)
        envs.reset(seed=0)
        for actions in hard_actions(scenario):
            observations, _, terminated, truncated, infos = envs.step(actions)
            # Loads fall as soon as the tool leaves the metal. Those of a part are means over it.
            in_metal = infos["cutting"] | (scenario.control.action == "part")
            in_metal &= (infos["engaged_time"] > 0.0) & ~(terminated | truncated)
            # An edge that failed in the step has been charged, and another one is observed.
            in_metal &= infos["stopped_time"] == 0.0
            loads = observations[in_metal][:, [OBS.power, OBS.thrust_force]] / DEVIATION_SCALE + 1.0
            observed.append(np.maximum(loads - 1.0, 0.0).sum(axis=1))
            overload = -infos["reward_overload"] / scenario.economics.overload_price
            charged.append(overload[in_metal] / infos["engaged_time"][in_metal])
    return Compared(np.concatenate(observed), np.concatenate(charged))


def ids_and_families():
    """Return the presets of all ids, one whose load reading is a share of torque, and families."""
    return [*IDS.values(), "override_torque", *families()]


@pytest.mark.parametrize("name", ids_and_families())
def test_overload_is_charged_by_the_observed_loads_over_their_limits(name):
    play = compared(name)
    assert len(play.observed) >= MIN_COMPARED
    assert np.count_nonzero(play.charged) >= MIN_OVERLOADED
    # Entries are limited to four times the limit, and have the seven digits of float32.
    shown = play.charged < MAX_RATIO - 1.0
    np.testing.assert_allclose(play.observed[shown], play.charged[shown], atol=5e-6)
