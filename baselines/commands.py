"""How a controller that thinks in set points acts: the action that moves the commands towards them."""

import numpy as np
from numpy.typing import NDArray

from baselines.policy import Actions
from turning_env import Reading, Scenario


def towards(reading: Reading, scenario: Scenario, cutting_speed: NDArray[np.float64], feed: NDArray[np.float64]) -> Actions:
    """Actions, shape (lanes, 2), that bring the commands to the wanted cutting speed [m/min] and feed [mm/rev].

    With incremental actions, as near as one interval allows.
    """
    control, machine = scenario.control, scenario.machine
    if control.action == "incremental":
        speed_action = np.log(cutting_speed / reading.commanded_cutting_speed) / control.cutting_speed_step
        feed_action = np.log(feed / reading.commanded_feed) / control.feed_step
    else:
        speed_range = machine.cutting_speed_max - machine.cutting_speed_min
        speed_action = 2.0 * (cutting_speed - machine.cutting_speed_min) / speed_range - 1.0
        feed_action = 2.0 * (feed - machine.feed_min) / (machine.feed_max - machine.feed_min) - 1.0
    actions = np.stack([speed_action, feed_action], axis=1)
    return np.clip(actions, -1.0, 1.0).astype(np.float32)
