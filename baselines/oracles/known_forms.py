"""``self_tuning`` that knows the forms of a lathe: what they are worth to a rule.

Its nominal models have the true forms (``models/schedule.py`` names their fields). A schedule by
the nominal laws and these forms sets the highest speed and the used life at which edges are
changed, as in ``predictive``. This file adds a speed below which edges build up. A lathe without
a form is played as if nothing were known. Feeds that tangle chips are outside the range of feeds of
such a nominal model.

It is no policy to compare with, because no control knows the forms.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from baselines.predictive import SPEED_MARGIN
from baselines.rule import Array
from baselines.self_tuning import SelfTuning
from turning_env import Scenario
from turning_env.numerics.functions import exp, log

VERSION = 1  # raised when its actions change
MIN_FORM = 1e-6  # size below which a form is none [-]
BUILT_UP_WEAR = 0.5
"""Rate of wear by built-up edges over the usual one from which a speed is too low [-]
(assumption)."""


class KnownForms(SelfTuning):
    """``SelfTuning`` by nominal models with the true forms.

    Args:
        scenario: nominal model of each environment, with the true forms.
        num_envs: number of environments.
        others: as for ``SelfTuning``.
    """

    def __init__(self, scenario: Sequence[Scenario], num_envs: int, **others: float) -> None:
        super().__init__(scenario, num_envs, **others)
        self._fails = np.array([edges_fail(model) for model in self._scenarios])
        self._lowest = np.array([lowest_speed(model) for model in self._scenarios])
        self._change_at[~self._fails] = np.inf

    def _min_speed(self, used_life: Array) -> Any:
        scheduled = self._max_speed(used_life) / SPEED_MARGIN**2
        return np.minimum(self._lowest, scheduled)

    def _max_speed(self, used_life: Array) -> Any:
        scheduled = super()._max_speed(used_life)
        return np.where(self._fails, scheduled, self._scenario.cutting_speed_max)


def edges_fail(scenario: Scenario) -> bool:
    """Return whether edges build up, notch, chip or collapse, or the bar chatters."""
    failure = scenario.edge_failure
    sizes = (failure.built_up_edge, failure.notch_growth, failure.chipping_rate)
    return max(*sizes, scenario.machine.chatter) > MIN_FORM or collapses(scenario)


def collapses(scenario: Scenario) -> bool:
    """Return whether a worn-out edge can collapse in the machine's range."""
    failure = scenario.edge_failure
    if failure.collapse_temperature <= 0.0:
        return False
    _, max_feed = scenario.feed_range
    hottest = failure.temperature(
        scenario.cutting_speed_max,
        max_feed,
        scenario.workpiece.depth_of_cut,
        wear=scenario.tool.wear_criterion,
    )
    return bool(hottest > failure.collapse_temperature)


def lowest_speed(scenario: Scenario) -> float:
    """Return the speed from which edges hardly build up [m/min], or the machine's lowest.

    It solves b exp(-(log(v / v_b) / s)^2) = ``BUILT_UP_WEAR`` for a speed v above v_b
    (``physics/wear.py``).
    """
    failure = scenario.edge_failure
    relative_size = failure.built_up_edge / BUILT_UP_WEAR
    if relative_size <= 1.0:
        return float(scenario.machine.cutting_speed_min)
    distance = failure.built_up_width * np.sqrt(log(relative_size))
    return float(failure.built_up_speed * exp(distance))
