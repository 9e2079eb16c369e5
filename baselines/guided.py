"""``self_tuning`` with a guide that sets the highest speed and when edges are changed.

The guide is trained on other lathes. A guide, such as a network, sees ``features``: the context of
the job (numbers of the nominal model, and those of the catalogue that the family shows), the belief
of the rule's filter, and the history of the edges before. A decision holds for ``HOLD`` steps; the
rule does the rest.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from baselines.belief import ENTRIES, LIMIT, Belief
from baselines.rule import Array, Mask
from baselines.self_tuning import RULES, SelfTuning
from turning_env import Reading, Scenario, read
from turning_env.numerics.functions import exp, log
from turning_env.policy import Actions, Observations, Policy

HOLD = 30  # steps for which a decision holds
START_SHARE = 0.625
"""Start speed of a material over the machine's highest speed [-], in the families that ship."""

# A decision d in -1..1 allows a highest speed of MIDDLE_SPEED * exp(SPEED_RANGE * d) times the
# start speed, and changes edges at a used life of MIDDLE_LIFE + LIFE_RANGE * d.
MIDDLE_SPEED = 0.8
SPEED_RANGE = 0.6
MIDDLE_LIFE = 0.75
LIFE_RANGE = 0.3

MAX_BROKEN_WEAR = 0.97
"""Wear over the criterion below which an edge that ended without a command was broken [-]."""
MIN_WEAR = 1e-3  # lower bound of wear over the criterion, before its logarithm is taken [-]
INTERVAL = 0.5  # time that an edge must outlive a temperature to have survived it [min]
FEED_SCALE = 0.25  # feed at which the heat counts from the start speed alone [mm/rev]
MAX_SURPRISE = 2.0
NO_HEAT = -2.0  # heat of an edge that has not cut, and lower bound of the others

HISTORY = (
    "edges_broken",  # over 3, at most 1
    "heat_at_breakage",  # of the edge that broke last, see ``GuidedRule._heat``
    "life_at_breakage",  # its used life
    "heat_survived",  # the hottest that an edge has survived
    "life_survived",  # the longest used life of an edge that did not break
    "wear_surprise",  # log ratio of the last edge's used life, as measured, to that expected
)
"""Names of the numbers that describe earlier edges to a guide [-]."""
_HISTORY = np.dtype([(name, np.float64) for name in HISTORY])
_UNKNOWN = np.array((0.0, 1.0, 1.5, NO_HEAT, 0.0, 0.0), _HISTORY)  # at the start

_EDGE = np.dtype(
    [
        ("cutting_time", np.float64),  # at the last reading [min]
        ("log_wear", np.float64),  # expected at the last reading, over the criterion
        ("heat", np.float64),  # at the last reading
        ("max_heat", np.float64),  # of the edge
        ("max_heat_before", np.float64),  # of the edge until the present INTERVAL began
        ("change_commanded", np.bool_),  # at the last reading
    ]
)
"""The rule's memory of the present edge."""
_FRESH = np.array((0.0, 0.0, 0.0, NO_HEAT, NO_HEAT, False), _EDGE)


def feature_space(context: int) -> Box:
    """Return the space of a guide's features for a number of entries of the context."""
    return Box(-LIMIT, LIMIT, (context + len(ENTRIES) + len(HISTORY),), np.float32)


def decision_space() -> Box:
    """Return the space of a guide's decisions: highest speed, and used life at the change."""
    return Box(-1.0, 1.0, (2,), np.float32)


class GuidedRule(SelfTuning):
    """``self_tuning`` in environments with a nominal model each.

    Its filter is that of a ``Belief``, which observes for it.

    Call ``features`` with every observation, before ``act``.

    Args:
        scenarios: nominal model of each environment.
        context: of each environment, shape (num_envs, numbers); None: it follows the entries of the
            observations.
    """

    def __init__(self, scenarios: Sequence[Scenario], context: Observations | None = None) -> None:
        num_envs = len(scenarios)
        parameters: Any = RULES["self_tuning"].fixed
        super().__init__(scenarios, num_envs, **parameters)
        # The belief observes; the rule acts on the same filter.
        self._belief = Belief(scenarios, learns_laws=True)
        self._filter = self._belief.filter
        self._context = context
        self._history = np.zeros(num_envs, _HISTORY)
        self._edge = np.zeros(num_envs, _EDGE)
        self.reset(np.ones(num_envs, np.bool_))

    def reset(self, mask: Mask) -> None:
        super().reset(mask)
        self._history[mask] = _UNKNOWN
        self._edge[mask] = _FRESH
        self.follow(np.zeros((len(mask), 2)), mask)

    def follow(self, decisions: Any, mask: Mask | None = None) -> None:
        """Take a guide's decisions, shape (num_envs, 2), in the environments of a mask or in all.

        They are clipped to -1..1.
        """
        numbers = np.asarray(decisions, np.float64)
        speed, life = np.clip(numbers, -1.0, 1.0).T
        chosen = mask
        if chosen is None:
            chosen = np.ones(len(speed), np.bool_)
        top_speed = START_SHARE * MIDDLE_SPEED * exp(SPEED_RANGE * speed)
        change_at = MIDDLE_LIFE + LIFE_RANGE * life
        np.copyto(self.top_speed, top_speed, where=chosen)
        np.copyto(self.change_at, change_at, where=chosen)

    def features(self, observations: Observations) -> Observations:
        """Return context, belief and history, shape (num_envs, entries)."""
        believed = self._belief.observe(observations)
        entries = self._belief.entries
        without_context = observations[:, :entries]
        reading = read(without_context, self._scenario)
        fresh = reading.cutting_time < self._edge["cutting_time"]
        self._remember_removed_edge(reading, fresh)
        self._remember_heat(reading, fresh)

        columns = [self._history[name] for name in HISTORY]
        history = np.stack(columns, axis=1)
        history = np.clip(history, -LIMIT, LIMIT).astype(np.float32)
        context = self._context
        if context is None:
            context = observations[:, entries:]
        return np.concatenate([context, believed, history], axis=1)

    def act(self, observations: Observations) -> Actions:
        without_context = observations[:, : self._belief.entries]
        actions = super().act(without_context)
        # There is no third action if edges are changed without a command.
        edge_actions = actions[:, 2:]
        self._edge["change_commanded"] = edge_actions.max(axis=1, initial=-1.0) > 0.0
        return actions

    def _observe(self, reading: Reading) -> None:
        """Do nothing: ``features`` observes."""

    def _remember_removed_edge(self, reading: Reading, fresh: Mask) -> None:
        """Note the end of the last edge where a fresh one has been put in."""
        edge = self._edge
        history = self._history
        law = self._scenario.edge_failure.temperature
        wear_exponent = self._scenario.material.wear.time
        measured = reading.removed_wear / self._scenario.tool.wear_criterion
        is_measured = measured > 0.0
        log_measured = log(np.maximum(measured, MIN_WEAR))
        # Where removed edges are not measured, the expected wear stands for the true one.
        surprise = np.where(is_measured, log_measured - edge["log_wear"], 0.0)
        log_wear = edge["log_wear"] + surprise
        # Wear grows as W_max D^n, so the used life is D = (W / W_max)^(1/n).
        used_life = exp(log_wear / wear_exponent)
        # An edge that nobody changed has broken, unless it was worn out.
        ended_early = exp(log_wear) < MAX_BROKEN_WEAR
        broke = fresh & ~edge["change_commanded"] & ended_early
        survived = fresh & ~broke

        # The heat was computed with the expected wear; the measured wear corrects it.
        heat = edge["heat"] + law.wear / law.cutting_speed * surprise
        # Broken edges are counted in thirds, so that the number is of order one.
        edges_broken = history["edges_broken"] + broke / 3.0
        history["edges_broken"] = np.minimum(edges_broken, 1.0)
        np.copyto(history["heat_at_breakage"], heat, where=broke)
        np.copyto(history["life_at_breakage"], used_life, where=broke)
        longest = np.maximum(history["life_survived"], used_life)
        np.copyto(history["life_survived"], longest, where=survived)
        life_surprise = surprise / wear_exponent
        clipped_surprise = np.clip(life_surprise, -MAX_SURPRISE, MAX_SURPRISE)
        np.copyto(history["wear_surprise"], clipped_surprise, where=fresh & is_measured)

    def _remember_heat(self, reading: Reading, fresh: Mask) -> None:
        """Note how hot the present edge is, and what it has survived.

        An edge has survived a heat if it still cuts when the next ``INTERVAL`` begins.
        """
        edge = self._edge
        history = self._history
        log_wear, heat = self._heat(reading)
        edge["max_heat_before"][fresh] = NO_HEAT
        edge["max_heat"][fresh] = NO_HEAT
        edge["max_heat"] = np.maximum(edge["max_heat"], heat)
        interval = np.floor(reading.cutting_time / INTERVAL)
        later = interval > np.floor(edge["cutting_time"] / INTERVAL)
        survived = np.maximum(history["heat_survived"], edge["max_heat_before"])
        np.copyto(history["heat_survived"], survived, where=later)
        np.copyto(edge["max_heat_before"], edge["max_heat"], where=later)
        edge["cutting_time"] = reading.cutting_time
        edge["log_wear"] = log_wear
        edge["heat"] = heat

    def _heat(self, reading: Reading) -> tuple[Array, Array]:
        """Return the expected log wear over the criterion, and the heat.

        The heat is the log speed over the start speed at which a worn-out edge, at the feed
        ``FEED_SCALE``, is as hot.
        """
        scenario = self._scenario
        law = scenario.edge_failure.temperature
        nominal_wear = reading.nominal_wear / scenario.tool.wear_criterion
        log_nominal_wear = log(np.maximum(nominal_wear, MIN_WEAR))
        log_wear = log_nominal_wear + self._filter.log_wear_factor

        start_speed = START_SHARE * scenario.machine.cutting_speed_max
        by_speed = log(reading.cutting_speed / start_speed)
        by_feed = law.feed * log(reading.feed / FEED_SCALE)
        by_wear = law.wear * log_wear
        heat = by_speed + (by_feed + by_wear) / law.cutting_speed
        hot = reading.cutting & (reading.nominal_wear > 0.0)
        return log_wear, np.where(hot, np.maximum(heat, NO_HEAT), NO_HEAT)


class GuidedPolicy(Policy):
    """A guided rule as a policy.

    Its ``guide`` is a policy that is shown features, and whose actions are decisions.
    """

    def __init__(
        self, guide: Policy, scenarios: Sequence[Scenario], context: Observations | None = None
    ) -> None:
        self._guide = guide
        self._rule = GuidedRule(scenarios, context)
        self._steps = np.zeros(len(scenarios), np.int64)

    def reset(self, mask: Mask) -> None:
        self._guide.reset(mask)
        self._rule.reset(mask)
        self._steps[mask] = 0

    def act(self, observations: Observations) -> Actions:
        features = self._rule.features(observations)
        due = self._steps % HOLD == 0
        if due.any():
            self._rule.follow(self._guide.act(features), due)
        self._steps += 1
        return self._rule.act(observations)
