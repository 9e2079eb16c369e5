"""``self_tuning`` with a guide, trained on other lathes, which sets the highest speed and when edges are changed.

A guide, such as a network, sees ``features``: the context of the job (numbers of the nominal model, and those of the catalogue
that the family shows), what the rule's filter believes, and what became of the edges before. A decision holds for ``HOLD``
steps; the rule does the rest. ``contextual`` sets a highest speed once, by a regression on the catalogue's numbers.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from baselines.belief import ENTRIES, LIMIT, Belief
from baselines.rule import Mask
from baselines.self_tuning import RULES, SelfTuning
from turning_env import Reading, Scenario, read
from turning_env.numerics.functions import exp, log
from turning_env.scoring.policy import Actions, Observations, Policy

HOLD = 30  # steps for which a decision holds
START_SHARE = 0.625  # start speed of a material over the machine's highest speed [-], in the families that ship
SPEED, LIFE = (0.8, 0.6), (0.75, 0.3)
"""A decision of 0 allows 0.8 times the start speed and changes edges at a used life of 0.75; one of 1 allows exp(0.6) times as
much speed, and 0.3 more life."""
WORN = 0.97  # wear over the criterion below which an edge that ended unasked broke [-]
INTERVAL = 0.5  # time that an edge must outlive a temperature to have borne it [min]
UNKNOWN = (0.0, 1.0, 1.5, -2.0, 0.0, 0.0)  # values of ``HISTORY`` at the start
HISTORY = (
    "edges_broken",  # over 3, at most 1
    "heat_at_breakage",  # of the edge that broke last: log speed over the start speed at which a worn-out edge is as hot
    "life_at_breakage",  # its used life
    "heat_survived",  # the hottest that an edge has outlived, likewise
    "life_survived",  # the longest used life of an edge that did not break
    "wear_surprise",  # log ratio of the used life of the last edge, by its measured wear, to the one expected
)
"""Names of the numbers that describe the edges before to a guide [-]."""


def feature_space(context: int) -> Box:
    """Return the space of a guide's features for a number of entries of the context."""
    return Box(-LIMIT, LIMIT, (context + len(ENTRIES) + len(HISTORY),), np.float32)


def decision_space() -> Box:
    """Return the space of a guide's decisions: highest speed, and used life at which edges are changed."""
    return Box(-1.0, 1.0, (2,), np.float32)


class GuidedRule(SelfTuning):
    """``self_tuning`` in environments with a nominal model each; its filter is that of a ``Belief``, which observes for it.

    Call ``features`` with every observation, before ``act``. ``context``: of each, shape (num_envs, numbers); None: it follows
    the entries of the observations.
    """

    def __init__(self, scenarios: Sequence[Scenario], context: Observations | None = None) -> None:
        parameters: Any = RULES["self_tuning"].fixed
        super().__init__(scenarios, len(scenarios), **parameters)
        self._belief = Belief(scenarios, learns_laws=True)
        self._filter = self._belief.filter
        self._context = context
        self._history = np.zeros((len(scenarios), len(HISTORY)))
        self._last = np.zeros(
            (4, len(scenarios))
        )  # cutting time [min], log wear, heat, and whether the edge was to be changed
        self._heat = np.zeros(
            (2, len(scenarios))
        )  # hottest of the present edge: before the present interval, and in all
        self.reset(np.ones(len(scenarios), np.bool_))

    def reset(self, mask: Mask) -> None:
        super().reset(mask)
        self._history[mask] = UNKNOWN
        self._last[:, mask] = 0.0
        self._heat[:, mask] = UNKNOWN[3]
        self.follow(np.zeros((len(mask), 2)), mask)

    def follow(self, decisions: Any, mask: Mask | None = None) -> None:
        """Take a guide's decisions, limited to -1..1, shape (num_envs, 2), in the environments of a mask or in all."""
        speed, life = np.clip(np.asarray(decisions, np.float64), -1.0, 1.0).T
        np.copyto(
            self.top_speed,
            START_SHARE * SPEED[0] * exp(SPEED[1] * speed),
            where=True if mask is None else mask,
        )
        np.copyto(self.change_at, LIFE[0] + LIFE[1] * life, where=True if mask is None else mask)

    def features(self, observations: Observations) -> Observations:
        """Return context, belief and history, shape (num_envs, entries)."""
        believed = self._belief.observe(observations)
        self._remember(read(observations[:, : self._belief.entries], self._scenario))
        history = np.clip(self._history, -LIMIT, LIMIT).astype(np.float32)
        context = (
            observations[:, self._belief.entries :] if self._context is None else self._context
        )
        return np.concatenate([context, believed, history], axis=1)

    def act(self, observations: Observations) -> Actions:
        actions = super().act(observations[:, : self._belief.entries])
        self._last[3] = (
            actions[:, 2:].max(axis=1, initial=-1.0) > 0.0
        )  # there is no third one if edges are changed unasked
        return actions

    def _observe(self, reading: Reading) -> None:
        """Leave it to ``features``."""

    def _remember(self, reading: Reading) -> None:
        """Bring the history up to date."""
        scenario, history, (time, log_wear, heat, asked) = (
            self._scenario,
            self._history.T,
            self._last,
        )
        law, exponent = scenario.edge_failure.temperature, scenario.material.wear.time
        fresh, measured = (
            reading.cutting_time < time,
            reading.removed_wear / scenario.tool.wear_criterion,
        )
        surprise = np.where(measured > 0.0, log(np.maximum(measured, 1e-3)) - log_wear, 0.0)
        end = log_wear + surprise  # an estimate where removed edges are not measured
        used, broke = exp(end / exponent), fresh & (asked == 0.0) & (exp(end) < WORN)
        history[0] = np.minimum(history[0] + broke / 3.0, 1.0)
        history[1] = np.where(broke, heat + law.wear / law.cutting_speed * surprise, history[1])
        history[2] = np.where(broke, used, history[2])
        history[4] = np.where(fresh & ~broke, np.maximum(history[4], used), history[4])
        history[5] = np.where(
            fresh & (measured > 0.0), np.clip(surprise / exponent, -2.0, 2.0), history[5]
        )

        log_wear = (
            log(np.maximum(reading.nominal_wear / scenario.tool.wear_criterion, 1e-3))
            + self._filter.log_wear_factor
        )
        start = START_SHARE * scenario.machine.cutting_speed_max
        now = (
            log(reading.cutting_speed / start)
            + (law.feed * log(reading.feed / 0.25) + law.wear * log_wear) / law.cutting_speed
        )
        now = np.where(
            reading.cutting & (reading.nominal_wear > 0.0), np.maximum(now, UNKNOWN[3]), UNKNOWN[3]
        )
        self._heat[:, fresh] = UNKNOWN[3]
        self._heat[1] = np.maximum(self._heat[1], now)
        later = np.floor(reading.cutting_time / INTERVAL) > np.floor(time / INTERVAL)
        history[3] = np.where(later, np.maximum(history[3], self._heat[0]), history[3])
        self._heat[0] = np.where(later, self._heat[1], self._heat[0])
        self._last[:3] = reading.cutting_time, log_wear, now


class GuidedPolicy(Policy):
    """A guided rule as a policy; its ``guide`` is a policy that is shown features, and whose actions are decisions."""

    def __init__(
        self, guide: Policy, scenarios: Sequence[Scenario], context: Observations | None = None
    ) -> None:
        self._guide, self._rule = guide, GuidedRule(scenarios, context)
        self._steps = np.zeros(len(scenarios), np.int64)

    def reset(self, mask: Mask) -> None:
        self._guide.reset(mask)
        self._rule.reset(mask)
        self._steps[mask] = 0

    def act(self, observations: Observations) -> Actions:
        features = self._rule.features(observations)
        if (due := self._steps % HOLD == 0).any():
            self._rule.follow(self._guide.act(features), due)
        self._steps += 1
        return self._rule.act(observations)
