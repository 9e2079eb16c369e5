"""``self_tuning`` that reacts to what becomes of its edges.

It knows no form beside the laws, but changes its limits by what the observations tell:

* After a broken edge, it lowers the highest speed, and changes edges before the used life at which
  that one broke.
* After an edge that wore much faster than the nominal model says, as built-up edges do at low
  speeds, it raises the highest speed, and no longer cuts slowly.
* After another edge, it raises the highest speed a little.
* After stops for tangled chips, it moves the window of feeds (``models/chip_window.py``).

Two rules of the catalogue play it, where stops for tangled chips are counted. ``chip_window``
moves the window of feeds alone. ``reactive`` also reacts to its edges, with the numbers that were
best on the family ``unmodelled``.

Uses from the nominal model what ``self_tuning`` uses, and the chip breaker's window of feeds.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from baselines.models.chip_window import ChipWindow
from baselines.rule import Array, Mask, Scenarios
from baselines.self_tuning import RULES as SELF_TUNING_RULES
from baselines.self_tuning import SelfTuning
from turning_env import Reading, Scenario
from turning_env.numerics.functions import exp, log
from turning_env.policy import Actions, Observations
from turning_env.scenario.laws import used_life_at

START_SHARE = 0.625
"""Start speed of a material over the machine's highest speed [-], in the families that ship."""
MAX_BROKEN_WEAR = 0.97
"""Wear over the criterion below which an edge that ended without a command was broken [-]."""
MIN_LOG_SPEED = -1.0  # lowest log of the highest speed over the start speed [-]
MAX_LOG_SPEED = 0.47  # likewise the highest: the machine's
MIN_CHANGE_AT = 0.1  # lowest used life at which edges are changed [-]
MIN_WEAR = 1e-3  # lower bound of wear over the criterion, before its logarithm is taken [-]


class Reactions(NamedTuple):
    """The numbers of the rule [-]: one for all environments, or one for each.

    Speeds are logarithms over the start speed of the material.
    """

    speed: Any
    """Highest speed at the start."""
    change_at: Any
    """Used life at which edges are changed at the start."""
    slower: Any
    """Fall of the highest speed after a broken edge."""
    sooner: Any
    """Used life at which edges are changed, over that of a broken edge."""
    fast_wear: Any
    """Log used life over the nominal one from which an edge wore fast."""
    faster: Any
    """Rise of the highest speed after an edge that wore fast."""
    bolder: Any
    """Rise of the highest speed after another edge."""
    span: Any
    """Distance of the lowest speed from the highest, once an edge wore fast."""


WINDOW_ALONE = Reactions(
    speed=-0.33,
    change_at=0.8,
    slower=0.0,
    sooner=np.inf,
    fast_wear=np.inf,
    faster=0.0,
    bolder=0.0,
    span=0.0,
)
"""Only the window of feeds reacts; the other numbers are the best constants on training jobs of
``unmodelled``."""
TUNED = WINDOW_ALONE._replace(speed=-0.43, slower=0.05, bolder=0.05)
"""The best of 16 sets of numbers on training jobs of ``unmodelled``
(``research/studies/unmodelled_reactions.py``)."""


class Reactive(SelfTuning):
    """``SelfTuning`` with limits that depend on the edges before.

    Args:
        scenario: nominal model, or one for each environment.
        num_envs: number of environments.
        reactions: the numbers of the rule.
        others: as for ``SelfTuning``.
    """

    def __init__(
        self, scenario: Scenarios, num_envs: int, reactions: Reactions, **others: float
    ) -> None:
        super().__init__(scenario, num_envs, **others)
        self._reactions = reactions
        self._window = ChipWindow(self._scenario, num_envs)
        self._log_speed = np.empty(num_envs)
        self._wears_fast = np.empty(num_envs, np.bool_)
        self._nominal_life = np.empty(num_envs)  # of the present edge, at the last reading
        self._cutting_time = np.empty(num_envs)  # likewise [min]
        self._change_commanded = np.empty(num_envs, np.bool_)
        self.reset(np.ones(num_envs, np.bool_))

    def reset(self, mask: Mask) -> None:
        super().reset(mask)
        self._window.reset(mask)
        np.copyto(self._log_speed, self._reactions.speed, where=mask)
        np.copyto(self.change_at, self._reactions.change_at, where=mask)
        self._wears_fast[mask] = False
        self._nominal_life[mask] = 0.0
        self._cutting_time[mask] = 0.0
        self._change_commanded[mask] = False

    def act(self, observations: Observations) -> Actions:
        actions = super().act(observations)
        # There is no third action if edges are changed without a command.
        self._change_commanded = actions[:, 2:].max(axis=1, initial=-1.0) > 0.0
        return actions

    def _observe(self, reading: Reading) -> None:
        super()._observe(reading)
        self._window.observe(reading)
        scenario = self._scenario
        criterion = scenario.tool.wear_criterion
        # A fresh edge begins its cutting time at 0; the one before it has just been inspected.
        fresh = reading.cutting_time < self._cutting_time
        if fresh.any():
            removed_wear = np.maximum(reading.removed_wear, MIN_WEAR * criterion)
            self._react(fresh, removed_wear / criterion, used_life_at(scenario, removed_wear))
        self._cutting_time = reading.cutting_time
        self._nominal_life = used_life_at(scenario, reading.nominal_wear)

    def _react(self, fresh: Mask, wear: Array, used_life: Array) -> None:
        """Change the limits where an edge has been replaced.

        Args:
            fresh: these environments.
            wear: of the removed edges over the criterion [-].
            used_life: of the removed edges [-].
        """
        reactions = self._reactions
        broke = fresh & ~self._change_commanded & (wear < MAX_BROKEN_WEAR)
        nominal_life = np.maximum(self._nominal_life, MIN_WEAR)
        wore_fast = fresh & (log(used_life / nominal_life) > reactions.fast_wear)
        self._wears_fast |= wore_fast

        change = np.where(wore_fast, reactions.faster, reactions.bolder)
        change = np.where(broke, -reactions.slower, change)
        log_speed = np.clip(self._log_speed + change, MIN_LOG_SPEED, MAX_LOG_SPEED)
        np.copyto(self._log_speed, log_speed, where=fresh)
        sooner = np.maximum(reactions.sooner * used_life, MIN_CHANGE_AT)
        np.copyto(self.change_at, np.minimum(self.change_at, sooner), where=broke)

    def _max_speed(self, used_life: Array) -> Any:
        self.top_speed = START_SHARE * exp(self._log_speed)
        lowest = self._scenario.machine.cutting_speed_min
        return np.maximum(super()._max_speed(used_life), lowest)

    def _min_speed(self, used_life: Array) -> Any:
        lowest = self._scenario.machine.cutting_speed_min
        close = self._max_speed(used_life) * exp(-np.asarray(self._reactions.span))
        return np.where(self._wears_fast, np.maximum(close, lowest), lowest)

    def _feed_range(self) -> tuple[Any, Any]:
        return self._window.feed_range()


def chip_window(
    scenario: Scenarios, num_envs: int, speed: float, change_at: float, **others: float
) -> Reactive:
    """Return ``Reactive`` of which only the window of feeds reacts; see ``Reactions``."""
    reactions = WINDOW_ALONE._replace(speed=speed, change_at=change_at)
    return Reactive(scenario, num_envs, reactions, **others)


def reactive(
    scenario: Scenarios,
    num_envs: int,
    speed: float,
    change_at: float,
    slower: float,
    bolder: float,
    **others: float,
) -> Reactive:
    """Return ``Reactive`` that also changes its highest speed after every edge.

    ``Reactions`` explains the numbers.
    """
    reactions = WINDOW_ALONE._replace(
        speed=speed, change_at=change_at, slower=slower, bolder=bolder
    )
    return Reactive(scenario, num_envs, reactions, **others)


_SELF_TUNING = SELF_TUNING_RULES["self_tuning"]


def _plays(scenario: Scenario) -> bool:
    return _SELF_TUNING.plays(scenario) and scenario.sensors.counts_tangles


RULES = {
    "chip_window": replace(
        _SELF_TUNING,
        description="self_tuning with a constant highest speed, which moves its window of feeds by "
        "the stops for tangled chips",
        controller=chip_window,
        plays=_plays,
        parameters={
            **_SELF_TUNING.parameters,
            "speed": WINDOW_ALONE.speed,
            "change_at": WINDOW_ALONE.change_at,
        },
        version=1,
    ),
    "reactive": replace(
        _SELF_TUNING,
        description="chip_window that also lowers its highest speed after a broken edge, and "
        "raises it after another",
        controller=reactive,
        plays=_plays,
        parameters={
            **_SELF_TUNING.parameters,
            "speed": TUNED.speed,
            "change_at": TUNED.change_at,
            "slower": TUNED.slower,
            "bolder": TUNED.bolder,
        },
        version=1,
    ),
}
