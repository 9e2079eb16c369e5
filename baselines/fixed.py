"""One cutting speed and one feed for the edge's whole life.

Uses nothing from the nominal model but the ranges of speed and feed.
"""

from typing import Self

import numpy as np

from baselines.models.part_program import PROGRAM
from baselines.rule import Array, Rule, TuningRange
from turning_env import Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario import ScenarioBatch

HANDBOOK_CUTTING_SPEED = 145.0
"""Middle speed of the grid-search paper's verification tests (T5 to T8) [m/min]."""
HANDBOOK_FEED = 0.32
"""Usual roughing feed for an insert of this size [mm/rev] (assumption).

It is about half of the machine's highest.
"""


class FixedParameters(Policy):
    """A policy of one cutting speed and one feed.

    Args:
        scenario: task.
        cutting_speed: cutting speed [m/min], a number or of shape (num_envs,).
        feed: feed [mm/rev], likewise. Both are clipped to the machine.
    """

    def __init__(
        self,
        scenario: Scenario | ScenarioBatch,
        cutting_speed: float | Array,
        feed: float | Array,
    ) -> None:
        machine = scenario.machine
        self._scenario = scenario
        self._cutting_speed = np.clip(
            cutting_speed, machine.cutting_speed_min, scenario.cutting_speed_max
        )
        self._feed = np.clip(feed, machine.feed_min, machine.feed_max)

    @classmethod
    def programmed(cls, scenario: Scenario | ScenarioBatch, override: float = 1.0) -> Self:
        """Return the policy that commands the scenario's initial cutting speed and feed.

        ``override``: factor on the feed [-].
        """
        control = scenario.control
        return cls(scenario, control.initial_cutting_speed, feed=override * control.initial_feed)

    def act(self, observations: Observations) -> Actions:
        reading = read(observations, self._scenario)
        speed = np.broadcast_to(self._cutting_speed, len(observations))
        feed = np.broadcast_to(self._feed, len(observations))
        return towards(reading, self._scenario, speed, feed)


def _build(scenario: Scenario, num_envs: int, **parameters: float) -> FixedParameters:
    return FixedParameters(scenario, **parameters)


def _build_override(scenario: Scenario, num_envs: int, override: float) -> FixedParameters:
    return FixedParameters.programmed(scenario, override)


RULES = {
    "fixed_handbook": Rule(
        "one handbook speed and feed for the edge's whole life",
        _build,
        plays=sets_speed_and_feed,
        parameters={"cutting_speed": HANDBOOK_CUTTING_SPEED, "feed": HANDBOOK_FEED},
    ),
    "fixed_tuned": Rule(
        "the best speed and feed on the tuning seeds",
        _build,
        plays=sets_speed_and_feed,
        parameters=PROGRAM,
        worth_tuning=True,
    ),
    "override_tuned": Rule(
        "the best constant override on the tuning seeds",
        _build_override,
        plays=lambda scenario: scenario.control.action == "override",
        parameters={"override": TuningRange(0.1, 2.0, logarithmic=True)},
        worth_tuning=True,
    ),
}
