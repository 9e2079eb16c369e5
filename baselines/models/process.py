"""The nominal cutting process as power laws and limits, the cost of cutting (Sharmazanashvili 2008), and scales of its loads.

The edge's life and all limited responses are power laws of cutting speed V, feed S and depth of cut t:

    T = C_T / (V^mu S^nu t^rho)                                          life of the edge [min]
    q = 1/(V S t) + gamma/C_T V^(mu-1) S^(nu-1) t^(rho-1)                cost of metal [min/cm3]

where gamma is the time to change an edge plus its price, both in machine time [min]. Along a limit on V^alpha S^beta, the cost
is least at the life below. The wear law turns it into a limit: T = T_0 where the wear after T_0 minutes equals the criterion.

    T_0 = gamma ((alpha nu - beta mu) / (alpha - beta) - 1)              economic life [min]
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from baselines.rule import Array, Mask
from turning_env import PowerLaw, Scenario
from turning_env.numerics.functions import exp, log

ALIKE = 1e-9  # tolerance for equal exponents
MIN_SCALE = 0.1  # lower bound of a scale [-]: no lathe cuts with a tenth of the nominal force
_LIVES = (1e-6, 1e6)  # in place of the economic lives 0 and infinity [min]


@dataclass(frozen=True)
class Line:
    """The line on which a limit is reached: cutting_speed log V + feed log S = room."""

    cutting_speed: float
    feed: float
    room: Array

    def highest_feed(self, log_cutting_speed: Array) -> Array:
        """Return the log feed at which the limit is reached, infinite if more feed never reaches it."""
        if self.feed <= 0:
            return np.full_like(self.room + log_cutting_speed, np.inf)
        return (self.room - self.cutting_speed * log_cutting_speed) / self.feed

    def highest_cutting_speed(self, log_feed: Array) -> Array:
        """Return the log cutting speed at which the limit is reached, infinite if more speed never reaches it."""
        return Line(self.feed, self.cutting_speed, self.room).highest_feed(log_feed)

    def crossing(self, other: "Line") -> tuple[Array, Array]:
        """Return log cutting speed [m/min] and log feed [mm/rev] at which this and another, not parallel, limit are reached."""
        determinant = self.cutting_speed * other.feed - self.feed * other.cutting_speed
        log_speed = (self.room * other.feed - self.feed * other.room) / determinant
        return log_speed, (
            self.cutting_speed * other.room - self.room * other.cutting_speed
        ) / determinant


@dataclass(frozen=True)
class Limit:
    """A power law and its limit."""

    law: PowerLaw
    most: ArrayLike  # largest allowed response in the unit of the law; a number or an array
    time: float = 1.0  # cutting time of a fresh edge at which the law is taken [min]

    def parallel(self, other: "Limit") -> bool:
        """Return whether two limits fix no point: their exponents are proportional, or all 0 in one of them."""
        determinant = (
            self.law.cutting_speed * other.law.feed - self.law.feed * other.law.cutting_speed
        )
        return abs(determinant) <= ALIKE

    def line(self, depth_of_cut: ArrayLike, hardness: ArrayLike, wear: ArrayLike) -> Line:
        """Return the limit's line at a depth of cut [mm], relative hardness [-] and flank wear [mm], positive; they broadcast."""
        response = self.law(1.0, 1.0, depth_of_cut, self.time, wear, hardness)
        return Line(self.law.cutting_speed, self.law.feed, log(self.most) - log(response))


@dataclass(frozen=True)
class Process:
    """Laws, limits and prices."""

    wear: PowerLaw  # flank wear of a fresh edge [mm]
    wear_criterion: float  # [mm]
    thrust_force: Limit  # [N]
    power: Limit  # [kW]
    torque: Limit  # [N m]
    cutting_speed_range: tuple[float, float]  # [m/min]
    feed_range: tuple[float, float]  # [mm/rev]
    edge_price: float  # gamma: price of an edge and of its change [min]
    further: Mapping[str, Limit] = field(default_factory=dict)
    """Further limits of the scenario: of ``radial_force`` [N], ``torque`` [N m] and ``roughness`` [mm]."""

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """Return the nominal process of a scenario.

        The scenario's limit of torque holds. Without one it follows from full spindle power at the base speed, and without that
        at the geometric middle of the range of cutting speeds (assumption). The idle torque is unknown.
        """
        material, machine, limits, economics = (
            scenario.material,
            scenario.machine,
            scenario.limits,
            scenario.economics,
        )
        torque_over_power = (
            30.0 * scenario.workpiece.diameter
        )  # times V: 30000 / (pi n) with n = 1000 V / (pi D)
        coefficient, exponent = (
            material.power.coefficient * torque_over_power,
            material.power.cutting_speed - 1.0,
        )
        torque = material.power.model_copy(
            update={"coefficient": coefficient, "cutting_speed": exponent}
        )
        full_power_from = scenario.base_cutting_speed or math.sqrt(
            machine.cutting_speed_min * machine.cutting_speed_max
        )
        laws = {
            "radial_force": limits.radial_force,
            "torque": limits.torque,
            "roughness": limits.roughness,
        }
        further = {name: Limit(law, law.most) for name, law in laws.items() if law.bounds}
        return cls(
            wear=material.wear,
            wear_criterion=scenario.tool.wear_criterion,
            thrust_force=Limit(material.thrust_force, limits.thrust_force),
            power=Limit(material.power, limits.power),
            torque=further.get(
                "torque", Limit(torque, limits.power * torque_over_power / full_power_from)
            ),
            cutting_speed_range=(machine.cutting_speed_min, scenario.cutting_speed_max),
            feed_range=scenario.feed_range,
            edge_price=economics.edge_cost + economics.edge_change_time,
            further=further,
        )

    def rescaled(self, force_scale: ArrayLike, power_scale: ArrayLike) -> Self:
        """Return the process with the forces, and power and torque, scaled by factors [-] above 0."""
        scales = dict.fromkeys(("thrust_force", "radial_force"), force_scale) | dict.fromkeys(
            ("power", "torque"), power_scale
        )

        def rescaled(limits: Mapping[str, Limit]) -> Any:
            return {
                key: replace(limit, most=np.divide(limit.most, scales.get(key, 1.0)))
                for key, limit in limits.items()
            }

        own = rescaled({name: getattr(self, name) for name in ("thrust_force", "power", "torque")})
        return replace(self, **own, further=rescaled(self.further))

    @property
    def mean_wear(self) -> float:
        """Mean wear over the life of an edge at constant speed and feed [mm]: the mean of W_max (t/T)^n."""
        return self.wear_criterion / (1.0 + self.wear.time)

    @property
    def life_exponents(self) -> tuple[float, float, float]:
        """mu, nu and rho [-]."""
        wear = self.wear
        return wear.cutting_speed / wear.time, wear.feed / wear.time, wear.depth_of_cut / wear.time

    def log_life(
        self,
        log_cutting_speed: Array,
        log_feed: Array,
        depth_of_cut: ArrayLike,
        hardness: ArrayLike,
    ) -> Array:
        """Return the log life [min]; arrays broadcast."""
        line = Limit(self.wear, self.wear_criterion).line(depth_of_cut, hardness, 1.0)
        return (
            line.room - line.cutting_speed * log_cutting_speed - line.feed * log_feed
        ) / self.wear.time

    def log_cost(
        self,
        log_cutting_speed: Array,
        log_feed: Array,
        depth_of_cut: ArrayLike,
        hardness: ArrayLike,
    ) -> Array:
        """Return the log cost of metal [min/cm3]; arrays broadcast."""
        log_price = log(self.edge_price) if self.edge_price > 0 else -math.inf
        edges = log_price - self.log_life(log_cutting_speed, log_feed, depth_of_cut, hardness)
        return np.asarray(log(1.0 + exp(edges)) - log_cutting_speed - log_feed - log(depth_of_cut))

    def economic_life(self, limit: Limit) -> float:
        """Return T_0 along a limit [min].

        If the formula gives no life, the optimum is where another limit ends this one: the life is 0 if the cost falls with
        rising removal rate all along the limit, infinite if it falls with rising life.
        """
        alpha, beta = limit.law.cutting_speed, limit.law.feed
        mu, nu, _ = self.life_exponents
        if abs(alpha - beta) <= ALIKE:
            return math.inf  # the removal rate is the same all along
        growth = (alpha * nu - beta * mu) / (
            alpha - beta
        )  # relative, of wear over that of the removal rate
        return math.inf if growth < 0 else self.edge_price * max(growth - 1.0, 0.0)

    def life_limit(self, limit: Limit) -> Limit:
        """Return the limit of wear for the economic life along a limit."""
        return Limit(
            self.wear,
            self.wear_criterion,
            min(max(self.economic_life(limit), _LIVES[0]), _LIVES[1]),
        )


class Scales:
    """Scales of force and power: ratios of measured to predicted values, smoothed by a weight of the newest ratio [-]."""

    def __init__(self, num_envs: int, smoothing: float) -> None:
        self._smoothing, self._scales = smoothing, np.ones((2, num_envs))

    def reset(self, mask: Mask) -> None:
        """Return to the model's force and power."""
        self._scales[:, mask] = 1.0

    def follow(self, mask: Mask, force_ratio: Array, power_ratio: Array) -> Array:
        """Move the scales of the masked environments towards new ratios; return those of force and power, shape (2, num_envs)."""
        self._scales += np.where(mask, self._smoothing, 0.0) * (
            np.stack([force_ratio, power_ratio]) - self._scales
        )
        return np.maximum(self._scales, MIN_SCALE)
