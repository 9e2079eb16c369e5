"""The network of the agent for all lathes of a family: the GRU of ``train/analytic_actor.py``, beside a tracker of the bar.

The nominal model's context in the observation tells the tracker how long a bar takes, so it needs no scenario.
"""

import math
from collections.abc import Sequence
from typing import Any

import torch

from train.analytic_actor import ACTUAL, MAX_TIME, GruActor
from turning_env import Scenario
from turning_env.physics.quantities import OBS, layout
from turning_env.scenario.plan import MIDDLE, USED_LIVES

Tensor = torch.Tensor

BEST = f"speed_at_{USED_LIVES[MIDDLE]}", f"feed_at_{USED_LIVES[MIDDLE]}"
"""Numbers of the context: the nominal model's best speed and feed over the lowest ones, as logarithms."""
BAR_TIME = "log_bar_time"
"""Number of the context: the logarithm of a bar's time [s] at these."""


class BarTracker:
    """A tracker of the tool's position along the bar, for bars of any length and diameter.

    The travelled share of the bar is the sum of speed times feed over the steps since the tool entered the metal, by the
    trapezoidal rule. The state, shape (num_envs, 2), is 0 before an episode's first observation. Its columns are that share, and
    the travel per second at the last observation [1/s].

    Args:
        scenario: a job of the family, of which every job has the ranges' ratios and the interval.
        names: names of the context's numbers.
        mean: means by which they are standardised.
        spread: spreads likewise.
    """

    STATES = 2
    READINGS = 2

    def __init__(self, scenario: Scenario, names: Sequence[str], mean: Sequence[float], spread: Sequence[float]) -> None:
        machine = scenario.machine
        ends = (machine.cutting_speed_min, machine.cutting_speed_max), (machine.feed_min, machine.feed_max)
        self._spans = [math.log(high / low) for low, high in ends]
        self._interval = scenario.control.interval
        places, first = [list(names).index(name) for name in (BAR_TIME, *BEST)], len(layout(scenario))
        self._scales = [(first + place, float(mean[place]), float(spread[place])) for place in places]

    def __call__(self, observation: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Return readings of order one, shape (num_envs, READINGS), and the next state; see ``DistanceTracker``."""
        along, before = state.unbind(dim=-1)
        log_bar_time, *best = (observation[..., place] * spread + mean for place, mean, spread in self._scales)
        log_rate = -log_bar_time
        for position, span, log_best in zip(observation[..., ACTUAL].unbind(dim=-1), self._spans, best, strict=True):
            log_rate = log_rate + 0.5 * (position + 1.0) * span - log_best
        rate = torch.exp(log_rate)
        # The tool has entered within the step: take half of it.
        travel = self._interval * 0.5 * (rate + torch.where(along > 0.0, before, 0.0))
        along = along + travel
        along = torch.where(along > 1.0, (along - 1.0).clamp(min=1e-3), along)  # the way in air took less than a step
        along = torch.where(observation[..., OBS.cutting] > 0.5, along, 0.0)
        left = (1.0 - along) / rate
        readings = torch.stack([2.0 * along - 1.0, 2.0 * left.clamp(max=MAX_TIME) / MAX_TIME - 1.0], dim=-1)
        return readings, torch.stack([along, rate], dim=-1)


def family_actor(scenario: Scenario, context: dict[str, Any], cells: int, width: int) -> GruActor:
    """Return an untrained agent for observations with a context.

    Args:
        scenario: a job of the family.
        context: ``names``, ``mean`` and ``spread`` of the context's numbers, and others that are not read.
        cells: size of the memory.
        width: size of the layers around it.
    """
    tracker = BarTracker(scenario, context["names"], context["mean"], context["spread"])
    return GruActor(scenario, len(layout(scenario)) + len(context["names"]), cells, width, tracker)
