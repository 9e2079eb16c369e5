"""The prices of time and edge life of many scenarios at once: those of ``baselines/models/edge_value.py`` on a coarser grid.

Edges are changed on command. At a price of time, the best policy at a used share D of the life gains nothing at the price

    p(D) = (value of metal less overload - price of time) / life used per time.

Time has the price at which a whole edge just pays for itself. Both prices and the policy are improved in turns (Howard 1960).
"""

from typing import Any

import numpy as np
import torch

from baselines.models.edge_value import SPREAD, Worth
from turning_env.scenario.plan import Columns
from turning_env.scenario.power_law import log_response

Tensor = torch.Tensor

LIVES = 20
"""Number of used shares of the life at which it is priced: 1 / LIVES, 2 / LIVES, ..., 1."""
_ITERATIONS = 10
_BISECTIONS = 40
_MAX_TIME_PRICE = 100.0


def worths(s: Columns, count: int, device: str = "cpu", grid: tuple[int, int] = (20, 24), lives: int = LIVES) -> Worth:
    """Return the prices of time, shape (count,), and of life [s], shape (count, lives), for ``count`` scenarios.

    ``grid``: numbers of cutting speeds and feeds that are compared.
    """
    shares = np.arange(1, lives + 1) / lives
    value, rate = _outcomes(s, count, device, grid, shares)  # (count, lives, bars, set points), (count, 1, bars, set points)
    weights = torch.tensor([1.0, 4.0, 1.0], device=device) / 6.0
    weight = torch.outer(weights, weights).flatten()
    cost, change = (
        torch.as_tensor(np.broadcast_to(60.0 * np.asarray(each), count).copy(), dtype=torch.float32, device=device)
        for each in (s.economics.edge_cost, s.economics.edge_change_time)
    )
    price = (cost + change).unsqueeze(-1).expand(count, lives)
    rates = rate.expand(value.shape)
    for _ in range(_ITERATIONS):
        best = (value - price[..., None, None] * rate).argmax(dim=-1, keepdim=True)
        gained, used = (each.gather(-1, best).squeeze(-1) @ weight for each in (value, rates))
        low, high = torch.zeros(count, device=device), torch.full((count,), _MAX_TIME_PRICE, device=device)
        for _ in range(_BISECTIONS):
            time = 0.5 * (low + high)
            earns = ((gained - time[:, None]) / used).clamp(min=0.0).mean(dim=-1) > cost + time * change
            low, high = torch.where(earns, time, low), torch.where(earns, high, time)
        price = ((gained - low[:, None]) / used).clamp(min=0.0)
    return Worth(low.double().cpu().numpy(), price.double().cpu().numpy())  # type: ignore[arg-type]


def _outcomes(s: Columns, count: int, device: str, grid: tuple[int, int], shares: Any) -> tuple[Tensor, Tensor]:
    """Return the value of metal less overload [-] and the life used [1/s]; see ``edge_value._outcomes``."""

    def wide(value: Any) -> Tensor:
        """Return numbers as a tensor of shape (scenarios, depths, hardnesses, speeds, feeds)."""
        values = np.broadcast_to(np.asarray(value, np.float32), count).copy()
        return torch.from_numpy(values).to(device).view(count, 1, 1, 1, 1)

    def law(name: str) -> Any:
        section = getattr(s.material, name)
        names = ("log_coefficient", "cutting_speed", "feed", "depth_of_cut", "time", "wear", "hardness")
        return type("Law", (), {each: wide(getattr(section, each)) for each in names})

    work, machine, limits = s.workpiece, s.machine, s.limits
    normals = 3.0**0.5 * torch.tensor([-1.0, 0.0, 1.0], device=device)
    spread = wide(np.hypot(work.depth_bar_spread, work.depth_along_spread))
    nominal = wide(work.depth_of_cut)
    depth = torch.maximum(nominal + spread * normals.view(3, 1, 1, 1), 0.05 * nominal)
    log_hardness = wide(np.hypot(work.hardness_bar_spread, work.hardness_along_spread)) * normals.view(3, 1, 1)
    places = [torch.linspace(0.0, 1.0, each, device=device) for each in grid]
    ends = (machine.cutting_speed_min, s.cutting_speed_max), s.feed_range
    (speed_low, speed_high), (feed_low, feed_high) = ((wide(np.log(low)), wide(np.log(high))) for low, high in ends)
    log_speed = speed_low + (speed_high - speed_low) * places[0].view(-1, 1)
    log_feed = feed_low + (feed_high - feed_low) * places[1]
    factors = log_speed, log_feed, depth.log(), 0.0
    speed = log_speed.exp()

    def response(name: str, log_limit: Any) -> Tensor:
        log: Tensor = log_response(law(name), *factors, 0.0, log_hardness) - wide(log_limit)  # type: ignore[no-untyped-call]
        return log

    metal = speed * log_feed.exp() * depth / wide(s.economics.reference_removal_rate)
    exponent = wide(s.material.wear.time)
    rate = (response("wear", np.log(s.tool.wear_criterion)) / exponent).exp() / 60.0
    log_force, log_power = response("thrust_force", np.log(limits.thrust_force)), response("power", np.log(limits.power))
    idle = wide(s.spindle.idle_torque / (30.0 * work.diameter * limits.power)) * speed
    log_capacity = (speed / wide(np.maximum(s.base_cutting_speed, 1e-9))).clamp(max=1.0).log()
    price, values = wide(s.economics.overload_price), []
    for share in shares:
        log_wear = wide(np.log(s.tool.wear_criterion)) + exponent * float(np.log(share))
        force = log_force + wide(s.material.thrust_force.wear) * log_wear
        power = ((log_power + wide(s.material.power.wear) * log_wear).exp() + idle).log() - log_capacity
        values.append((metal - price * (_expected_excess(force) + _expected_excess(power))).reshape(count, 9, -1))
    return torch.stack(values, dim=1), rate.reshape(count, 1, 9, -1)


def _expected_excess(log_mean: Tensor) -> Tensor:
    """See ``edge_value.expected_excess``."""
    ratio = log_mean / SPREAD
    excess: Tensor = (log_mean + 0.5 * SPREAD**2).exp() * torch.special.ndtr(ratio + SPREAD) - torch.special.ndtr(ratio)
    return excess
