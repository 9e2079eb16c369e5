"""The network of the agent for all lathes of a family: the GRU of ``train/analytic_actor.py``, beside a tracker of the job.

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
MEAN_OVER = 1000.0
"""Steps in metal over which measured and predicted force and power are compared."""
SETTLED = 60.0
"""Steps in metal after which an edge's means count half."""
_HIGHEST = 5.0  # deviation of a ratio of 2; readings at the entry into metal are no measure of the material


class JobTracker:
    """A tracker of the tool's position along the bar, and of what the job has shown of its lathe, material and inserts.

    The travelled share of the bar is the sum of speed times feed over the steps since the tool entered the metal, by the
    trapezoidal rule. Gradients reach over a rollout only, so what took longer to see is averaged here: measured over predicted
    force and power in metal, of the job and of the present edge, and at every change of the edge the logarithm of measured over
    predicted wear.

    The state, shape (num_envs, STATES), is 0 before an episode's first observation. Its columns are the bar's share, the
    travel per second at the last observation [1/s], its nominal wear over the criterion, the number of changes and the sum of
    their logarithms; and of the job and of the edge, the number of steps in metal and the mean deviations of force and power.

    Args:
        scenario: a job of the family, of which every job has the ranges' ratios and the interval.
        names: names of the context's numbers.
        mean: means by which they are standardised.
        spread: spreads likewise.
    """

    STATES = 11
    READINGS = 8

    def __init__(self, scenario: Scenario, names: Sequence[str], mean: Sequence[float], spread: Sequence[float]) -> None:
        machine = scenario.machine
        ends = (machine.cutting_speed_min, machine.cutting_speed_max), (machine.feed_min, machine.feed_max)
        self._spans = [math.log(high / low) for low, high in ends]
        self._interval = scenario.control.interval
        entries = layout(scenario)
        places, first = [list(names).index(name) for name in (BAR_TIME, *BEST)], len(entries)
        self._scales = [(first + place, float(mean[place]), float(spread[place])) for place in places]
        self._removed = entries.index("removed_wear") if "removed_wear" in entries else None

    def __call__(self, observation: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Return readings of order one, shape (num_envs, READINGS), and the next state.

        The first two are those of ``DistanceTracker``. Then follow the mean logarithm of measured over predicted wear, drawn
        towards 0 while there are few, their number, the job's mean deviations of force and power, and by how much those of the
        edge differ from them.
        """
        along, before, worn, changes, logs, *means = state.unbind(dim=-1)
        log_bar_time, *best = (observation[..., place] * spread + mean for place, mean, spread in self._scales)
        log_rate = -log_bar_time
        for position, span, log_best in zip(observation[..., ACTUAL].unbind(dim=-1), self._spans, best, strict=True):
            log_rate = log_rate + 0.5 * (position + 1.0) * span - log_best
        rate = torch.exp(log_rate)
        # The tool has entered within the step: take half of it.
        travel = self._interval * 0.5 * (rate + torch.where(along > 0.0, before, 0.0))
        along = along + travel
        along = torch.where(along > 1.0, (along - 1.0).clamp(min=1e-3), along)  # the way in air took less than a step
        cutting = observation[..., OBS.cutting]
        along = torch.where(cutting > 0.5, along, 0.0)
        left = (1.0 - along) / rate

        wear = observation[..., OBS.nominal_wear]
        if self._removed is not None:
            removed = observation[..., self._removed]
            inspected = ((wear < worn) & (removed > 0.0)).to(wear.dtype)
            changes = changes + inspected
            logs = logs + inspected * torch.log(removed.clamp(min=1e-3) / worn.clamp(min=1e-3)).clamp(-1.5, 1.5)
        deviations = [observation[..., entry].clamp(max=_HIGHEST) for entry in (OBS.force_ratio, OBS.power_ratio)]
        same_edge = (wear >= worn).to(wear.dtype)
        job = _averaged(means[:3], cutting, deviations)
        edge = _averaged([mean * same_edge for mean in means[3:]], cutting, deviations)
        place = 2.0 * along - 1.0, 2.0 * left.clamp(max=MAX_TIME) / MAX_TIME - 1.0
        shown = edge[0] / (edge[0] + SETTLED)
        differ = [shown * (mine - its) for mine, its in zip(edge[1:], job[1:], strict=True)]
        readings = *place, 4.0 * logs / (changes + 0.3), 0.5 * changes, *job[1:], *differ
        return torch.stack(readings, dim=-1), torch.stack([along, rate, wear, changes, logs, *job, *edge], dim=-1)


def _averaged(means: Sequence[Tensor], weight: Tensor, values: Sequence[Tensor]) -> list[Tensor]:
    """Return (count, means) after values with a weight of 0 or 1."""
    count = means[0] + weight
    share = weight / count.clamp(min=1.0, max=MEAN_OVER)
    return [count, *(mean + share * (value - mean) for mean, value in zip(means[1:], values, strict=True))]


def family_actor(scenario: Scenario, context: dict[str, Any], cells: int, width: int) -> GruActor:
    """Return an untrained agent for observations with a context.

    Args:
        scenario: a job of the family.
        context: ``names``, ``mean`` and ``spread`` of the context's numbers, and others that are not read.
        cells: size of the memory.
        width: size of the layers around it.
    """
    tracker = JobTracker(scenario, context["names"], context["mean"], context["spread"])
    return GruActor(scenario, len(layout(scenario)) + len(context["names"]), cells, width, tracker)
