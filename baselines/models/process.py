"""The nominal cutting process as power laws and limits, and the cost of cutting.

The edge's life and all limited responses are power laws of cutting speed V, feed S and depth of cut
t (Sharmazanashvili 2008):

    T = C_T / (V^mu S^nu t^rho)                              life of the edge [min]
    q = 1/(V S t) + gamma/C_T V^(mu-1) S^(nu-1) t^(rho-1)    cost of metal [min/cm3]

where gamma is the time to change an edge plus its price, both in machine time [min]. Along a limit
on V^alpha S^beta, the cost is least at the life T_0. The wear law turns it into a limit: T = T_0
where the wear after T_0 minutes equals the criterion.

    T_0 = gamma ((alpha nu - beta mu) / (alpha - beta) - 1)  economic life [min]

``Scales`` corrects the force and power of a model by measured ones.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from baselines.rule import Array, Mask
from turning_env import PowerLaw, Scenario
from turning_env.numerics.functions import exp, log
from turning_env.scenario.laws import edge_price, machining_cost

ALIKE = 1e-9  # tolerance for equal exponents
MIN_SCALE = 0.1  # lower bound of a scale [-]: no lathe cuts with a tenth of the nominal force
# In place of the economic lives 0 and infinity [min].
MIN_LIFE = 1e-6
MAX_LIFE = 1e6


@dataclass(frozen=True)
class LimitLine:
    """The line on which a limit is reached: cutting_speed log V + feed log S = room.

    ``cutting_speed`` and ``feed`` are exponents [-], V is in m/min and S in mm/rev.
    """

    cutting_speed: float
    feed: float
    room: Array

    def highest_feed(self, log_cutting_speed: Array) -> Array:
        """Return the log feed at which the limit is reached, or inf if no feed reaches it."""
        if self.feed <= 0:
            return np.full_like(self.room + log_cutting_speed, np.inf)
        return (self.room - self.cutting_speed * log_cutting_speed) / self.feed

    def highest_cutting_speed(self, log_feed: Array) -> Array:
        """Return the log cutting speed at which the limit is reached, or inf if none reaches it."""
        exchanged = LimitLine(cutting_speed=self.feed, feed=self.cutting_speed, room=self.room)
        return exchanged.highest_feed(log_feed)

    def crossing(self, other: "LimitLine") -> tuple[Array, Array]:
        """Return the log cutting speed and log feed at which this and another limit are reached.

        The lines must not be parallel.
        """
        # Cramer's rule.
        speed = self.cutting_speed
        feed = self.feed
        determinant = speed * other.feed - feed * other.cutting_speed
        speed_determinant = self.room * other.feed - feed * other.room
        feed_determinant = speed * other.room - self.room * other.cutting_speed
        log_speed = speed_determinant / determinant
        log_feed = feed_determinant / determinant
        return log_speed, log_feed


@dataclass(frozen=True)
class Limit:
    """A power law and its limit."""

    law: PowerLaw
    most: ArrayLike  # largest allowed response in the unit of the law; a number or an array
    time: float = 1.0  # cutting time of a fresh edge at which the law is taken [min]

    def parallel(self, other: "Limit") -> bool:
        """Return whether this and another limit fix no point.

        Their exponents are proportional, or all 0 in one of them.
        """
        determinant = (
            self.law.cutting_speed * other.law.feed - self.law.feed * other.law.cutting_speed
        )
        return abs(determinant) <= ALIKE

    def line(self, depth_of_cut: ArrayLike, hardness: ArrayLike, wear: ArrayLike) -> LimitLine:
        """Return the limit's line at a depth of cut [mm], relative hardness [-] and wear [mm].

        All are positive; they broadcast.
        """
        response = self.law(
            1.0, 1.0, depth_of_cut=depth_of_cut, time=self.time, wear=wear, hardness=hardness
        )
        return LimitLine(
            cutting_speed=self.law.cutting_speed,
            feed=self.law.feed,
            room=log(self.most) - log(response),
        )


class LifeExponents(NamedTuple):
    """Exponents of the edge's life [-]."""

    mu: float  # of cutting speed
    nu: float  # of feed
    rho: float  # of depth of cut


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
    """Further limits: of ``radial_force`` [N], ``torque`` [N m] and ``roughness`` [mm]."""

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """Return the nominal process of a scenario.

        The scenario's limit of torque holds. Without one, it follows from full spindle power at the
        base speed, and without that at the geometric middle of the range of cutting speeds
        (assumption). The idle torque is unknown.
        """
        material = scenario.material
        machine = scenario.machine
        limits = scenario.limits
        scenario_limits = {
            "radial_force": limits.radial_force,
            "torque": limits.torque,
            "roughness": limits.roughness,
        }
        further = {}
        for name, law in scenario_limits.items():
            if law.bounds:
                further[name] = Limit(law, law.most)
        return cls(
            wear=material.wear,
            wear_criterion=scenario.tool.wear_criterion,
            thrust_force=Limit(material.thrust_force, limits.thrust_force),
            power=Limit(material.power, limits.power),
            torque=further.get("torque", torque_limit(scenario)),
            cutting_speed_range=(machine.cutting_speed_min, scenario.cutting_speed_max),
            feed_range=scenario.feed_range,
            edge_price=edge_price(scenario),
            further=further,
        )

    def rescaled(self, force_scale: ArrayLike, power_scale: ArrayLike) -> Self:
        """Return the process with forces, and power and torque, scaled by factors [-] above 0."""
        scales: dict[str, ArrayLike] = {
            "thrust_force": force_scale,
            "radial_force": force_scale,
            "power": power_scale,
            "torque": power_scale,
        }

        def rescale(name: str, limit: Limit) -> Limit:
            # A response that grows by a factor meets its limit where the limit over the factor was.
            return replace(limit, most=np.divide(limit.most, scales.get(name, 1.0)))

        return replace(
            self,
            thrust_force=rescale("thrust_force", self.thrust_force),
            power=rescale("power", self.power),
            torque=rescale("torque", self.torque),
            further={name: rescale(name, limit) for name, limit in self.further.items()},
        )

    @property
    def mean_wear(self) -> float:
        """Mean wear over an edge's life at constant speed and feed [mm]: that of W_max (t/T)^n."""
        return self.wear_criterion / (1.0 + self.wear.time)

    @property
    def life_exponents(self) -> LifeExponents:
        """Exponents of the edge's life [-].

        Wear W = K vc^x f^y ap^z T^n reaches the criterion at a life T proportional to
        vc^(-x/n) f^(-y/n) ap^(-z/n).
        """
        wear = self.wear
        return LifeExponents(
            mu=wear.cutting_speed / wear.time,
            nu=wear.feed / wear.time,
            rho=wear.depth_of_cut / wear.time,
        )

    def log_life(
        self,
        log_cutting_speed: Array,
        log_feed: Array,
        depth_of_cut: ArrayLike,
        hardness: ArrayLike,
    ) -> Array:
        """Return the log life [min]; arrays broadcast.

        Log wear after T minutes is that after one minute plus n log T, with n the exponent of time.
        So log T is what that leaves to the criterion, over n.
        """
        line = Limit(self.wear, self.wear_criterion).line(depth_of_cut, hardness, wear=1.0)
        room = line.room - line.cutting_speed * log_cutting_speed - line.feed * log_feed
        return room / self.wear.time

    def log_cost(
        self,
        log_cutting_speed: Array,
        log_feed: Array,
        depth_of_cut: ArrayLike,
        hardness: ArrayLike,
    ) -> Array:
        """Return the log cost of metal [min/cm3]; arrays broadcast."""
        # q = (1 + gamma / T) / (V S t)
        log_life = self.log_life(
            log_cutting_speed, log_feed, depth_of_cut=depth_of_cut, hardness=hardness
        )
        log_minutes = log(machining_cost(1.0, exp(-log_life), self.edge_price))
        return np.asarray(log_minutes - log_cutting_speed - log_feed - log(depth_of_cut))

    def economic_life(self, limit: Limit) -> float:
        """Return the economic life T_0 along a limit [min], by the module's formula.

        If the formula gives no positive life, the optimum is where another limit ends this one: the
        life is 0 if the cost falls with rising removal rate all along the limit, infinite if it
        falls with rising life.
        """
        alpha = limit.law.cutting_speed
        beta = limit.law.feed
        exponents = self.life_exponents
        if abs(alpha - beta) <= ALIKE:
            return math.inf  # the removal rate is the same all along the limit
        # Relative growth of wear over that of the removal rate.
        growth = (alpha * exponents.nu - beta * exponents.mu) / (alpha - beta)
        if growth < 0:
            return math.inf
        return self.edge_price * max(growth - 1.0, 0.0)

    def life_limit(self, limit: Limit) -> Limit:
        """Return the limit of wear that an edge reaches after the economic life along a limit."""
        life = min(max(self.economic_life(limit), MIN_LIFE), MAX_LIFE)
        return Limit(self.wear, self.wear_criterion, time=life)


def torque_limit(scenario: Scenario) -> Limit:
    """Return the limit of torque [N m] that follows from full spindle power, see ``Process.of``."""
    machine = scenario.machine
    power = scenario.material.power
    # With P in kW, V in m/min, D in mm and n = 1000 V / (pi D), the torque is
    # 30000 P / (pi n) = 30 D P / V.
    torque_over_power = 30.0 * scenario.workpiece.diameter
    law = power.model_copy(
        update={
            "coefficient": power.coefficient * torque_over_power,
            "cutting_speed": power.cutting_speed - 1.0,
        }
    )
    middle_speed = math.sqrt(machine.cutting_speed_min * machine.cutting_speed_max)
    full_power_from = scenario.base_cutting_speed or middle_speed
    return Limit(law, scenario.limits.power * torque_over_power / full_power_from)


class Scales:
    """Scales of force and power: smoothed ratios of measured to predicted values.

    Args:
        num_envs: number of environments.
        smoothing: weight of the newest ratio [-].
    """

    def __init__(self, num_envs: int, smoothing: float) -> None:
        self._smoothing = smoothing
        self._force = np.ones(num_envs)
        self._power = np.ones(num_envs)

    def reset(self, mask: Mask) -> None:
        """Return to the model's force and power."""
        self._force[mask] = 1.0
        self._power[mask] = 1.0

    def follow(self, mask: Mask, force_ratio: Array, power_ratio: Array) -> tuple[Array, Array]:
        """Move the scales of a mask towards new ratios; return those of force and power."""
        share = np.where(mask, self._smoothing, 0.0)
        self._force += share * (force_ratio - self._force)
        self._power += share * (power_ratio - self._power)
        force = np.maximum(self._force, MIN_SCALE)
        power = np.maximum(self._power, MIN_SCALE)
        return force, power
