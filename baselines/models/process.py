"""What a control is told of a cutting process, as power laws and limits, and what cutting costs (Sharmazanashvili 2008).

The edge's life and all that is limited are power laws of cutting speed V, feed S and depth of cut t:

    T = C_T / (V^mu S^nu t^rho)                                          life of the edge [min]
    q = 1/(V S t) + gamma/C_T V^(mu-1) S^(nu-1) t^(rho-1)                cost of metal [min/cm3]

with gamma the time to change an edge and the price of one, both in machine time [min]. Along a limit on V^alpha S^beta the cost
is least at the life

    T_0 = gamma ((alpha nu - beta mu) / (alpha - beta) - 1)              economic life [min]

A life is limited through the wear law: T is T_0 where the wear after T_0 minutes is the criterion.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turning_env import PowerLaw, Scenario

Array = NDArray[np.float64]

ALIKE = 1e-9
"""Up to what difference exponents are taken for equal."""
_LIVES = (1e-6, 1e6)  # [min]: what the economic lives 0 and infinity are taken for


@dataclass(frozen=True)
class Line:
    """Where a limit is reached at given cuts: cutting_speed log V + feed log S = room."""

    cutting_speed: float
    feed: float
    room: Array

    def highest_feed(self, log_cutting_speed: Array) -> Array:
        """Logarithm of the feed at which the limit is reached; infinite where more feed never reaches it."""
        if self.feed <= 0:
            return np.full(np.broadcast_shapes(self.room.shape, log_cutting_speed.shape), np.inf)
        return (self.room - self.cutting_speed * log_cutting_speed) / self.feed

    def highest_cutting_speed(self, log_feed: Array) -> Array:
        """Logarithm of the cutting speed at which the limit is reached; likewise."""
        return Line(self.feed, self.cutting_speed, self.room).highest_feed(log_feed)

    def crossing(self, other: "Line") -> tuple[Array, Array]:
        """Logarithms of cutting speed [m/min] and feed [mm/rev] at which two limits are both reached; not for parallel ones."""
        determinant = self.cutting_speed * other.feed - self.feed * other.cutting_speed
        log_speed = (self.room * other.feed - self.feed * other.room) / determinant
        log_feed = (self.cutting_speed * other.room - self.room * other.cutting_speed) / determinant
        return log_speed, log_feed


@dataclass(frozen=True)
class Limit:
    """The most that a power law may reach."""

    law: PowerLaw
    most: ArrayLike
    """In the unit of the law; one number, or an array."""
    time: float = 1.0
    """Cutting time of a fresh edge at which the law is taken [min]."""

    def parallel(self, other: "Limit") -> bool:
        """Whether the two fix no point, as cutting speed and feed enter them in the same proportion, or enter one not at all."""
        determinant = self.law.cutting_speed * other.law.feed - self.law.feed * other.law.cutting_speed
        return abs(determinant) <= ALIKE

    def line(self, depth_of_cut: ArrayLike, hardness: ArrayLike, wear: ArrayLike) -> Line:
        """Where it is reached at a depth of cut [mm], relative hardness [-] and flank wear [mm]: positive, arrays broadcast."""
        response = self.law(1.0, 1.0, depth_of_cut, self.time, wear, hardness)
        return Line(self.law.cutting_speed, self.law.feed, np.log(self.most) - np.log(response))

    def rescaled(self, scale: ArrayLike) -> Self:
        """The limit where the response is ``scale`` times what the law says [-]."""
        return replace(self, most=np.divide(self.most, scale))


@dataclass(frozen=True)
class Process:
    """Laws, limits and prices."""

    wear: PowerLaw
    """Flank wear of a fresh edge [mm]."""
    wear_criterion: float
    """[mm]"""
    thrust_force: Limit
    """[N]"""
    power: Limit
    """[kW]"""
    torque: Limit
    """[N m]"""
    cutting_speed_range: tuple[float, float]
    """[m/min]"""
    feed_range: tuple[float, float]
    """[mm/rev]"""
    edge_price: float
    """gamma: what an edge and its change cost [min]."""

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """What a control is told of a scenario.

        A scenario limits no torque. The spindle is taken to give its highest power from the geometric middle of the range of
        cutting speeds upwards, and below it the torque that it has there (assumption).
        """
        material, machine, limits, economics = scenario.material, scenario.machine, scenario.limits, scenario.economics
        torque_over_power = 30.0 * scenario.workpiece.diameter  # times V: 30000 / (pi n) with n = 1000 V / (pi D)
        torque = material.power.model_copy(
            update={
                "coefficient": material.power.coefficient * torque_over_power,
                "cutting_speed": material.power.cutting_speed - 1.0,
            }
        )
        middle_speed = math.sqrt(machine.cutting_speed_min * machine.cutting_speed_max)
        return cls(
            wear=material.wear,
            wear_criterion=scenario.tool.wear_criterion,
            thrust_force=Limit(material.thrust_force, limits.thrust_force),
            power=Limit(material.power, limits.power),
            torque=Limit(torque, limits.power * torque_over_power / middle_speed),
            cutting_speed_range=(machine.cutting_speed_min, machine.cutting_speed_max),
            feed_range=(machine.feed_min, machine.feed_max),
            edge_price=economics.edge_cost + economics.edge_change_time,
        )

    def rescaled(self, force_scale: ArrayLike, power_scale: ArrayLike) -> Self:
        """The process where thrust force, and power and torque, are so many times what their laws say [-], above 0."""
        return replace(
            self,
            thrust_force=self.thrust_force.rescaled(force_scale),
            power=self.power.rescaled(power_scale),
            torque=self.torque.rescaled(power_scale),
        )

    @property
    def mean_wear(self) -> float:
        """Mean wear over the life of an edge at constant parameters [mm]: the mean of W_max (t/T)^n."""
        return self.wear_criterion / (1.0 + self.wear.time)

    @property
    def life_exponents(self) -> tuple[float, float, float]:
        """mu, nu and rho [-]."""
        wear = self.wear
        return wear.cutting_speed / wear.time, wear.feed / wear.time, wear.depth_of_cut / wear.time

    def log_life(self, log_cutting_speed: Array, log_feed: Array, depth_of_cut: ArrayLike, hardness: ArrayLike) -> Array:
        """Logarithm of the life [min]; arrays that broadcast."""
        line = Limit(self.wear, self.wear_criterion).line(depth_of_cut, hardness, 1.0)
        room = line.room - line.cutting_speed * log_cutting_speed - line.feed * log_feed
        return np.asarray(room / self.wear.time)

    def log_cost(self, log_cutting_speed: Array, log_feed: Array, depth_of_cut: ArrayLike, hardness: ArrayLike) -> Array:
        """Logarithm of the cost of metal [min/cm3]; arrays that broadcast."""
        log_price = math.log(self.edge_price) if self.edge_price > 0 else -math.inf
        edges = log_price - self.log_life(log_cutting_speed, log_feed, depth_of_cut, hardness)
        return np.asarray(np.logaddexp(0.0, edges) - log_cutting_speed - log_feed - np.log(depth_of_cut))

    def economic_life(self, limit: Limit) -> float:
        """T_0 along a limit [min].

        Where the formula gives no life, the optimum lies where another limit ends this one: 0 if cost falls with rising removal
        rate all along it, infinite if it falls with rising life.
        """
        alpha, beta = limit.law.cutting_speed, limit.law.feed
        mu, nu, _ = self.life_exponents
        if abs(alpha - beta) <= ALIKE:
            return math.inf  # the removal rate is the same all along
        growth = (alpha * nu - beta * mu) / (alpha - beta)  # relative, of wear over that of the removal rate
        return math.inf if growth < 0 else self.edge_price * max(growth - 1.0, 0.0)

    def life_limit(self, limit: Limit) -> Limit:
        """The limit that the economic life along another limit sets to the wear."""
        least, most = _LIVES
        return Limit(self.wear, self.wear_criterion, min(max(self.economic_life(limit), least), most))

    def best_cutting_speed(self, feed: ArrayLike, depth_of_cut: ArrayLike, hardness: ArrayLike = 1.0) -> Array:
        """V* [m/min], where dq/dV = 0 at a feed [mm/rev]: the life is gamma (mu - 1).

        Infinite where mu is 1 or less, or edges cost nothing: then cost falls with rising cutting speed without end.
        """
        life = self.edge_price * (self.life_exponents[0] - 1.0)
        if life <= 0:
            return np.full(np.broadcast_shapes(np.shape(feed), np.shape(depth_of_cut), np.shape(hardness)), np.inf)
        line = Limit(self.wear, self.wear_criterion, life).line(depth_of_cut, hardness, 1.0)
        return np.asarray(np.exp(line.highest_cutting_speed(np.log(feed))))

    def best_feed(self, cutting_speed: ArrayLike, depth_of_cut: ArrayLike, hardness: ArrayLike = 1.0) -> Array:
        """S* [mm/rev], where dq/dS = 0 at a cutting speed [m/min]: the life is gamma (nu - 1).

        Infinite where nu is 1 or less, or edges cost nothing: then cost falls with rising feed without end.
        """
        life = self.edge_price * (self.life_exponents[1] - 1.0)
        if life <= 0:
            return np.full(np.broadcast_shapes(np.shape(cutting_speed), np.shape(depth_of_cut), np.shape(hardness)), np.inf)
        line = Limit(self.wear, self.wear_criterion, life).line(depth_of_cut, hardness, 1.0)
        return np.asarray(np.exp(line.highest_feed(np.log(cutting_speed))))
