"""One cutting speed and one feed for the edge's whole life.

It needs nothing of the nominal model but the ranges of speed and feed.
"""

from typing import Self

import numpy as np

from baselines.models.part_program import PROGRAM
from baselines.rule import Array, Range, Rule
from turning_env import Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.scenario import ScenarioBatch
from turning_env.scoring.policy import Actions, Observations, Policy

HANDBOOK_CUTTING_SPEED, HANDBOOK_FEED = 145.0, 0.32
"""Middle speed of the grid-search paper's verification tests (T5 to T8) [m/min]; usual roughing feed for an insert of this size,
about half of the machine's highest [mm/rev] (assumption)."""


class FixedParameters(Policy):
    """A policy of one cutting speed [m/min] and feed [mm/rev], numbers or of shape (num_envs,), clipped to the machine."""

    def __init__(
        self,
        scenario: Scenario | ScenarioBatch,
        cutting_speed: float | Array,
        feed: float | Array,
    ) -> None:
        self._scenario, machine = scenario, scenario.machine
        speed = np.clip(cutting_speed, machine.cutting_speed_min, scenario.cutting_speed_max)
        self._set_point = speed, np.clip(feed, machine.feed_min, machine.feed_max)

    @classmethod
    def programmed(cls, scenario: Scenario | ScenarioBatch, override: float = 1.0) -> Self:
        """Return the policy that commands the scenario's initial cutting speed and feed, the feed times an override [-]."""
        return cls(
            scenario,
            scenario.control.initial_cutting_speed,
            override * scenario.control.initial_feed,
        )

    def act(self, observations: Observations) -> Actions:
        speeds, feeds = (np.broadcast_to(each, len(observations)) for each in self._set_point)
        return towards(read(observations, self._scenario), self._scenario, speeds, feeds)


def _build(scenario: Scenario, num_envs: int, **parameters: float) -> FixedParameters:
    return FixedParameters(scenario, **parameters)


RULES = {
    "fixed_handbook": Rule(
        "one handbook speed and feed for the edge's whole life",
        _build,
        sets_speed_and_feed,
        {"cutting_speed": HANDBOOK_CUTTING_SPEED, "feed": HANDBOOK_FEED},
    ),
    "fixed_tuned": Rule(
        "the best speed and feed on the tuning seeds",
        _build,
        sets_speed_and_feed,
        PROGRAM,
        worth_tuning=True,
    ),
    "override_tuned": Rule(
        "the best constant override on the tuning seeds",
        lambda scenario, num_envs, **parameters: FixedParameters.programmed(scenario, **parameters),
        lambda scenario: scenario.control.action == "override",
        {"override": Range(0.1, 2.0, logarithmic=True)},
        worth_tuning=True,
    ),
}
