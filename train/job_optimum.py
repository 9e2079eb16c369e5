"""The best cutting speeds and feeds of jobs by laws that a filter estimates: ``baselines/models/edge_value.py`` for tensors.

A network computes them in every step, so this is simpler than there: bars are as expected, and loads stay within their limits
if the chip breaker allows it. At a price t of time, a job earns nothing at used share D of an edge's life if life has the price

    p(D) = max over set points of (value of metal - t) / life used per time,

and t is such that a whole edge just pays for itself and its change (Newton's method).

Cutting speeds and feeds are logarithms over the plan's at half a life. Prices are those of a minute [-] and of a life [min].
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch

from turning_env.scenario.plan import MIDDLE, USED_LIVES

Tensor = torch.Tensor
Told = dict[str, Tensor]
"""Numbers of the context by name, not standardised, each of shape (num_envs,)."""


def single(value: float) -> float:
    """Return the nearest number of single precision: the exporter rounds a network's numbers so."""
    return float(torch.tensor(value, dtype=torch.float32))


LIVES = 6
"""Number of used shares of the life at which it is priced, beside the present one."""
SPEEDS = 24
"""Number of cutting speeds that are compared, evenly spaced on a logarithmic scale."""
MIN_EXPONENT = single(0.1)
"""Smallest exponent of the feed in a load, and of time in wear [-]."""
_NEWTON_STEPS = 8
_SOFTNESS = single(0.005)  # cutting speeds whose value is less by this still count
_MAX_LOG = single(20.0)
_MIN_CAPACITY = single(1e-3)  # of the spindle, less idle power, over that at the plan's speed
_MIN_RATE_EXPONENT = single(1.1)  # of speed: at 1, an edge would cut as many meters at any speed
_CHANCES = single(0.02), single(0.5)
_MIN_USED_LIFE = single(0.01)


class Load(NamedTuple):
    """Estimates of a load over its limit, by a power law; every field has shape (num_envs,)."""

    log_load: Tensor
    """Logarithm at the plan's set point and half a life."""
    speed: Tensor
    """Exponent of cutting speed."""
    feed: Tensor
    """Exponent of feed."""
    used_life: Tensor
    """Exponent of the used life."""


class Bar(NamedTuple):
    """How a bar differs from the expected one; every field has shape (num_envs,)."""

    loads: tuple[Tensor, Tensor]
    """Logarithms of force and power over those in the expected bar, and their doubt."""
    metal: Tensor
    """Logarithm of the depth of cut likewise."""
    wear: Tensor
    """Logarithm of the rate at which life is used likewise."""


class JobOptimum:
    """Estimated jobs, one for each environment.

    Args:
        told: the nominal models' numbers.
        loads: force and power.
        log_life_rate: logarithm of the rate at which the lot's edges are used up over the nominal rate, shape (num_envs,).
        speed_error: exponent of speed of the rate at which life is used, less the nominal one, shape (num_envs,).
        overload_price: price of a minute with a load 100 % over its limit [min].
    """

    def __init__(
        self, told: Told, loads: tuple[Load, Load], log_life_rate: Tensor, speed_error: Tensor, overload_price: float
    ) -> None:
        self._loads = [Load(*map(_wide, load)) for load in loads]
        self._overload_price = overload_price
        self._change, self._cost = (_exp(told[f"log_edge_{name}"]) for name in ("change_time", "price"))
        # A minute of the plan's set point, edges included, is worth a minute.
        self._log_metal = _wide(torch.log(1.0 + (self._cost + self._change) * _exp(-told["log_life"])))
        self._log_rate = _wide(log_life_rate - told["log_life"])
        time = told["wear_time_exponent"].clamp(min=MIN_EXPONENT)
        by_speed, by_feed = (told[f"wear_{name}_exponent"] / time for name in ("cutting_speed", "feed"))
        self._rate_speed, self._rate_feed = _wide((by_speed + speed_error).clamp(min=_MIN_RATE_EXPONENT)), _wide(by_feed)
        self._over_base, self._idle = _wide(told["log_speed_over_base_speed"]), _wide(_exp(told["log_idle_power"]))
        speed, feed = (told[f"{name}_at_{USED_LIVES[MIDDLE]}"] for name in ("speed", "feed"))
        self._lowest_feed, self._highest_feed = (_wide(told[f"log_{end}_feed"] - feed) for end in ("lowest", "highest"))
        slowest, fastest = _wide(-speed), _wide(-told["log_speed_over_fastest"])
        self._speeds = slowest + torch.arange(SPEEDS, dtype=speed.dtype, device=speed.device) / single(SPEEDS - 1) * (
            fastest - slowest
        )

    def prices(self, used_life: Tensor) -> tuple[Tensor, Tensor]:
        """Return the price of time, and that of life at a used life, each of shape (num_envs,)."""
        nodes = (torch.arange(LIVES, dtype=used_life.dtype, device=used_life.device) + 0.5) / single(LIVES)
        nodes = nodes.expand(used_life.shape[0], LIVES).unsqueeze(-1)
        metal, overload, rate = self._outcome(log_over_half(torch.cat([nodes, _wide(used_life)], dim=1)))
        life = 1.0 / rate
        gained = (metal - overload) * life
        time = torch.ones_like(self._cost)
        for _ in range(_NEWTON_STEPS):
            price, best = (gained - _wide(time) * life)[:, :LIVES].max(dim=-1)
            lasts = life[:, :LIVES].gather(-1, best.unsqueeze(-1)).squeeze(-1)
            earned = price.clamp(min=0.0).mean(dim=-1) - self._cost - time * self._change
            slope = (lasts * (price > 0.0)).mean(dim=-1) + self._change
            time = (time + earned / slope).clamp(0.1, 10.0)
        price = (gained - _wide(time) * life)[:, LIVES:].amax(dim=(-2, -1))
        return time, price.clamp(min=0.0)

    def best_speed(self, log_used: Tensor, life_price: Tensor, bar: Bar) -> Tensor:
        """Return the best cutting speed in a bar, at a used life and a price of life, shape (num_envs,)."""
        metal, overload, rate = self._outcome(_wide(log_used), bar)
        value = (metal - overload - _wide(life_price) * rate)[:, 0]
        return (torch.softmax(value / _SOFTNESS, dim=-1) * self._speeds[:, 0]).sum(dim=-1)

    def bearable_chances(
        self, speed: Tensor, feed: Tensor, life_price: Tensor, metal: Tensor, wear: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the probabilities of overload, by force and by power, from which more feed no longer pays, each (num_envs,).

        More feed cuts more metal and uses more life. It raises a load by its exponent of feed, and costs only if that is over its
        limit. ``metal``, ``wear``: see ``Bar``.
        """
        value, rate = self._metal_and_life(_wide(speed), _wide(feed), _wide(metal), _wide(wear))
        worth = value - self._rate_feed * _wide(life_price) * rate
        costs = (self._overload_price * load.feed.clamp(min=MIN_EXPONENT) for load in self._loads)
        force, power = ((worth / cost)[:, 0, 0].clamp(*_CHANCES) for cost in costs)
        return force, power

    def feed(self, speed: Tensor, log_used: Tensor, more: Sequence[Tensor]) -> Tensor:
        """Return the highest feed within limits and chip breaker's window, shape (num_envs,); ``more``: see ``Bar.loads``."""
        return self._feeds(_wide(speed), _wide(log_used), more)[0][:, 0, 0]

    def loads(self, speed: Tensor, feed: Tensor, log_used: Tensor) -> list[Tensor]:
        """Return logarithms of force and power over their limits in the expected bar, each of shape (num_envs,)."""
        logs = zip(self._without_feed(_wide(speed), _wide(log_used)), self._loads, strict=True)
        return [log[:, 0, 0] + load.feed[:, 0, 0] * feed for log, load in logs]

    def _outcome(self, log_used: Tensor, bar: Bar | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """Return value of metal, price of overload [-] and life used [1/min] for all speeds, (num_envs, lives, SPEEDS)."""
        feed, excess = self._feeds(self._speeds, log_used, bar.loads if bar else ())
        metal, rate = self._metal_and_life(self._speeds, feed, *((_wide(bar.metal), _wide(bar.wear)) if bar else ()))
        return metal, self._overload_price * excess, rate

    def _metal_and_life(
        self, speed: Tensor, feed: Tensor, metal: float | Tensor = 0.0, wear: float | Tensor = 0.0
    ) -> tuple[Tensor, Tensor]:
        """Return value of metal [-] and life used [1/min] at set points; ``metal``, ``wear``: see ``Bar``."""
        rate = _exp(self._log_rate + wear + self._rate_speed * speed + self._rate_feed * feed)
        return _exp(self._log_metal + metal + speed + feed), rate

    def _feeds(self, speed: Tensor, log_used: Tensor, more: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
        """Return the highest feeds within limits and window, and by how much the window's lowest exceeds the limits."""
        logs = self._without_feed(speed, log_used)
        if more:
            logs = [log + _wide(each) for log, each in zip(logs, more, strict=True)]
        feeds = [-log / load.feed.clamp(min=MIN_EXPONENT) for log, load in zip(logs, self._loads, strict=True)]
        highest = torch.minimum(*feeds)
        feed = torch.minimum(torch.maximum(highest, self._lowest_feed), self._highest_feed)
        return feed, torch.relu(feed - highest)

    def _without_feed(self, speed: Tensor, log_used: Tensor) -> list[Tensor]:
        """Return logarithms of force and power over their limits at the plan's feed."""
        force, power = (load.log_load + load.speed * speed + load.used_life * log_used for load in self._loads)
        reserve = (speed + self._over_base).clamp(max=0.0) - self._over_base.clamp(max=0.0)
        capacity = torch.exp(reserve) - self._idle * torch.exp(speed)
        return [force, power - torch.log(capacity.clamp(min=_MIN_CAPACITY))]


def log_over_half(used_life: Tensor) -> Tensor:
    """Return the logarithm of a used life over half a life, for tensors of any shape."""
    return torch.log(used_life.clamp(_MIN_USED_LIFE, 1.0) / single(USED_LIVES[MIDDLE]))


def _exp(value: Tensor) -> Tensor:
    """Return the exponential, which stays finite also for a job that makes no sense."""
    return torch.exp(value.clamp(-_MAX_LOG, _MAX_LOG))


def _wide(value: Tensor) -> Tensor:
    return value[:, None, None]
