"""The teacher of the analytic-gradient agent: the gain of a step as a differentiable function of its commands.

The tool must travel all bars, and metal is paid by volume. So an agent can only gain by reducing its cost per distance:

    (time + price of overload * excess + p(D) * life used) / distance,

where p(D) is the price of the edge's life by dynamic programming (``baselines/models/edge_value.py``). It replaces the flat price
in the reward; over a whole edge, the two differ by a constant. After a step, the simulator reveals the hidden depth, hardness and
wear to the teacher (``HindsightVecEnv``). Machinability models and the drives' lags then give the gradient of the step's cost
with respect to speed and feed. The highest force of a step is charged the expected cost of breaking an edge of unknown strength.
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

from baselines.models.edge_value import USED_LIVES, worth
from turning_env import PowerLaw, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv, info_at_end_of_step
from turning_env.scenario.power_law import log_response

Tensor = torch.Tensor
Array = NDArray[np.float64]

FIELDS = ("path", "depth_of_cut", "hardness", "used_life")
"""Hidden quantities at the start and the end of every step, in the units of ``info``; depth and hardness are 0 in air."""
POINTS = 5
"""Number of points in time at which a step's costs are evaluated."""
MIN_USED_LIFE = 1e-6
"""Used life of a fresh edge [-]: the laws are not defined at 0."""


class HindsightVecEnv(RoughTurningVecEnv):
    """A ``RoughTurningVecEnv`` that keeps the hidden state of the last step for a teacher; the agent never sees it."""

    before: Array
    """``FIELDS`` at the start of the step, shape (len(FIELDS), num_envs)."""
    after: Array
    """``FIELDS`` at the step's end, same shape; if the edge was changed in the step, those of the fresh edge."""
    changed: NDArray[np.bool_]
    """Whether the edge was changed in the step, shape (num_envs,)."""
    failed: NDArray[np.bool_]
    """Whether it was changed because it was worn out or broken, shape (num_envs,)."""

    def reset(self) -> NDArray[np.float32]:
        """Return first observations. The tool stands in the air before the first bar."""
        self._now = np.zeros((len(FIELDS), self.num_envs))
        return super().reset()

    def training_rewards(self, rewards: Array, infos: dict[str, Any]) -> Array:
        """Keep the hidden state, and return the rewards unchanged."""
        self.before = self._now
        self.after = np.stack([info_at_end_of_step(infos, name) for name in FIELDS])
        stopped, cut, engaged = (info_at_end_of_step(infos, name) for name in ("stopped_time", "cutting_time", "engaged_time"))
        self.changed = (stopped > 0.0) & (60.0 * cut <= engaged * (1.0 + 1e-6))  # tangled chips also stop the machine
        commands_changes = self.vector_env.scenario.control.edge_changes == "commanded"
        self.failed = self.changed & ~(commands_changes & (self._actions[:, -1] > 0.0))
        self._now = np.stack([infos[name] for name in FIELDS])
        return rewards


class Truth:
    """Interpolated hidden states at ``POINTS`` points of each step; fields have shape (steps, num_envs, POINTS)."""

    def __init__(
        self, scenario: Scenario, before: Array, after: Array, changed: NDArray[np.bool_], failed: NDArray[np.bool_]
    ) -> None:
        """``before``, ``after``: shape (steps, len(FIELDS), num_envs); the others (steps, num_envs). See ``HindsightVecEnv``."""
        work = scenario.workpiece
        pitch = work.bar_length + work.approach
        share = (np.arange(POINTS) + 0.5) / POINTS
        ends = {name: (before[:, i, :, np.newaxis], after[:, i, :, np.newaxis]) for i, name in enumerate(FIELDS)}
        start, end = ends["path"]
        path = start + (end - start) * share
        bar = np.floor(path / pitch)
        # A field is known at a step's end in the metal of the same bar; between two such ends it is interpolated.
        weights = [
            np.where((depth > 0.0) & (np.floor(at / pitch) == bar), near + 1e-3, 0.0)
            for depth, at, near in zip(ends["depth_of_cut"], (start, end), (1.0 - share, share), strict=True)
        ]
        total = weights[0] + weights[1]
        cutting = (path - pitch * bar >= work.approach) & (total > 0.0) & ~changed[..., np.newaxis]

        def log_field(name: str, in_air: float) -> Tensor:
            first, last = ends[name]
            mean = np.divide(weights[0] * first + weights[1] * last, total, out=np.full(path.shape, in_air), where=total > 0.0)
            return _tensor(np.log(np.where(cutting, mean, in_air)))

        first, last = ends["used_life"]
        last = np.where(changed[..., np.newaxis], first, last)  # of the edge that was in use at the start
        self.log_depth = log_field("depth_of_cut", work.depth_of_cut)  # [log mm]
        self.log_hardness = log_field("hardness", 1.0)  # [-]
        self.used_life = _tensor(np.clip(first + (last - first) * share, MIN_USED_LIFE, 1.0))  # [-]
        self.cutting = _tensor(cutting)  # 0 or 1
        self.changed = _tensor(changed)  # 0 or 1, shape (steps, num_envs)
        self.failed = _tensor(failed)  # 0 or 1, likewise


def _tensor(values: Any) -> Tensor:
    return torch.from_numpy(np.asarray(values, np.float32))


class ModelGain:
    """The gain of steps as a function of the commanded cutting speeds and feeds, in a scenario whose aim is removal."""

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
        # If the job ends long before the edge, life has the flat price.
        flat = scenario.workpiece.bars > 0 and scenario.control.edge_changes == "end"
        edge_price = 60.0 * (economics.edge_cost + economics.edge_change_time)
        prices = np.full(len(USED_LIVES), edge_price) if flat else worths.life
        self._time_price = worths.time
        self._prices = torch.tensor(np.concatenate([prices[:1], prices]), dtype=torch.float32)
        self._stop = 60.0 * economics.unplanned_stop * worths.time
        self._edge_price, self._downtime = edge_price, 60.0 * economics.breakage_downtime

    def __call__(self, log_speed: Tensor, log_feed: Tensor, speed: Tensor, feed: Tensor, truth: Truth) -> tuple[Tensor, Tensor]:
        """Return each step's gain [s], up to a constant, and the earnings of going on with the edge [s], without a gradient.

        Both have shape (steps, num_envs). For a changed edge, the earnings assume a nominal bar.

        Args:
            log_speed: commanded cutting speed [log m/min], shape (steps, num_envs).
            log_feed: commanded feed [log mm/rev], likewise.
            speed: actual cutting speed at the step's start [m/min], likewise.
            feed: actual feed at the step's start [mm/rev], likewise.
            truth: the hidden states.
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
        # The distance is fixed: at higher velocity it takes less time.
        gain: Tensor = -interval * cost.mean(dim=-1) * (velocity.detach() / velocity)
        risk = torch.special.ndtr((log_force - self._log_strength) / max(scenario.tool.edge_strength_spread, 1e-3))
        lost = self._downtime + self._edge_price * (1.0 - truth.used_life)
        gain = gain - (truth.cutting * risk * lost).amax(dim=-1)
        metal = speeds * feeds * truth.log_depth.exp() / scenario.economics.reference_removal_rate
        # While life has a price, metal earns on average that price plus the cost of time and overload.
        earned = torch.where(price > 0.0, price * life_rate, metal - overload - self._time_price)
        going_on = interval * (torch.maximum(truth.cutting, truth.changed.unsqueeze(-1)) * earned).mean(dim=-1)
        return gain, torch.where(truth.failed > 0.0, -self._stop, going_on).detach()

    def edge_change_gain(self, score: Tensor, going_on: Tensor) -> Tensor:
        """Return an objective whose maximum makes ``score`` positive where the edge should be changed; all (steps, num_envs).

        It is best to change an edge as soon as one more step with it has negative expected earnings (optimal stopping in the
        monotone case, Chow and Robbins 1961). The earnings ``going_on`` [s] of that step are uncertain in advance. A logistic
        loss weighted by them is least if ``score`` has the opposite sign of their expectation.
        """
        return -(torch.relu(going_on) * softplus(score) + torch.relu(-going_on) * softplus(-score))

    def price(self, used_life: Tensor) -> Tensor:
        """Return the price p(D) of a whole life [s] at used lives D [-]."""
        last = len(self._prices) - 1
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


class _Law:
    """Logarithm of a response over its limit, for tensors of logarithms."""

    def __init__(self, law: PowerLaw, log_limit: float) -> None:
        # Plain floats: a NumPy record would turn tensors into arrays.
        record = law.record()
        self._law = SimpleNamespace(**{name: float(record[name]) for name in record.dtype.names})
        self._law.log_coefficient -= log_limit

    def __call__(self, log_speed: Tensor, log_feed: Tensor, log_depth: Tensor, log_wear: Any, log_hardness: Tensor) -> Tensor:
        factors = (log_speed, log_feed, log_depth, 0.0, log_wear, log_hardness)
        response: Tensor = log_response(self._law, *factors)  # type: ignore[no-untyped-call]
        return response
