"""What an interval earned for what was commanded in it, as a differentiable function of the commands.

The tool has to travel the whole way along the bars, and metal is paid by volume: what can be gained is to pay less on the way. So
an agent is taught to travel each stretch at the least

    (time + price of overload x excess + p(D) x life used) per distance,

where p(D) is the price of the edge's life by dynamic programming (``baselines/models/edge_value.py``) in place of the flat one that the
reward charges: both come to the same over a whole edge. In hindsight the true depth, hardness and wear of every stretch are
known, and so is the gradient of its cost with respect to speed and feed, by the machinability models and the drives' lags. The
highest force of an interval is charged the breakage that it makes likely, of an edge that nothing is known of. (Analytic
gradients through a known model: Freeman et al. 2021, arXiv 2106.13281; the flat charge replaced: potential-based shaping, Ng et
al. 1999. The combination is this project's.)
"""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import softplus

from baselines.models.edge_value import USED_LIVES, worth
from train.hindsight import FIELDS
from turning_env import PowerLaw, Scenario
from turning_env.scenario.power_law import log_response

Tensor = torch.Tensor

POINTS = 5
"""Points in time of an interval at which its costs are taken."""
MIN_USED_LIFE = 1e-6
"""Taken for an edge that has not cut [-]: the laws know no unworn edge."""


class Truth:
    """True states at the points of intervals, from what was true at their ends; a field has shape (intervals, lanes, POINTS)."""

    def __init__(
        self,
        scenario: Scenario,
        before: NDArray[np.float64],
        after: NDArray[np.float64],
        changed: NDArray[np.bool_],
        failed: NDArray[np.bool_],
    ) -> None:
        """``before``, ``after``: shape (intervals, len(FIELDS), lanes); the others (intervals, lanes). See ``hindsight.py``."""
        work = scenario.workpiece
        pitch = work.bar_length + work.approach
        place = {name: number for number, name in enumerate(FIELDS)}
        share = (np.arange(POINTS) + 0.5) / POINTS

        def ends(name: str) -> tuple[Any, Any]:
            return before[:, place[name], :, np.newaxis], after[:, place[name], :, np.newaxis]

        start, end = ends("path")
        path = start + (end - start) * share
        bar = np.floor(path / pitch)
        # A field is known at an end that lies in the metal of the same bar, and linear between two that do.
        weights = [
            np.where((depth > 0.0) & (np.floor(at / pitch) == bar), near + 1e-3, 0.0)
            for depth, at, near in zip(ends("depth_of_cut"), (start, end), (1.0 - share, share), strict=True)
        ]
        total = weights[0] + weights[1]
        cutting = (path - pitch * bar >= work.approach) & (total > 0.0) & ~changed[..., np.newaxis]

        def field(name: str, in_air: float) -> Tensor:
            first, last = ends(name)
            mean = np.divide(weights[0] * first + weights[1] * last, total, out=np.full(path.shape, in_air), where=total > 0.0)
            return _tensor(np.log(np.where(cutting, mean, in_air)))

        first, last = ends("used_life")
        last = np.where(changed[..., np.newaxis], first, last)  # of the edge that was in use at the start
        self.log_depth = field("depth_of_cut", work.depth_of_cut)  # [log mm]
        self.log_hardness = field("hardness", 1.0)  # [-]
        self.used_life = _tensor(np.clip(first + (last - first) * share, MIN_USED_LIFE, 1.0))  # [-]
        self.cutting = _tensor(cutting)  # 0 or 1
        self.changed = _tensor(changed)  # 0 or 1, shape (intervals, lanes)
        self.failed = _tensor(failed)  # 0 or 1, likewise


def _tensor(values: Any) -> Tensor:
    return torch.from_numpy(np.asarray(values, np.float32))


class ModelGain:
    """The gain of intervals for the cutting speeds and feeds commanded in them.

    Args:
        scenario: what is played; set by the interval, with removal as its aim.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        material, limits, economics, tool = scenario.material, scenario.limits, scenario.economics, scenario.tool
        interval = scenario.control.interval
        share = torch.arange(POINTS).add(0.5).div(POINTS)
        self._left = [
            (torch.exp(-share * interval / lag), math.exp(-interval / lag)) if lag > 0.0 else (torch.zeros(POINTS), 0.0)
            for lag in (scenario.machine.spindle_time_constant, scenario.machine.feed_time_constant)
        ]
        self._force = _Law(material.thrust_force, math.log(limits.thrust_force))
        self._power = _Law(material.power, math.log(limits.power))
        self._wear = _Law(material.wear, math.log(tool.wear_criterion))
        self._log_criterion, self._life_exponent = math.log(tool.wear_criterion), material.wear.time
        self._log_strength = math.log(tool.edge_strength / limits.thrust_force)
        worths = worth(scenario, economics.overload_price)
        # A job that is finished long before its edge pays for life what is charged for it.
        flat = scenario.workpiece.bars > 0 and scenario.control.edge_changes == "end"
        edge_price = 60.0 * (economics.edge_cost + economics.edge_change_time)
        prices = np.full(len(USED_LIVES), edge_price) if flat else worths.life
        self._time_price = worths.time
        self._prices = torch.tensor(np.concatenate([prices[:1], prices]), dtype=torch.float32)
        self._stop = 60.0 * economics.unplanned_stop * worths.time
        self._edge_price, self._downtime = edge_price, 60.0 * economics.breakage_downtime

    def __call__(self, log_speed: Tensor, log_feed: Tensor, speed: Tensor, feed: Tensor, truth: Truth) -> tuple[Tensor, Tensor]:
        """Of every interval, its gain [s] less what no command could have changed, and what going on with the edge earned [s].

        Both have shape (intervals, lanes); the second has no gradient. An edge that was changed is taken to have met a bar as
        drawn, had it stayed.

        Args:
            log_speed: commanded cutting speed [log m/min], shape (intervals, lanes).
            log_feed: commanded feed [log mm/rev], likewise.
            speed: actual cutting speed at the interval's start [m/min], likewise.
            feed: actual feed at the interval's start [mm/rev], likewise.
            truth: what was true.
        """
        scenario = self._scenario
        speeds, feeds = self._follow(log_speed.exp(), speed, 0), self._follow(log_feed.exp(), feed, 1)
        logs = speeds.log(), feeds.log(), truth.log_depth
        log_wear = self._log_criterion + self._life_exponent * truth.used_life.log()
        log_force = self._force(*logs, log_wear, truth.log_hardness)
        excess = torch.relu(log_force.exp() - 1.0) + torch.relu(self._power(*logs, log_wear, truth.log_hardness).exp() - 1.0)
        life_rate = (self._wear(*logs, 0.0, truth.log_hardness) / self._life_exponent).exp() / 60.0  # [1/s]
        overload = scenario.economics.overload_price * excess
        price = self.price(truth.used_life)
        cost = self._time_price + truth.cutting * (overload + price * life_rate)
        velocity = (speeds * feeds).mean(dim=-1)
        interval = scenario.control.interval
        # The way is as long as it was: who is faster has left it sooner.
        gain: Tensor = -interval * cost.mean(dim=-1) * (velocity.detach() / velocity)
        risk = torch.special.ndtr((log_force - self._log_strength) / max(scenario.tool.edge_strength_spread, 1e-3))
        lost = self._downtime + self._edge_price * (1.0 - truth.used_life)
        gain = gain - (truth.cutting * risk * lost).amax(dim=-1)
        metal = speeds * feeds * truth.log_depth.exp() / scenario.economics.reference_removal_rate
        # While life has a price, metal earns just that beyond what time and overload cost, in the mean over bars.
        earned = torch.where(price > 0.0, price * life_rate, metal - overload - self._time_price)
        going_on = interval * (torch.maximum(truth.cutting, truth.changed.unsqueeze(-1)) * earned).mean(dim=-1)
        return gain, torch.where(truth.failed > 0.0, -self._stop, going_on).detach()

    def of_changing(self, leaning: Tensor, going_on: Tensor) -> Tensor:
        """To be made the most of, so that edges are changed where ``leaning`` is above 0; all of shape (intervals, lanes).

        Who goes on may still change the edge an interval later: it is best changed as soon as an interval more is expected to
        lose, as that never gets better (optimal stopping in the monotone case, Chow and Robbins 1961). What going on earns in an
        interval [s] is seldom known before; a logistic loss weighed by it is least where ``leaning`` has the sign of
        its expectation, reversed.
        """
        return -(torch.relu(going_on) * softplus(leaning) + torch.relu(-going_on) * softplus(-leaning))

    def price(self, used_life: Tensor) -> Tensor:
        """Price p(D) of a whole life [s] at used shares [-] of it."""
        steps = len(self._prices) - 1
        place = used_life.clamp(0.0, 1.0) * steps
        node = place.floor().clamp(max=steps - 1)
        low = node.long()
        return torch.lerp(self._prices[low], self._prices[low + 1], place - node)

    def _follow(self, commanded: Tensor, actual: Tensor, drive: int) -> Tensor:
        """What the drive made of its commands at the points of every interval, shape (intervals, lanes, POINTS).

        ``actual`` is what was measured at the intervals' starts. Its gradient is carried from interval to interval: a command
        counts beyond its own, as far as the drive lags.
        """
        at_points, at_end = self._left[drive]
        carried = torch.zeros_like(actual[0])
        values = []
        for number in range(len(commanded)):
            deviation = actual[number] + carried - commanded[number]
            values.append(commanded[number].unsqueeze(-1) + deviation.unsqueeze(-1) * at_points)
            end = commanded[number] + deviation * at_end
            carried = end - end.detach()
        return torch.stack(values)


class _Law:
    """Logarithm of a response over what it may be, for tensors of logarithms."""

    def __init__(self, law: PowerLaw, log_most: float) -> None:
        # Plain floats: a record of NumPy's would turn tensors into arrays.
        record = law.record()
        self._law = SimpleNamespace(**{name: float(record[name]) for name in record.dtype.names})
        self._law.log_coefficient -= log_most

    def __call__(self, log_speed: Tensor, log_feed: Tensor, log_depth: Tensor, log_wear: Any, log_hardness: Tensor) -> Tensor:
        factors = (log_speed, log_feed, log_depth, 0.0, log_wear, log_hardness)
        response: Tensor = log_response(self._law, *factors)  # type: ignore[no-untyped-call]
        return response
