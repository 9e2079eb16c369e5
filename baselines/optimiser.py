"""A constrained optimiser of the next interval, on the states that a Kalman filter estimates.

In every control interval it chooses, among the cutting speeds and feeds that can be reached, those that promise most:

    value of metal - price of the life used - price of overload - price of breakage

Force and power are log-normal with the filter's means and variances, so that the expectation of what exceeds a limit has a closed
form (that of an option, Black and Scholes 1973), and so has the risk that an unmeasured bar breaks the edge. The price of the
edge's life comes from dynamic programming (``edge_value.py``). The feed is searched with SciPy for each of a ladder of cutting
speeds, of all lanes at once; a parabola through the best three of the ladder gives the speed between them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize.elementwise import find_minimum
from scipy.special import ndtr

from baselines.models.edge_value import USED_LIVES, expected_excess, prices_of_life
from baselines.models.kalman import Array, LoadFilter, Outlook, decay, feed_velocity
from baselines.rule import Range, Rule
from turning_env import PowerLaw, Reading, Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.score.policy import Actions, Observations

POINTS = 3
"""Points of an interval at which loads are predicted."""
SPEEDS = 7
"""Cutting speeds that are tried, from the lowest that can be reached to the highest."""
FEED_TOLERANCE = 3e-3
"""To which the logarithm of the best feed is searched."""
MIN_SPREAD = 1e-3
"""Of the logarithms of force and power [-], so that expectations stay smooth where nothing varies."""
MIN_USED_LIFE = 1e-9
"""Taken for an edge that has not cut [-]: the laws know no unworn edge."""
_WALL = (0.01, 1e9)  # how far beyond the reach of the feed the search may look, and how fast the gain falls there


class Prospect(NamedTuple):
    """What counts for the next interval. A field has shape (lanes,), or (lanes, points) for points ahead of the tool."""

    log_speed: Array
    """Actual cutting speed now [log m/min]."""
    log_feed: Array
    """Actual feed now [log mm/rev]."""
    used_life: Array
    """Share of the edge's life that the nominal model thinks used [-]."""
    breakage_price: Array
    """What breaking the edge costs [s]."""
    metal_value: Array
    """Value of metal over cutting speed and feed [per m/min and mm/rev], at points."""
    life_price: Array
    """Price of a life [s] that is used at the rate of nominal depth and hardness, at points."""
    log_force: Array
    """Logarithm of thrust force over the nominal model's [-], at points; and so on."""
    log_power: Array
    force_spread: Array
    """Standard deviation of ``log_force`` [-], at points; and so on."""
    power_spread: Array
    cutting: Array
    """1 where the tool is in metal, 0 in air, at points."""
    unmeasured: Array
    """1 where it is in metal of a bar that has not been measured, else 0, at points."""

    def of(self, lane: NDArray[np.intp]) -> "Prospect":
        """The prospect of single lanes, in any order and any number of times."""
        return Prospect(*(field[lane] for field in self))


class LogLaw:
    """The logarithm of a response over the most that it may reach, at nominal depth and hardness."""

    def __init__(self, law: PowerLaw, scenario: Scenario, most: float) -> None:
        self._law = law
        at_one = law(1.0, 1.0, scenario.workpiece.depth_of_cut, wear=scenario.tool.wear_criterion)
        self._constant = float(np.log(at_one / most))

    def __call__(self, log_speed: Array, log_feed: Array, log_wear: Array | float = 0.0) -> Array:
        """From logarithms of cutting speed [m/min], feed [mm/rev] and wear over its criterion [-]; arrays broadcast."""
        law = self._law
        return self._constant + law.cutting_speed * log_speed + law.feed * log_feed + law.wear * log_wear


class Optimiser:
    """Chooses each interval's cutting speed and feed by what it expects of that interval alone.

    Args:
        scenario: what is played.
        lanes: how many lanes it controls.
        severity: factor on the price of overload [-]; above 1, limits are held better than pays.
        caution: factor on the standard deviations of force and power [-].
    """

    def __init__(self, scenario: Scenario, num_envs: int, severity: float, caution: float) -> None:
        self._scenario, self._caution = scenario, caution
        self._overload_price = severity * scenario.economics.overload_price
        material, limits, tool = scenario.material, scenario.limits, scenario.tool
        self._wear = LogLaw(material.wear, scenario, tool.wear_criterion)
        self._force = LogLaw(material.thrust_force, scenario, limits.thrust_force)
        self._power = LogLaw(material.power, scenario, limits.power)
        self._log_strength = float(np.log(tool.edge_strength / limits.thrust_force))
        self._prices = prices_of_life(scenario, self._overload_price)
        self._filter = LoadFilter(scenario, num_envs)
        self._look_at(scenario.control.interval * (np.arange(POINTS) + 0.5) / POINTS)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget what was estimated."""
        self._filter.reset(mask)

    def act(self, observations: Observations) -> Actions:
        """Actions for observations, both of one row per lane."""
        reading = read(observations, self._scenario)
        self._filter.observe(reading)
        return towards(reading, self._scenario, *self._set_point(reading), self._spent(reading))

    def _used_life(self, reading: Reading) -> tuple[Array, Array]:
        """Share of the edge's life that is used [-]: as the nominal model thinks, and as the filter does."""
        exponent = self._scenario.material.wear.time
        nominal = (reading.nominal_wear / self._scenario.tool.wear_criterion) ** (1.0 / exponent)
        nominal = np.maximum(nominal, MIN_USED_LIFE)
        return nominal, nominal * np.exp(self._filter.log_wear_factor / exponent)

    def _spent(self, reading: Reading) -> NDArray[np.bool_]:
        """Whether to change the edge: its life is worth nothing any more, or may, at one standard deviation, be over."""
        _, used_life = self._used_life(reading)
        over = used_life * np.exp(self._filter.wear_doubt / self._scenario.material.wear.time) >= 1.0
        worthless = np.interp(used_life, USED_LIVES, self._prices) <= 0.0
        return (reading.nominal_wear > 0.0) & (over | worthless)

    def _look_at(self, times: Array) -> None:
        """Predict at these times after an interval's start [s]."""
        self._times = times
        self._spindle_left = decay(times, self._scenario.machine.spindle_time_constant)
        self._feed_left = decay(times, self._scenario.machine.feed_time_constant)

    def _set_point(self, reading: Reading) -> tuple[Array, Array]:
        """Cutting speed [m/min] and feed [mm/rev] to command, each of shape (lanes,)."""
        velocity = feed_velocity(self._scenario, reading.commanded_cutting_speed, reading.commanded_feed)
        outlook = self._filter.ahead(velocity[:, np.newaxis] * self._times)
        cutting = np.ones(outlook.log_force.shape)
        unmeasured = cutting - self._filter.measured[:, np.newaxis]
        return self._best(reading, self._prospect(reading, outlook, cutting, unmeasured))

    def _prospect(self, reading: Reading, outlook: Outlook, cutting: Array, unmeasured: Array) -> Prospect:
        """The prospect of a tool that is to meet what the outlook says, if it cuts."""
        economics, law = self._scenario.economics, self._scenario.material.wear
        nominal_depth = self._scenario.workpiece.depth_of_cut
        used_life, estimated = self._used_life(reading)
        price = np.interp(estimated, USED_LIVES, self._prices)
        wear = law.depth_of_cut * np.log(outlook.depth_of_cut / nominal_depth) + law.hardness * outlook.log_hardness
        left = np.maximum(1.0 - used_life, 0.0)
        # Air is worth crossing as fast as metal would be: it takes time, but nothing else.
        depth = np.where(cutting > 0, outlook.depth_of_cut, nominal_depth)
        return Prospect(
            log_speed=np.log(reading.cutting_speed),
            log_feed=np.log(reading.feed),
            used_life=used_life,
            breakage_price=60.0 * (left * (economics.edge_cost + economics.edge_change_time) + economics.breakage_downtime),
            metal_value=depth / economics.reference_removal_rate,
            life_price=price[:, np.newaxis] * np.exp(wear / law.time),
            log_force=outlook.log_force,
            log_power=outlook.log_power,
            force_spread=outlook.force_spread,
            power_spread=outlook.power_spread,
            cutting=cutting,
            unmeasured=unmeasured,
        )

    def _gain(self, log_speed: Array, log_feed: Array, prospect: Prospect) -> Array:
        """Expected mean gain [s of machine time per s] with these commands, one per lane of the prospect."""
        tool, exponent = self._scenario.tool, self._scenario.material.wear.time
        speed, feed = log_speed[:, np.newaxis], log_feed[:, np.newaxis]
        speed = speed + (prospect.log_speed[:, np.newaxis] - speed) * self._spindle_left
        feed = feed + (prospect.log_feed[:, np.newaxis] - feed) * self._feed_left
        life_rate = np.exp(self._wear(speed, feed) / exponent) / 60.0  # [1/s]
        wear = exponent * np.log(prospect.used_life[:, np.newaxis] + life_rate * self._times)
        force = self._force(speed, feed, wear) + prospect.log_force
        power = self._power(speed, feed, wear) + prospect.log_power
        excess = self._excess(force, prospect.force_spread) + self._excess(power, prospect.power_spread)
        cost = prospect.life_price * life_rate + self._overload_price * excess
        gain = prospect.metal_value * np.exp(speed + feed) - prospect.cutting * cost
        doubt = np.maximum(np.hypot(prospect.force_spread, tool.edge_strength_spread), MIN_SPREAD)
        risk = np.max(prospect.unmeasured * ndtr((force - self._log_strength) / doubt), axis=1)
        return np.asarray(gain.mean(axis=1) - prospect.breakage_price * risk / self._scenario.control.interval)

    def _excess(self, log_load: Array, spread: Array) -> Array:
        return expected_excess(log_load, np.maximum(self._caution * spread, MIN_SPREAD))

    def _best(self, reading: Reading, prospect: Prospect) -> tuple[Array, Array]:
        """The cutting speed and feed within reach that promise most."""
        slowest, fastest = self._reach(reading.commanded_cutting_speed, "cutting_speed")
        least, most = self._reach(reading.commanded_feed, "feed")
        speeds = np.linspace(slowest, fastest, SPEEDS, axis=1)
        lanes = np.repeat(np.arange(float(len(least))), SPEEDS)  # of each speed of each ladder

        def loss(feed: Array, speed: Array, lane: Array) -> Array:
            i = lane.astype(np.intp)
            within = np.clip(feed, least[i], most[i])
            return _WALL[1] * np.abs(feed - within) - self._gain(speed, within, prospect.of(i))

        low, high = np.repeat(least, SPEEDS), np.repeat(most, SPEEDS)
        found = find_minimum(
            loss,
            (low - _WALL[0], 0.5 * (low + high), high + _WALL[0]),
            args=(speeds.ravel(), lanes),
            tolerances={"xatol": FEED_TOLERANCE, "xrtol": 0.0, "fatol": 0.0, "frtol": 0.0},
        )
        feeds = np.clip(found.x, low, high).reshape(speeds.shape)
        speed, feed = self._between(speeds, feeds, -found.f_x.reshape(speeds.shape), prospect)
        return np.exp(speed), np.exp(feed)

    def _between(self, speeds: Array, feeds: Array, gains: Array, prospect: Prospect) -> tuple[Array, Array]:
        """The best of each lane's ladder, or what a parabola through it and its neighbours gives, if that is better."""
        lanes = np.arange(len(gains))
        top = np.argmax(gains, axis=1)
        middle = np.clip(top, 1, SPEEDS - 2)
        around = lanes[:, np.newaxis], middle[:, np.newaxis] + np.array([-1, 0, 1])
        below, at, above = gains[around].T
        curvature = 2.0 * at - below - above
        share = np.divide(0.5 * (above - below), curvature, out=np.zeros_like(at), where=curvature > 0)
        share = np.clip(share, -1.0, 1.0)
        weights = np.stack([0.5 * share * (share - 1.0), 1.0 - share**2, 0.5 * share * (share + 1.0)], axis=1)
        speed = np.sum(weights * speeds[around], axis=1)
        feed = np.clip(np.sum(weights * feeds[around], axis=1), feeds[around].min(axis=1), feeds[around].max(axis=1))
        better = self._gain(speed, feed, prospect) > gains[lanes, top]
        return np.where(better, speed, speeds[lanes, top]), np.where(better, feed, feeds[lanes, top])

    def _reach(self, commanded: Array, name: str) -> tuple[Array, Array]:
        """Logarithms of the least and the most that can be commanded next."""
        control, machine = self._scenario.control, self._scenario.machine
        least, most = (float(np.log(getattr(machine, f"{name}_{end}"))) for end in ("min", "max"))
        if control.action == "set_point":
            return np.full(len(commanded), least), np.full(len(commanded), most)
        step = getattr(control, f"{name}_step")
        return np.clip(np.log(commanded) - step, least, most), np.clip(np.log(commanded) + step, least, most)


def plays(scenario: Scenario) -> bool:
    """Whether a scenario offers what estimating and optimising need: speed and feed to set, and force and power measured."""
    return sets_speed_and_feed(scenario) and scenario.sensors.force == "dynamometer"


PARAMETERS = {"severity": Range(0.5, 4.0, logarithmic=True), "caution": Range(0.5, 2.0, logarithmic=True)}

RULES = {
    "optimiser": Rule(
        "the best expected net gain of each interval, on a Kalman filter's estimates and a price of life by dynamic programming",
        lambda scenario, num_envs, parameters: Optimiser(scenario, num_envs, **parameters),
        plays,
        PARAMETERS,
        changes_edges=True,
        tuned_on="rough_turning",
    )
}
