"""Observations made from physical values, as the tests of controllers need them."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turning_env import Scenario
from turning_env.observation import bounds
from turning_env.physics.quantities import DEVIATION_SCALE, OBS, layout


def observe(
    scenario: Scenario,
    *,
    load: ArrayLike = 0.0,
    override: ArrayLike = 1.0,
    actual_override: ArrayLike | None = None,
    cutting: ArrayLike = True,
    cutting_time: ArrayLike = 1.0,
) -> NDArray[np.float32]:
    """Observations, shape (num_envs, entries), of a load and overrides of the scenario's feed [-], and a cutting time [min].

    The actual override is the commanded one if it is not given.
    """
    control, machine = scenario.control, scenario.machine
    actual = override if actual_override is None else actual_override
    columns = np.broadcast_arrays(load, override, actual, cutting, cutting_time)
    load, override, actual, cutting, cutting_time = (np.atleast_1d(column).astype(np.float64) for column in columns)
    low, _ = bounds(scenario)
    seen = np.zeros((len(load), len(low)))
    seen[:, OBS.power] = DEVIATION_SCALE * (load * machine.rated_power / scenario.limits.power - 1.0)
    seen[:, OBS.cutting_speed] = seen[:, OBS.commanded_cutting_speed] = _position(
        control.initial_cutting_speed, machine.cutting_speed_min, machine.cutting_speed_max
    )
    seen[:, OBS.feed] = _position(actual * control.initial_feed, machine.feed_min, machine.feed_max)
    seen[:, OBS.commanded_feed] = _position(override * control.initial_feed, machine.feed_min, machine.feed_max)
    seen[:, OBS.cutting_time] = np.log1p(cutting_time)
    seen[:, OBS.cutting] = cutting
    return seen.astype(np.float32)


def seen(**entries: float) -> NDArray[np.float32]:
    """One observation in metal of a task of speed and feed: 0 but for the named entries."""
    values = dict.fromkeys(layout(Scenario()), 0.0) | {"cutting": 1.0} | entries
    return np.array([list(values.values())], np.float32)


def override_of(actions: NDArray[np.float32], scenario: Scenario) -> NDArray[np.float64]:
    """The override [-] that actions of an override task ask for."""
    return 0.5 * (actions[:, 0].astype(np.float64) + 1.0) * scenario.control.override_max


def _position(value: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    return np.clip(2.0 * np.log(np.maximum(value, low) / low) / np.log(high / low) - 1.0, -1.0, 1.0)
