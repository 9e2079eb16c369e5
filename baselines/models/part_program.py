"""What a feed override acts on: the cutting speed and feed of a part program, as controls that move feed alone have them."""

import numpy as np
from numpy.typing import NDArray

from baselines.rule import Parameters, Range
from turning_env import Reading, Scenario
from turning_env.action import sets_speed_and_feed, towards
from turning_env.score.policy import Actions

SPEED_AND_TARGET = {"cutting_speed": Range(50.0, 200.0), "target": Range(0.5, 1.0)}
"""What is tuned of every control of spindle load where the program is its own: the programmed cutting speed [m/min], clipped to
the machine, and the target load, as a share of the one at the power limit [-]."""


PROGRAM = {"cutting_speed": Range(50.0, 200.0), "feed": Range(0.06, 0.60, logarithmic=True)}
"""What is tuned of a part program where speed and feed are set."""


class PartProgram:
    """A programmed cutting speed and feed, and the range of the override [-]: 0 to ``control.override_max``.

    Args:
        scenario: what is played.
        parameters: ``cutting_speed`` [m/min] and ``feed`` [mm/rev] where the program is to differ from the scenario's.
    """

    def __init__(self, scenario: Scenario, parameters: Parameters) -> None:
        control, machine = scenario.control, scenario.machine
        self.scenario = scenario
        speed = parameters.get("cutting_speed", control.initial_cutting_speed)
        feed = parameters.get("feed", control.initial_feed)
        self.cutting_speed = min(max(speed, machine.cutting_speed_min), machine.cutting_speed_max)
        self.feed = min(max(feed, machine.feed_min), machine.feed_max)
        self.override_max = control.override_max

    def override(self, reading: Reading) -> NDArray[np.float64]:
        """The override that is commanded at present [-], shape (lanes,): the commanded feed over the programmed one."""
        return np.clip(reading.commanded_feed / self.feed, 0.0, self.override_max)

    def act(self, reading: Reading, override: NDArray[np.float64], change_edge: NDArray[np.bool_] | None = None) -> Actions:
        """The actions that command the programmed cutting speed, and the programmed feed times an override [-].

        What lies outside the ranges of override and feed is clipped. ``change_edge``: see ``turning_env.action.towards``.
        """
        machine = self.scenario.machine
        feed = np.clip(override, 0.0, self.override_max) * self.feed
        feed = np.clip(feed, machine.feed_min, machine.feed_max)
        return towards(reading, self.scenario, np.full(len(feed), self.cutting_speed), feed, change_edge)


def target_load(scenario: Scenario, share: float) -> float:
    """The spindle load [-] that a share of the power limit is."""
    return share * scenario.limits.power / scenario.machine.rated_power


def on_override(scenario: Scenario) -> bool:
    """Whether the feed override alone is set, with metal to be removed: what such controls are made for."""
    return scenario.control.action == "override" and scenario.control.aim == "removal"


def on_speed_and_feed(scenario: Scenario) -> bool:
    """Whether speed and feed are set, with metal to be removed, so that the part program is the control's own to choose."""
    return sets_speed_and_feed(scenario) and scenario.control.aim == "removal"


def on_roughness(scenario: Scenario) -> bool:
    """Whether the feed override alone is set, with a roughness to be held."""
    return scenario.control.action == "override" and scenario.control.aim == "roughness"
