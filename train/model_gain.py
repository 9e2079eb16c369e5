"""The teacher of the analytic-gradient agent: the gain of a step as a function of its commands.

The tool must travel all bars, and metal is paid by volume. So an agent can only gain by reducing
its cost per distance:

    (time + price of overload * excess + p(D) * life used) / distance,

where p(D) is the price of the edge's life by dynamic programming
(``baselines/models/edge_value.py``). It replaces the flat price in the reward; over a whole edge,
the two differ by a constant.

After a step, the simulator reveals the hidden depth, hardness and wear to the teacher
(``HindsightVecEnv``). Machinability models and the drives' lags then give the gradient of the
step's cost with respect to speed and feed. A force above all that the edge has borne is charged the
expected cost of breaking an edge of unknown strength.

It is no search: training ascends its gradient, so it stands in tensors of PyTorch. The law of a
response is ``scenario/power_law.log_response``; the rate of life, capacity, and the probability of
breakage are those of ``scenario/laws.py`` and ``physics`` in single precision.
``tests/train/test_model_gain.py`` compares its charges with the environment's.

(Analytic gradients through a known model: Freeman et al. 2021, arXiv 2106.13281; the replaced flat
charge: potential-based shaping, Ng et al. 1999. The combination is this project's.)
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import softplus

from baselines.optimiser import USED_LIVES, Worth, worth
from train.analytic_actor import SpeedAndFeed
from turning_env import Scenario
from turning_env.scenario.laws import edge_price, idle_power_at
from turning_env.scenario.power_law import POWER_LAW_RECORD, PowerLaw, log_response

Tensor = torch.Tensor

HIDDEN_STATE = np.dtype(
    [
        ("path", np.float64),
        ("depth_of_cut", np.float64),
        ("hardness", np.float64),
        ("used_life", np.float64),
        ("thrust_force", np.float64),
    ]
)
"""Hidden quantities at the start or the end of a step, in the units of ``info``. Depth, hardness
and force are 0 in air. The force is the highest at the end of any step of the same edge."""
POINTS = 5
"""Number of points in time at which a step's costs are evaluated."""
WINDOW_EDGE = 0.05
"""Logarithm of the feed beyond the chip breaker's window at which the teacher charges the full cost
of tangled chips. The cost is a step there, so its gradient is 0; this line has one."""
MIN_LOAD = 1e-3
"""Smallest force over its limit, and smallest probability to survive [-]."""
MIN_WEIGHT = 1e-3
"""Weight of the value at one end of a step at the step's other end [-]: above 0, so that a value
that is known at one end only holds for the whole step."""
MIN_STRENGTH_SPREAD = 1e-3
"""Smallest log standard deviation of the edges' strength [-], so that breakage has a gradient."""
MIN_POSITIVE = 1e-9
"""In place of 0 where a logarithm is taken, or where a time constant divides."""
MIN_USED_LIFE = 1e-6
"""Used life of a fresh edge [-]: the laws are not defined at 0."""


@dataclass(frozen=True)
class HiddenSteps:
    """Values that the simulator reveals after steps; arrays have shape (..., num_envs)."""

    before: NDArray[np.void]
    """``HIDDEN_STATE`` at the start."""
    after: NDArray[np.void]
    """``HIDDEN_STATE`` at the end; if the edge was changed in the step, that of the fresh edge."""
    changed: NDArray[np.bool_]
    """Whether the edge was changed in the step."""
    failed: NDArray[np.bool_]
    """Whether it was changed because it was worn out or broken."""

    @classmethod
    def stacked(cls, steps: "Sequence[HiddenSteps]") -> Self:
        """Return successive steps as one, with a first axis of steps."""
        return cls(
            before=np.stack([step.before for step in steps]),
            after=np.stack([step.after for step in steps]),
            changed=np.stack([step.changed for step in steps]),
            failed=np.stack([step.failed for step in steps]),
        )

    def of(self, envs: NDArray[np.int64]) -> "HiddenSteps":
        """Return the steps of some environments."""
        return HiddenSteps(
            before=self.before[..., envs],
            after=self.after[..., envs],
            changed=self.changed[..., envs],
            failed=self.failed[..., envs],
        )


class Truth:
    """Hidden states at ``POINTS`` points of each step, interpolated.

    Fields have shape (steps, num_envs, POINTS) unless they say otherwise.
    """

    log_depth: Tensor  # [log mm]
    log_hardness: Tensor  # [-]
    used_life: Tensor  # [-]
    borne_force: Tensor  # highest force before the step [N], shape (steps, num_envs, 1)
    cutting: Tensor  # 0 or 1
    changed: Tensor  # 0 or 1, shape (steps, num_envs)
    failed: Tensor  # 0 or 1, shape (steps, num_envs)

    def __init__(self, scenario: Scenario, steps: HiddenSteps) -> None:
        """Interpolate steps, shape (steps, num_envs), of a ``HindsightVecEnv`` of the scenario."""
        work = scenario.workpiece
        pitch = work.bar_length + work.approach
        share = (torch.arange(POINTS, dtype=torch.float64) + 0.5) / POINTS
        changed = torch.as_tensor(steps.changed).unsqueeze(-1)
        start_path = _field(steps.before, "path")
        end_path = _field(steps.after, "path")
        path = start_path + (end_path - start_path) * share
        bar = torch.floor(path / pitch)

        # A step has two ends. Depth and hardness are known at an end that is in the metal of the
        # point's bar. If both are, they are interpolated between them. If only one is, its value
        # holds for the whole step: ``MIN_WEIGHT`` keeps its weight above 0 up to the other end.
        start_depth = _field(steps.before, "depth_of_cut")
        end_depth = _field(steps.after, "depth_of_cut")
        start_known = (start_depth > 0.0) & (torch.floor(start_path / pitch) == bar)
        end_known = (end_depth > 0.0) & (torch.floor(end_path / pitch) == bar)
        start_weight = torch.where(start_known, 1.0 - share + MIN_WEIGHT, 0.0)
        end_weight = torch.where(end_known, share + MIN_WEIGHT, 0.0)
        total = start_weight + end_weight
        divisor = torch.where(total > 0.0, total, 1.0)
        cutting = (path - pitch * bar >= work.approach) & (total > 0.0) & ~changed

        def log_field(name: str, in_air: float) -> Tensor:
            weighted = start_weight * _field(steps.before, name) + end_weight * _field(
                steps.after, name
            )
            return torch.where(cutting, weighted / divisor, in_air).log().float()

        life_before = _field(steps.before, "used_life")
        life_after = _field(steps.after, "used_life")
        # Life after a change is that of the fresh edge; take the edge in use at the start.
        life_after = torch.where(changed, life_before, life_after)
        used_life = life_before + (life_after - life_before) * share

        self.log_depth = log_field("depth_of_cut", in_air=work.depth_of_cut)
        self.log_hardness = log_field("hardness", in_air=1.0)
        self.used_life = used_life.clamp(MIN_USED_LIFE, 1.0).float()
        self.borne_force = _field(steps.before, "thrust_force").float()
        self.cutting = cutting.float()
        self.changed = torch.as_tensor(steps.changed).float()
        self.failed = torch.as_tensor(steps.failed).float()


def _field(states: NDArray[np.void], name: str) -> Tensor:
    """Return a field of hidden states, shape (steps, num_envs, 1)."""
    return torch.as_tensor(np.ascontiguousarray(states[name])).unsqueeze(-1)


def flat_prices(scenario: Scenario) -> Worth:
    """Return the prices of time and life, with life at the flat price of the reward."""
    prices = worth(scenario)
    return prices._replace(life=np.full(len(USED_LIVES), 60.0 * edge_price(scenario)))


def prices_of(scenario: Scenario) -> Worth:
    """Return the prices of time and life by which a scenario's teacher charges."""
    # If the job ends before the edge, its life has the flat price.
    job_ends_first = scenario.workpiece.bars > 0 and scenario.control.edge_changes == "end"
    return flat_prices(scenario) if job_ends_first else worth(scenario)


class StepGain(NamedTuple):
    """Gains of steps, shape (steps, num_envs)."""

    gain: Tensor
    """Gain of each step [s], up to a constant."""
    going_on: Tensor
    """Earnings of going on with the edge for the step [s], without a gradient."""


class ModelGain:
    """The gain of steps as a function of their commands on the true scenario.

    The scenario's aim is removal.
    """

    def __init__(self, scenario: Scenario, prices: Worth | None = None) -> None:
        """Store a scenario's numbers as tensors.

        Args:
            scenario: the true scenario.
            prices: price of a second [s], and prices of an edge's life [s] at evenly spaced used
                lives up to 1; None: the scenario's.
        """
        material = scenario.material
        limits = scenario.limits
        economics = scenario.economics
        tool = scenario.tool
        self._interval = scenario.control.interval  # [s]
        self._spindle = _Drive(scenario.machine.spindle_time_constant, self._interval)
        self._feed_drive = _Drive(scenario.machine.feed_time_constant, self._interval)

        self._force = _Law(material.thrust_force, math.log(limits.thrust_force))
        self._power = _Law(material.power, math.log(limits.power))
        self._wear = _Law(material.wear, math.log(tool.wear_criterion))
        self._log_criterion = _tensor(np.log(tool.wear_criterion))
        self._life_exponent = _tensor(material.wear.time)
        # Idle power over the limit, per cutting speed [min/m].
        self._idle = _tensor(idle_power_at(scenario, 1.0) / limits.power)
        self._base_speed = _tensor(max(scenario.base_cutting_speed, MIN_POSITIVE))

        self._force_limit = _tensor(limits.thrust_force)
        self._log_strength = _tensor(np.log(tool.edge_strength / limits.thrust_force))
        strength_spread = max(tool.edge_strength_spread, MIN_STRENGTH_SPREAD)
        self._strength_spread = _tensor(strength_spread)
        self._edge_price = _tensor(60.0 * edge_price(scenario))  # [s]
        self._downtime = 60.0 * economics.breakage_downtime  # [s]

        if prices is None:
            prices = prices_of(scenario)
        self._time_price = _tensor(prices.time)  # of a second [s]
        # Prices [s] at used lives from 0 on: before the first one given, the price is constant.
        self._life_prices = _tensor(np.concatenate([prices.life[:1], prices.life]))
        self._overload_price = economics.overload_price
        self._stop_cost = _tensor(60.0 * economics.unplanned_stop * prices.time)  # [s]
        self._reference_rate = _tensor(economics.reference_removal_rate)

        swarf = scenario.swarf
        self._chips_tangle = swarf.tangle_rate > 0.0
        # Cost of stops for tangled chips per time outside the window [-].
        self._tangle_cost = _tensor(swarf.tangle_rate * swarf.tangle_time * prices.time)
        log_feeds = [np.log(max(feed, MIN_POSITIVE)) for feed in scenario.feed_range]
        self._log_feed_range = [_tensor(log_feed) for log_feed in log_feeds]

    def __call__(self, log_commanded: SpeedAndFeed, actual: SpeedAndFeed, truth: Truth) -> StepGain:
        """Return the gain of each step, and the earnings of going on with the edge.

        For a changed edge, the earnings assume a nominal bar.

        Args:
            log_commanded: logarithms of commanded cutting speed and feed, shape (steps, num_envs).
            actual: cutting speed and feed at the steps' starts, likewise.
            truth: hidden states of the steps.
        """
        # Gradients are summed in the reverse order of these lines: a change of their order changes
        # the last bits of a training.
        speeds = self._spindle.follow(log_commanded.speed.exp(), actual.speed)
        feeds = self._feed_drive.follow(log_commanded.feed.exp(), actual.feed)
        log_speeds = speeds.log()
        log_feeds = feeds.log()
        log_wear = self._log_criterion + self._life_exponent * truth.used_life.log()
        factors = (log_speeds, log_feeds, truth.log_depth)

        # Loads over their limits, and the price of their excess.
        log_force = self._force(*factors, log_wear, truth.log_hardness)
        cutting_power = self._power(*factors, log_wear, truth.log_hardness).exp()
        power = cutting_power + self._idle * speeds
        # Below its base speed, the spindle has less power.
        power = power / (speeds / self._base_speed).clamp(max=1.0)
        excess = torch.relu(log_force.exp() - 1.0) + torch.relu(power - 1.0)

        # The law of wear gives W = criterion * (t / life)^n, with n the exponent of time. So life
        # is used at the rate 1 / life.
        log_wear_in_a_minute = self._wear(*factors, 0.0, truth.log_hardness)
        life_rate = (log_wear_in_a_minute / self._life_exponent).exp() / 60.0  # [1/s]
        overload = self._overload_price * excess
        life_price = self.price(truth.used_life)
        cost = self._time_price + truth.cutting * (overload + life_price * life_rate)
        if self._chips_tangle:
            low, high = self._log_feed_range
            outside = torch.relu(low - log_feeds) + torch.relu(log_feeds - high)
            cost = cost + truth.cutting * self._tangle_cost * outside / WINDOW_EDGE

        # The distance is fixed: at higher velocity it takes less time.
        velocity = (speeds * feeds).mean(dim=-1)
        gain = -self._interval * cost.mean(dim=-1) * (velocity.detach() / velocity)
        gain = gain - self._breakage_cost(log_force, truth)

        # While life has a price, metal earns on average that price plus the cost of time and
        # overload.
        metal = speeds * feeds * truth.log_depth.exp() / self._reference_rate
        profit = metal - overload - self._time_price
        earned = torch.where(life_price > 0.0, life_price * life_rate, profit)
        # Where the edge was changed, these are the earnings that it would have had.
        counts = torch.maximum(truth.cutting, truth.changed.unsqueeze(-1))
        going_on = self._interval * (counts * earned).mean(dim=-1)
        going_on = torch.where(truth.failed > 0.0, -self._stop_cost, going_on)
        return StepGain(gain=gain, going_on=going_on.detach())

    def _breakage_cost(self, log_force: Tensor, truth: Truth) -> Tensor:
        """Return the expected cost of breaking the edge in each step [s].

        The edge is stronger than the highest force that it has borne.
        """
        log_borne_force = (truth.borne_force / self._force_limit).clamp(min=MIN_LOAD).log()
        borne = self._break_probability(log_borne_force)
        more = torch.relu(self._break_probability(log_force) - borne)
        risk = more / (1.0 - borne).clamp(min=MIN_LOAD)
        lost = self._downtime + self._edge_price * (1.0 - truth.used_life)
        return (truth.cutting * risk * lost).amax(dim=-1)

    def _break_probability(self, log_force: Tensor) -> Tensor:
        """Return the probability that an edge breaks at a force over its limit."""
        probability: Tensor = torch.special.ndtr(
            (log_force - self._log_strength) / self._strength_spread
        )
        return probability

    def edge_change_gain(self, score: Tensor, going_on: Tensor) -> Tensor:
        """Return an objective whose maximum makes ``score`` positive if the edge should be changed.

        It is best to change an edge as soon as one more step with it has negative expected earnings
        (optimal stopping in the monotone case, Chow and Robbins 1961). The earnings ``going_on``
        [s] of that step are uncertain in advance. A logistic loss weighted by them is least if
        ``score`` has the opposite sign of their expectation. All have shape (steps, num_envs).
        """
        return -(torch.relu(going_on) * softplus(score) + torch.relu(-going_on) * softplus(-score))

    def price(self, used_life: Tensor) -> Tensor:
        """Return the price p(D) of a whole life [s] at used lives D [-]."""
        last = self._life_prices.shape[-1] - 1
        position = used_life.clamp(0.0, 1.0) * last
        node = position.floor().clamp(max=last - 1)
        low = node.long()
        return torch.lerp(self._life_prices[low], self._life_prices[low + 1], position - node)


class _Drive:
    """A drive, which approaches its commands exponentially."""

    def __init__(self, lag: float, interval: float) -> None:
        """Take the drive's time constant and the control interval [s]."""
        share = (np.arange(POINTS) + 0.5) / POINTS
        lag_in_intervals = max(lag, MIN_POSITIVE) / interval
        # Shares of a deviation that are left at the points of a step, and at its end.
        self._left_at_points = _tensor(np.exp(-share / lag_in_intervals))
        self._left_at_end = _tensor(np.exp(-1.0 / lag_in_intervals))

    def follow(self, commanded: Tensor, actual: Tensor) -> Tensor:
        """Return the actual values at the points of steps, shape (steps, num_envs, POINTS).

        ``commanded`` holds the commands of the steps, ``actual`` the values measured at their
        starts, both of shape (steps, num_envs). The gradient passes from step to step, because a
        lagging drive carries a command beyond its own step.
        """
        carried = torch.zeros_like(actual[0])
        values = []
        for command, measured in zip(commanded, actual, strict=True):
            deviation = measured + carried - command
            values.append(command.unsqueeze(-1) + deviation.unsqueeze(-1) * self._left_at_points)
            end = command + deviation * self._left_at_end
            # Its value is 0: the next step's start is measured. Only its gradient is carried.
            carried = end - end.detach()
        return torch.stack(values)


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
        """Return log(response / limit), of the shape to which the arguments broadcast."""
        growth = self._law.wear_growth
        # U = W, or 1 + b W (``turning_env/numerics/wear_term.py``).
        term = (1.0 + growth * log_wear.exp()).log() if growth > 0.0 else log_wear
        response: Tensor = log_response(
            self._law,
            log_cutting_speed=log_speed,
            log_feed=log_feed,
            log_depth_of_cut=log_depth,
            log_time=0.0,
            log_wear_term=term,
            log_hardness=log_hardness,
        )
        return response


def _tensor(value: Any) -> Tensor:
    return torch.as_tensor(value, dtype=torch.float32)
