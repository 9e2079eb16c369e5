"""The teacher of the analytic-gradient agent: the gain of a step as a differentiable function of its commands.

The tool must travel all bars, and metal is paid by volume. So an agent can only gain by reducing its cost per distance:

    (time + price of overload * excess + p(D) * life used) / distance,

where p(D) is the price of the edge's life by dynamic programming (``baselines/models/edge_value.py``). It replaces the flat price
in the reward; over a whole edge, the two differ by a constant. After a step, the simulator reveals the hidden depth, hardness and
wear to the teacher (``HindsightVecEnv``). Machinability models and the drives' lags then give the gradient of the step's cost
with respect to speed and feed. A force above all that the edge has borne is charged the expected cost of breaking an edge of
unknown strength.
(Analytic gradients through a known model: Freeman et al. 2021, arXiv 2106.13281; the replaced flat charge: potential-based
shaping, Ng et al. 1999. The combination is this project's.)
"""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import softplus

from baselines.optimiser import USED_LIVES, Worth, worth
from turning_env import Scenario
from turning_env.scenario.power_law import POWER_LAW_RECORD, PowerLaw, log_response

Tensor = torch.Tensor
Array = NDArray[np.float64]

FIELDS = ("path", "depth_of_cut", "hardness", "used_life", "thrust_force")
"""Hidden quantities at the start and the end of every step, in the units of ``info``; depth, hardness and force are 0 in air. The
force is the highest one at the end of a step of the same edge."""
USED_LIFE, FORCE = FIELDS.index("used_life"), FIELDS.index("thrust_force")
POINTS = 5  # number of points in time at which a step's costs are evaluated
WINDOW_EDGE = 0.05
"""Logarithm of the feed beyond the chip breaker's window at which the teacher charges the full cost of tangled chips. The cost is
a step there, so its gradient is 0; this line has one."""
MIN_LOAD = 1e-3  # smallest force over its limit, and probability to survive [-]
MIN_USED_LIFE = 1e-6  # used life of a fresh edge [-]: the laws are not defined at 0


class Truth:
    """Interpolated hidden states at ``POINTS`` points of each step; fields have shape (steps, num_envs, POINTS)."""

    def __init__(
        self,
        scenario: Scenario,
        before: Array,
        after: Array,
        changed: NDArray[np.bool_],
        failed: NDArray[np.bool_],
    ) -> None:
        """Interpolate the records of a ``HindsightVecEnv`` of the scenario.

        ``before`` and ``after`` are ``FIELDS`` at the starts and ends of steps, shape (steps, len(FIELDS), num_envs). The edge
        was changed where ``changed``, because it was worn out or broken where also ``failed``, shape (steps, num_envs).
        """
        work = scenario.workpiece
        pitch = work.bar_length + work.approach
        share = (torch.arange(POINTS, dtype=torch.float64) + 0.5) / POINTS
        states = torch.as_tensor(before).unsqueeze(-1), torch.as_tensor(after).unsqueeze(-1)
        ends = {name: (states[0][:, i], states[1][:, i]) for i, name in enumerate(FIELDS)}
        begun_anew = torch.as_tensor(changed).unsqueeze(-1)
        start, end = ends["path"]
        path = start + (end - start) * share
        bar = torch.floor(path / pitch)
        # A field is known at a step's end in the metal of the same bar; between two such ends it is interpolated.
        weights = [
            torch.where((depth > 0.0) & (torch.floor(at / pitch) == bar), near + 1e-3, 0.0)
            for depth, at, near in zip(
                ends["depth_of_cut"], (start, end), (1.0 - share, share), strict=True
            )
        ]
        total = weights[0] + weights[1]
        cutting = (path - pitch * bar >= work.approach) & (total > 0.0) & ~begun_anew

        def log_field(name: str, in_air: float) -> Tensor:
            first, last = ends[name]
            mean = (weights[0] * first + weights[1] * last) / torch.where(total > 0.0, total, 1.0)
            return torch.where(cutting, mean, in_air).log().float()

        first, last = ends["used_life"]
        last = torch.where(begun_anew, first, last)  # of the edge that was in use at the start
        self.log_depth = log_field("depth_of_cut", work.depth_of_cut)  # [log mm]
        self.log_hardness = log_field("hardness", 1.0)  # [-]
        self.used_life = (first + (last - first) * share).clamp(MIN_USED_LIFE, 1.0).float()  # [-]
        self.borne_force = ends["thrust_force"][0].float()  # [N], shape (steps, num_envs, 1)
        self.cutting = cutting.float()  # 0 or 1
        self.changed = torch.as_tensor(changed).float()  # 0 or 1, shape (steps, num_envs)
        self.failed = torch.as_tensor(failed).float()  # 0 or 1, likewise


def edge_price(scenario: Scenario) -> float:
    """Return the price of a whole edge and its change [s]."""
    return 60.0 * (scenario.economics.edge_cost + scenario.economics.edge_change_time)


def flat_prices(scenario: Scenario) -> Worth:
    """Return the prices of time and life, with life at the flat price of the reward."""
    prices = worth(scenario)
    return prices._replace(life=np.full(len(USED_LIVES), edge_price(scenario)))


class ModelGain:
    """The gain of steps as a function of the commanded cutting speeds and feeds on the true scenario, if the aim is removal.

    ``prices`` of life are at evenly spaced used shares up to 1; None: the scenario's.
    """

    def __init__(self, scenario: Scenario, prices: Worth | None = None) -> None:
        self._scenario = scenario
        material, limits, economics, tool = (
            scenario.material,
            scenario.limits,
            scenario.economics,
            scenario.tool,
        )
        share = (np.arange(POINTS) + 0.5) / POINTS
        self._left = []
        for lag in (scenario.machine.spindle_time_constant, scenario.machine.feed_time_constant):
            lags = max(lag, 1e-9) / scenario.control.interval
            self._left.append((_tensor(np.exp(-share / lags)), _tensor(np.exp(-1.0 / lags))))
        self._force = _Law(material.thrust_force, math.log(limits.thrust_force))
        self._power = _Law(material.power, math.log(limits.power))
        self._wear = _Law(material.wear, math.log(tool.wear_criterion))
        self._idle = _tensor(
            scenario.spindle.idle_torque / (30.0 * scenario.workpiece.diameter * limits.power)
        )
        self._base_speed = _tensor(max(scenario.base_cutting_speed, 1e-9))
        self._log_criterion, self._life_exponent = (
            _tensor(np.log(tool.wear_criterion)),
            _tensor(material.wear.time),
        )
        self._log_strength = _tensor(np.log(tool.edge_strength / limits.thrust_force))
        self._force_limit = _tensor(limits.thrust_force)
        self._strength_spread = _tensor(max(tool.edge_strength_spread, 1e-3))
        self._reference = _tensor(economics.reference_removal_rate)
        if prices is None:
            job_ends_first = scenario.workpiece.bars > 0 and scenario.control.edge_changes == "end"
            prices = flat_prices(scenario) if job_ends_first else worth(scenario)
        self._time_price = _tensor(prices.time)
        self._prices = _tensor(np.concatenate([prices.life[:1], prices.life]))
        self._stop = _tensor(60.0 * economics.unplanned_stop * prices.time)
        self._edge_price, self._downtime = (
            _tensor(edge_price(scenario)),
            60.0 * economics.breakage_downtime,
        )
        self._chips_tangle = scenario.swarf.tangle_rate > 0.0
        self._tangle_cost = _tensor(
            scenario.swarf.tangle_rate * scenario.swarf.tangle_time * prices.time
        )
        self._log_feeds = [_tensor(np.log(max(end, 1e-9))) for end in scenario.feed_range]

    def __call__(
        self, log_speed: Tensor, log_feed: Tensor, speed: Tensor, feed: Tensor, truth: Truth
    ) -> tuple[Tensor, Tensor]:
        """Return each step's gain [s], up to a constant, and the earnings of going on with the edge [s], without a gradient.

        All have shape (steps, num_envs): the logarithms of commanded cutting speed [m/min] and feed [mm/rev], and the actual ones
        at the step's start. For a changed edge, the earnings assume a nominal bar.
        """
        scenario = self._scenario
        speeds, feeds = (
            self._follow(log_speed.exp(), speed, 0),
            self._follow(log_feed.exp(), feed, 1),
        )
        logs = speeds.log(), feeds.log(), truth.log_depth
        log_wear = self._log_criterion + self._life_exponent * truth.used_life.log()
        log_force = self._force(*logs, log_wear, truth.log_hardness)
        power = self._power(*logs, log_wear, truth.log_hardness).exp() + self._idle * speeds
        power = power / (speeds / self._base_speed).clamp(max=1.0)
        excess = torch.relu(log_force.exp() - 1.0) + torch.relu(power - 1.0)
        life_rate = (
            self._wear(*logs, 0.0, truth.log_hardness) / self._life_exponent
        ).exp() / 60.0  # [1/s]
        overload = scenario.economics.overload_price * excess
        price = self.price(truth.used_life)
        cost = self._time_price + truth.cutting * (overload + price * life_rate)
        if self._chips_tangle:
            low, high = self._log_feeds
            outside = torch.relu(low - logs[1]) + torch.relu(logs[1] - high)
            cost = cost + truth.cutting * self._tangle_cost * outside / WINDOW_EDGE
        velocity = (speeds * feeds).mean(dim=-1)
        interval = scenario.control.interval
        # The distance is fixed: at higher velocity it takes less time.
        gain: Tensor = -interval * cost.mean(dim=-1) * (velocity.detach() / velocity)
        borne = self._breaks((truth.borne_force / self._force_limit).clamp(min=MIN_LOAD).log())
        risk = torch.relu(self._breaks(log_force) - borne) / (1.0 - borne).clamp(min=MIN_LOAD)
        lost = self._downtime + self._edge_price * (1.0 - truth.used_life)
        gain = gain - (truth.cutting * risk * lost).amax(dim=-1)
        metal = speeds * feeds * truth.log_depth.exp() / self._reference
        # While life has a price, metal earns on average that price plus the cost of time and overload.
        earned = torch.where(price > 0.0, price * life_rate, metal - overload - self._time_price)
        going_on = interval * (
            torch.maximum(truth.cutting, truth.changed.unsqueeze(-1)) * earned
        ).mean(dim=-1)
        return gain, torch.where(truth.failed > 0.0, -self._stop, going_on).detach()

    def _breaks(self, log_force: Tensor) -> Tensor:
        """Return the probability that an edge breaks at a force over its limit."""
        probability: Tensor = torch.special.ndtr(
            (log_force - self._log_strength) / self._strength_spread
        )
        return probability

    def edge_change_gain(self, score: Tensor, going_on: Tensor) -> Tensor:
        """Return an objective whose maximum makes ``score`` positive if the edge should be changed; all (steps, num_envs).

        It is best to change an edge as soon as one more step with it has negative expected earnings (optimal stopping in the
        monotone case, Chow and Robbins 1961). The earnings ``going_on`` [s] of that step are uncertain in advance. A logistic
        loss weighted by them is least if ``score`` has the opposite sign of their expectation.
        """
        return -(torch.relu(going_on) * softplus(score) + torch.relu(-going_on) * softplus(-score))

    def price(self, used_life: Tensor) -> Tensor:
        """Return the price p(D) of a whole life [s] at used lives D [-]."""
        last = self._prices.shape[-1] - 1
        position = used_life.clamp(0.0, 1.0) * last
        node = position.floor().clamp(max=last - 1)
        low = node.long()
        return torch.lerp(self._prices[low], self._prices[low + 1], position - node)

    def _follow(self, commanded: Tensor, actual: Tensor, drive: int) -> Tensor:
        """Return the actual values at the points of every step, shape (steps, num_envs, POINTS), for one drive's commands.

        ``actual`` is measured at the starts of the steps. The gradient passes from step to step, because a lagging drive carries
        a command beyond its own step.
        """
        at_points, at_end = self._left[drive]
        carried = torch.zeros_like(actual[0])
        values = []
        for command, measured in zip(commanded, actual, strict=True):
            deviation = measured + carried - command
            values.append(command.unsqueeze(-1) + deviation.unsqueeze(-1) * at_points)
            end = command + deviation * at_end
            carried = end - end.detach()
        return torch.stack(values)


def _tensor(value: Any) -> Tensor:
    return torch.as_tensor(value, dtype=torch.float32)


class _Law:
    """Logarithm of a response over its limit, for tensors of logarithms."""

    def __init__(self, law: PowerLaw, log_limit: float) -> None:
        numbers = {name: getattr(law, name) for name in POWER_LAW_RECORD.names or ()}
        numbers["log_coefficient"] -= log_limit
        self._law = SimpleNamespace(**{name: _tensor(value) for name, value in numbers.items()})

    def __call__(
        self,
        log_speed: Tensor,
        log_feed: Tensor,
        log_depth: Tensor,
        log_wear: Any,
        log_hardness: Tensor,
    ) -> Tensor:
        factors = (log_speed, log_feed, log_depth, 0.0, log_wear, log_hardness)
        response: Tensor = log_response(self._law, *factors)  # type: ignore[no-untyped-call]
        return response
