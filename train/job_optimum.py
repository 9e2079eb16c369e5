"""The prices of time and edge life in jobs, and the expected gain of commands, by laws that a filter estimates.

A network computes them in every step, so prices are simpler than in ``baselines/models/edge_value.py``: bars are as expected, and
loads stay within their limits if the chip breaker allows it. At a price t of time, a job earns nothing at used share D of an
edge's life if life has the price

    p(D) = max over set points of (value of metal - t) / life used per time,

and t is such that a whole edge just pays for itself and its change (Newton's method).

The expected gain is that of ``baselines/models/feed_search.py``, but its functions are elementary: every program gives the same
result. The logarithm of a load has a logistic distribution of scale s about its mean L, not a normal one. Its expected
distance above 0 is h = s log(1 + exp(L / s)), and the overload exp(h) - 1.

Cutting speeds and feeds are logarithms over the plan's at half a life. Prices are those of a minute [-] and of a life [min].
"""

import math
from typing import NamedTuple

import torch

from train.newton_search import Pair, Slopes, single
from turning_env.scenario.plan import MIDDLE, USED_LIVES

Tensor = torch.Tensor
Nominal = dict[str, Tensor]
"""Numbers of the context by name, not standardised, each of shape (num_envs,)."""

SET_POINT = tuple(f"{name}_at_{USED_LIVES[MIDDLE]}" for name in ("speed", "feed"))
"""Names of the context's numbers that tell the plan's speed and feed at half a life: logarithms over the lowest ones."""
LIVES = 6
"""Number of used shares of the life at which it is priced, beside the present one."""
SPEEDS = 24
"""Number of cutting speeds that are compared, evenly spaced on a logarithmic scale."""
MIN_EXPONENT = single(0.1)
"""Smallest exponent of the feed in a load, and of time in wear [-]."""
_NEWTON_STEPS = 8
_MAX_LOG = single(20.0)
_MIN_CAPACITY = single(1e-3)  # of the spindle, less idle power, over that at the plan's speed
_MIN_RATE_EXPONENT = single(1.1)  # of speed: at 1, an edge would cut as many meters at any speed
_CORNER = single(0.003**2)  # square of the log distance from the base speed within which the limit of power bends smoothly
_PER_SPREAD = single(math.sqrt(3.0) / math.pi)  # scale of a logistic distribution over its standard deviation
_NORMAL = single(1.5976), single(0.07056), single(3.0 * 0.07056)  # the normal distribution is near sigmoid(a z + b z^3); 3 b
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


class LifeRate(NamedTuple):
    """Estimated rate at which life is used, by a power law; every field has shape (num_envs,)."""

    log_rate: Tensor
    """Logarithm at the plan's set point [1/min]."""
    speed: Tensor
    """Exponent of cutting speed."""
    feed: Tensor
    """Exponent of feed."""


class Ahead(NamedTuple):
    """Cutting conditions at points in time; fields have shape (num_envs, points), or (num_envs, 1) if constant."""

    speed: Tensor
    """Actual cutting speed."""
    feed: Tensor
    """Actual feed."""
    slow: Tensor
    """Share of a deviation of the speed from its command that remains [-]."""
    late: Tensor
    """Likewise of the feed."""
    cutting: Tensor
    """1 in metal, 0 in air."""
    metal: Tensor
    """Logarithm of the depth of cut over that in the expected bar; 0 in air."""
    wear: Tensor
    """Logarithm of the rate at which life is used likewise."""
    loads: Tensor
    """Logarithms of force and power over their limits at the plan's set point, shape (num_envs, 2, points)."""
    spreads: Tensor
    """Their standard deviations, likewise."""
    strength_spread: Tensor
    """Standard deviation of the logarithm of the force over the edge's strength."""
    breakage_price: Tensor
    """Price of breaking the edge over the length of a step [-], in metal of a bar that has not been measured; else 0."""


class ExpectedGain:
    """The expected gain [-] of commands: value of metal less the prices of the life used, of overload and of breaking the edge.

    Args:
        ahead: what lies ahead.
        logs: logarithms of value of metal, rate of wear, and force and power over their limits, at the plan's set point,
            shape (num_envs, 4, points).
        by_speed: their exponents of speed, shape (num_envs, 4, 1).
        by_feed: their exponents of feed, likewise.
        worth: what metal is worth, and what a life costs as a negative number, shape (num_envs, 2, points).
        overload_price: see ``JobOptimum``, shape (num_envs, 1, 1).
        log_strength: logarithm of the edge's strength over the limit of force, shape (num_envs, 1, 1).
        over_base: logarithm of the plan's speed over the base speed, likewise.
        idle: idle power at the plan's speed over what the spindle can give there, likewise.
    """

    def __init__(
        self,
        ahead: Ahead,
        logs: Tensor,
        by_speed: Tensor,
        by_feed: Tensor,
        worth: Tensor,
        overload_price: Tensor,
        log_strength: Tensor,
        over_base: Tensor,
        idle: Tensor,
    ) -> None:
        self._speed, self._feed = ahead.speed.unsqueeze(1), ahead.feed.unsqueeze(1)
        self._follows = (1.0 - ahead.slow).unsqueeze(1), (1.0 - ahead.late).unsqueeze(1)
        self._logs, self._worth = logs, worth
        self._by_speed, self._by_feed, self._feed_slope = by_speed, by_feed, by_feed * self._follows[1]
        self._over_base, self._idle = over_base, idle
        self._power = torch.tensor([0.0, 0.0, 0.0, 1.0], dtype=logs.dtype, device=logs.device).view(1, 4, 1)
        self._scale = _PER_SPREAD * ahead.spreads
        self._price = overload_price * ahead.cutting.unsqueeze(1)
        self._strength, self._per_strength = log_strength, 1.0 / ahead.strength_spread.unsqueeze(1)
        self._breakage_price = ahead.breakage_price.unsqueeze(1)

    def __call__(self, x: Tensor, y: Tensor) -> Slopes:
        """Return the mean gain over all points in time of commands of speed x and feed y, each of shape (num_envs,)."""
        speed = self._speed + self._follows[0] * (_wide(x) - self._speed)
        feed = self._feed + self._follows[1] * (_wide(y) - self._feed)
        capacity, limit_x, limit_xx = self._log_capacity(speed)
        logs = self._logs + self._by_speed * speed + self._by_feed * feed - self._power * capacity
        by_x, by_y = (self._by_speed - self._power * limit_x) * self._follows[0], self._feed_slope
        earned, loads = self._worth * _exp(logs[:, :2]), logs[:, 2:]

        ratio = loads / self._scale
        chance, safe = torch.sigmoid(ratio), torch.sigmoid(-ratio)
        beyond = torch.relu(ratio) - torch.log(torch.sigmoid(ratio.abs()))
        price = self._price * _exp(self._scale * beyond)  # of the expected load over its limit, at least 1
        slope = price * chance

        deviation = (loads[:, :1] - self._strength) * self._per_strength
        square = deviation.square()
        steep = _NORMAL[0] + _NORMAL[2] * square
        breaks = torch.sigmoid((_NORMAL[0] + _NORMAL[1] * square) * deviation)
        risk = self._breakage_price * breaks
        risk_slope = risk * (1.0 - breaks) * steep
        risk_bend = risk_slope * ((1.0 - 2.0 * breaks) * steep + 2.0 * _NORMAL[2] * deviation / steep)

        values = torch.cat([earned, self._price - price, -risk], dim=1)
        slopes = torch.cat([earned, -slope, -risk_slope], dim=1)
        bends = torch.cat([earned, -slope * (chance + safe / self._scale), -risk_bend], dim=1)
        by_x, by_y = (torch.cat([each, each[:, 2:3] * self._per_strength], dim=1) for each in (by_x, by_y))
        points, bends_x = values.shape[-1], bends * by_x
        curved = slope[:, 1:] * limit_xx * self._follows[0].square()
        totals = values, slopes * by_x, slopes * by_y, bends_x * by_x, bends_x * by_y, bends * by_y.square()
        gain, by_x, by_y, by_xx, by_xy, by_yy = (each.sum(dim=(1, 2)) / points for each in totals)
        return Slopes(gain, by_x, by_y, by_xx + curved.sum(dim=(1, 2)) / points, by_xy, by_yy)

    def start(self) -> Pair:
        """Return the actual speed, and the highest feed at which it keeps loads below their limits where the tool cuts."""
        logs = self._logs + self._by_speed * self._speed - self._power * self._log_capacity(self._speed)[0]
        feeds = -(logs[:, 2:] + self._scale) / self._by_feed[:, 2:].clamp(min=MIN_EXPONENT)
        return self._speed[:, 0, 0], torch.where(self._price > 0.0, feeds, _MAX_LOG).amin(dim=(1, 2))

    def log_loads(self, x: Tensor, y: Tensor) -> Tensor:
        """Return the mean logarithms of force and power over their limits at a speed and a feed, shape (num_envs, 2)."""
        logs = self._logs + self._by_speed * _wide(x) + self._by_feed * _wide(y)
        return (logs - self._power * self._log_capacity(_wide(x))[0])[:, 2:].mean(dim=-1)

    def _log_capacity(self, speed: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return the logarithm of the power left for cutting over the spindle's at the plan's speed; derivatives."""
        above, idle = speed + self._over_base, self._idle * torch.exp(speed)
        root = torch.sqrt(above.square() + _CORNER)
        reserve = torch.exp(0.5 * (above - root) - self._over_base.clamp(max=0.0))
        slope, bend = 0.5 - 0.5 * above / root, (-0.5 * _CORNER) / (root * root * root)
        left = (reserve - idle).clamp(min=_MIN_CAPACITY)
        by_speed = (reserve * slope - idle) / left
        return torch.log(left), by_speed, (reserve * (slope.square() + bend) - idle) / left - by_speed.square()


class JobOptimum:
    """Estimated jobs, one for each environment.

    Args:
        nominal: the nominal models' numbers.
        loads: force and power.
        life_rate: rate at which a usual edge is used up.
        overload_price: price of a minute with a load 100 % over its limit [min], shape (num_envs,).
    """

    def __init__(self, nominal: Nominal, loads: tuple[Load, Load], life_rate: LifeRate, overload_price: Tensor) -> None:
        self._loads = [Load(*map(_wide, load)) for load in loads]
        self._overload_price, self._log_strength = _wide(overload_price), _wide(nominal["log_edge_strength"])
        self._change, self._cost = (_exp(nominal[f"log_edge_{name}"]) for name in ("change_time", "price"))
        # A minute of the plan's set point, edges included, is worth a minute.
        self._log_metal = _wide(torch.log(1.0 + (self._cost + self._change) * _exp(-nominal["log_life"])))
        self._log_rate, self._rate_feed = _wide(life_rate.log_rate), _wide(life_rate.feed)
        self._rate_speed = _wide(life_rate.speed.clamp(min=_MIN_RATE_EXPONENT))
        self._over_base, self._idle = _wide(nominal["log_speed_over_base_speed"]), _wide(_exp(nominal["log_idle_power"]))
        speed, feed = (nominal[name] for name in SET_POINT)
        self._lowest_feed, self._highest_feed = (_wide(nominal[f"log_{end}_feed"] - feed) for end in ("lowest", "highest"))
        slowest, fastest = _wide(-speed), _wide(-nominal["log_speed_over_fastest"])
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

    def life_rate(self, speed: Tensor, feed: Tensor) -> Tensor:
        """Return the rate at which life is used in the expected bar [1/min], shape (num_envs,)."""
        return self._metal_and_life(_wide(speed), _wide(feed))[1][:, 0, 0]

    def gain(self, ahead: Ahead, life_price: Tensor) -> "ExpectedGain":
        """Return the expected gain of the next steps as a function of commands; ``life_price``: shape (num_envs,)."""
        one = torch.ones_like(self._rate_speed)
        by_speed = torch.cat([one, self._rate_speed, *(load.speed for load in self._loads)], dim=1)
        by_feed = torch.cat([one, self._rate_feed, *(load.feed for load in self._loads)], dim=1)
        metal, rate = self._log_metal + ahead.metal.unsqueeze(1), self._log_rate + ahead.wear.unsqueeze(1)
        return ExpectedGain(
            ahead,
            torch.cat([metal, rate, ahead.loads], dim=1),
            by_speed,
            by_feed,
            torch.cat([one.expand_as(metal), -_wide(life_price) * ahead.cutting.unsqueeze(1)], dim=1),
            self._overload_price,
            self._log_strength,
            self._over_base,
            self._idle,
        )

    def _outcome(self, log_used: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return value of metal, price of overload [-] and life used [1/min] in the expected bar, (num_envs, lives, SPEEDS).

        The feed is the highest within the limits, but within the chip breaker's window.
        """
        logs = zip(self._without_feed(self._speeds, log_used), self._loads, strict=True)
        highest = torch.minimum(*(-log / load.feed.clamp(min=MIN_EXPONENT) for log, load in logs))
        feed = torch.minimum(torch.maximum(highest, self._lowest_feed), self._highest_feed)
        metal, rate = self._metal_and_life(self._speeds, feed)
        return metal, self._overload_price * torch.relu(feed - highest), rate

    def _metal_and_life(self, speed: Tensor, feed: Tensor) -> tuple[Tensor, Tensor]:
        """Return value of metal [-] and life used [1/min] at set points in the expected bar."""
        rate = _exp(self._log_rate + self._rate_speed * speed + self._rate_feed * feed)
        return _exp(self._log_metal + speed + feed), rate

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
