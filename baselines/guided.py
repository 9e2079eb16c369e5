"""A rule with two set points that a guide gives: the highest cutting speed and the used life at which edges are changed.

``self_tuning`` does the rest. A guide, such as a network trained on other lathes, sees ``features``: what the nominal model says of
the job (its context), what the rule's filter believes, and what became of the edges before. The rule is so slow to mislead that a
guide decides once in ``HOLD`` steps.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.belief import Belief, Float32s
from baselines.self_tuning import RULES, SelfTuning
from turning_env import Reading, Scenario, read
from turning_env.numerics.functions import exp, log
from turning_env.scoring.policy import Actions, Observations, Policy

Array = NDArray[np.float64]

HOLD = 30
"""Steps for which a guide's decision holds."""
MIDDLE, SPAN = (0.9, 0.8), (0.5, 0.3)
"""Actions of 0 mean this share of the start speed and this used life. Actions of 1: exp(0.5) times the speed, and 0.3 more life."""
START_SHARE = 0.625
"""Start speed over the machine's highest speed [-], in the families that ship."""
WORN = 0.97
"""Measured over criterion wear above which an edge that was changed unasked counts as worn out, not broken [-]."""
HISTORY = (
    "edges_broken",  # over 3, at most 1
    "heat_at_breakage",  # log temperature of the edge that broke last, over that of a worn-out one at the start speed; 1 if none did
    "life_at_breakage",  # its used life; 1.5 if none did
    "heat_survived",  # the hottest that any edge has been before its last half minute; -2 at first
    "life_survived",  # the longest used life of an edge that was not broken
    "wear_surprise",  # log ratio of the last removed edge's measured wear to the one expected
)
"""What a guide knows of the edges before [-]."""


class GuidedRule(SelfTuning):
    """``self_tuning`` on the filter of a ``Belief``, which observes for it, in environments with a nominal model each."""

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        parameters: Any = RULES["self_tuning"].fixed
        super().__init__(scenarios, len(scenarios), **parameters)
        self.belief = Belief(scenarios, learns_laws=True)
        self._filter = self.belief._filter
        self._history = np.zeros((len(scenarios), len(HISTORY)))
        self._last = np.zeros((4, len(scenarios)))  # cutting time [min], used life, heat, and whether the edge was to be changed
        self._worst = np.zeros((2, len(scenarios)))  # heat of the present edge: half a minute ago, and since
        self._entries = self.belief._entries
        self.reset(np.ones(len(scenarios), np.bool_))

    def reset(self, mask: NDArray[np.bool_]) -> None:
        super().reset(mask)
        self._history[mask] = 0.0, 1.0, 1.5, -2.0, 0.0, 0.0
        self._last[:, mask] = 0.0
        self._worst[:, mask] = -2.0

    def _observe(self, reading: Reading) -> None:
        """Leave it to ``features``."""

    def features(self, observations: Observations) -> Float32s:
        """Return belief, history and context of the observations, shape (num_envs, entries)."""
        believed = self.belief.observe(observations)
        reading = read(observations[:, : self._entries], self._scenario)
        self._note(reading)
        return np.concatenate([observations[:, self._entries :], believed, self._history.astype(np.float32)], axis=1)

    def _note(self, reading: Reading) -> None:
        scenario, last, history = self._scenario, self._last, self._history
        fresh = reading.cutting_time < last[0]
        measured = reading.removed_wear / scenario.tool.wear_criterion
        broke = fresh & (last[3] == 0.0) & (measured < WORN)
        history[:, 0] = np.minimum(history[:, 0] + broke / 3.0, 1.0)
        history[:, 1] = np.where(broke, last[2], history[:, 1])
        history[:, 2] = np.where(broke, last[1], history[:, 2])
        history[:, 4] = np.where(fresh & ~broke, np.maximum(history[:, 4], last[1]), history[:, 4])
        expected = np.maximum(last[1], 1e-3)
        surprise = log(np.maximum(measured, 1e-3)) / scenario.material.wear.time - log(expected)
        history[:, 5] = np.where(fresh & (measured > 0.0), np.clip(surprise, -2.0, 2.0), history[:, 5])
        wear = np.maximum(reading.nominal_wear / scenario.tool.wear_criterion, 1e-3)
        used = exp((log(wear) + self._filter.log_wear_factor) / scenario.material.wear.time)
        law = scenario.edge_failure.temperature
        start = START_SHARE * scenario.machine.cutting_speed_max
        log_wear = log(wear) + self._filter.log_wear_factor
        heat = (
            log(reading.cutting_speed / start) + (law.feed * log(reading.feed / 0.25) + law.wear * log_wear) / law.cutting_speed
        )
        heat = np.where(reading.cutting & (reading.nominal_wear > 0.0), np.maximum(heat, -2.0), -2.0)
        self._worst = np.where(fresh, -2.0, self._worst)
        self._worst[1] = np.maximum(self._worst[1], heat)
        slow = np.floor(reading.cutting_time / 0.5) > np.floor(last[0] / 0.5)
        history[:, 3] = np.where(slow, np.maximum(history[:, 3], self._worst[0]), history[:, 3])
        self._worst[0] = np.where(slow, self._worst[1], self._worst[0])
        last[0], last[1], last[2] = reading.cutting_time, used, heat

    def follow(self, decisions: Array, mask: Any = slice(None)) -> None:
        """Take a guide's decisions, numbers from -1 to 1, shape (num_envs, 2)."""
        speed, life = np.clip(decisions, -1.0, 1.0).T
        self.top_speed[mask] = (START_SHARE * MIDDLE[0] * exp(SPAN[0] * speed))[mask]
        self.change_at[mask] = (MIDDLE[1] + SPAN[1] * life)[mask]

    def act(self, observations: Observations) -> Actions:
        actions = super().act(observations[:, : self._entries])
        self._last[3] = actions[:, 2] > 0.0
        return actions


class Guided(Policy):
    """A guided rule as a policy.

    Args:
        guide: returns decisions, shape (num_envs, 2), for features, shape (num_envs, entries).
        scenarios: nominal models, one for each environment.
    """

    def __init__(self, guide: Callable[[Float32s], Any], scenarios: Sequence[Scenario]) -> None:
        self._guide, self._rule = guide, GuidedRule(scenarios)
        self._steps = np.zeros(len(scenarios), np.int64)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        self._rule.reset(mask)
        self._steps[mask] = 0

    def act(self, observations: Observations) -> Actions:
        features = self._rule.features(observations)
        due = self._steps % HOLD == 0
        if due.any():
            self._rule.follow(np.asarray(self._guide(features), np.float64), due)
        self._steps += 1
        return self._rule.act(observations)
