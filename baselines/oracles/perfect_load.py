"""The causal oracle of feed overrides: it brings the load to its reference in the least time.

The load is spindle power, held at its limit, or thrust force, held at that of a roughness. The
oracle receives the true load, feed, depth of cut, hardness and wear after every step, without noise
or a sensor's lag. So it knows the specific load k, with which a feed f leads to the load k f^m. It
does not know depth and hardness ahead of the tool, nor the next reference. A command passes two
lags of first order before it acts:

    commanded feed -> (servo) -> actual feed f -> k f^m -> (chip) -> load

The quickest way to a reference is to command one end of the range, and then the other (Pontryagin
et al. 1962: a system with two real lags switches once). The switch must come early enough that the
load does not overshoot. Below its reference, the oracle therefore commands the highest feed after
which braking with the lowest feed would still keep the load from rising above the reference. Above
its reference, it commands the lowest feed after which the highest one would keep the load from
falling below. Far from the reference, this is the end of a range; near to it, it is the feed that
reaches the reference without an overshoot.

The specific load goes on changing meanwhile: the depth of cut turns with the spindle (run-out), and
the hardness varies along the bar. Log depth is extrapolated over time, log hardness over the path,
each from its last two states. ``baselines/lead_control.py`` is the rule for the same task with
measured loads.

In air, the oracle commands the highest feed.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from baselines.constant_force import force_of_roughness, holds_roughness
from baselines.models.part_program import PartProgram, on_override
from baselines.rule import Array, Mask
from turning_env import Scenario, read
from turning_env.numerics.compilation import compiled, compiled_entry
from turning_env.numerics.conversions import spindle_speed_at
from turning_env.numerics.functions import exp, log, real_power
from turning_env.physics.drives import lag_share
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario.laws import cutting_power_limit

VERSION = 1  # raised when its actions change
HELD_STEPS = 2
"""Steps for which a command is held before the load would be braked.

With one step, the commands swing: the feed of one step hardly moves a load behind two lags.
"""
BRAKING = 0.5  # time of braking that is predicted over the longest lag [-]
HALVINGS = 14  # of the range of feeds, until its width is negligible
MAX_DEPTH_CHANGE = 0.05
"""Log change of the depth in a step beyond which it is a step of the bar, not extrapolated [-]."""
MIN_WEAR = 1e-3  # flank wear over the criterion in place of 0, before the first cut [-]


class Lags(NamedTuple):
    """The lags of feed and load, by sub-steps."""

    servo_share: float  # share of the distance to the commanded feed [-]
    chip_share: float  # share of the distance to the load of a settled chip [-]
    sub_step: float  # [s]
    turns: float  # of the spindle [rev]
    held_sub_steps: int  # for which a command is held
    braking_sub_steps: int  # with the brake, after those


class Feeds(NamedTuple):
    """The range of feeds, and their effect."""

    lowest: float  # [mm/rev]
    highest: float  # [mm/rev]
    exponent: float  # exponent m of the feed in the law of the load [-]


class CutState(NamedTuple):
    """The state of the cuts; arrays of shape (num_envs,)."""

    feed: Any  # actual feed [mm/rev]
    load: Any
    reference: Any  # in the unit of the load
    log_specific_load: Any  # log load at 1 mm/rev behind the lags
    growth: Any  # growth of log_specific_load by the depth [1/s]
    gradient: Any  # growth of log_specific_load by the hardness [1/mm]


class PerfectLoad(Policy):
    """Bring the true load to its reference as fast as the lags allow.

    Call ``tell`` before every action.
    """

    def __init__(self, scenario: Scenario, num_envs: int) -> None:
        self._program = PartProgram(scenario, {})
        self._holds_roughness = holds_roughness(scenario)
        material = scenario.material
        self._law = material.thrust_force if self._holds_roughness else material.power
        self._feed_max = min(
            self._program.override_max * self._program.feed, scenario.machine.feed_max
        )
        self._lags = _lags(scenario, self._program.cutting_speed)
        self._truth: Mapping[str, Any] = {}
        # Values in the previous step; NaN in air.
        self._log_depth = np.full(num_envs, np.nan)
        self._log_hardness = np.full(num_envs, np.nan)
        self._path = np.full(num_envs, np.nan)

    def tell(self, infos: Mapping[str, Any]) -> None:
        """Take the ``infos`` of the vector environment that came with the next observations."""
        self._truth = infos

    def reset(self, mask: Mask) -> None:
        self._log_depth[mask] = np.nan

    def act(self, observations: Observations) -> Actions:
        program = self._program
        reading = read(observations, program.scenario)
        cutting = self._truth["cutting"] & (self._truth["depth_of_cut"] > 0.0)
        feed = np.full(len(observations), self._feed_max)
        cut = self._cut(cutting)
        feeds = Feeds(program.scenario.machine.feed_min, self._feed_max, self._law.feed)
        quickest_feeds(feed, cutting, cut, self._lags, feeds)
        return program.act(reading, feed / program.feed)

    def _cut(self, cutting: Mask) -> CutState:
        """Return the state of the cuts, and store depth, hardness and path for the next step."""
        truth = self._truth
        scenario = self._program.scenario
        law = self._law
        # A 1 in place of unknown values keeps the logarithms defined.
        depth = np.where(cutting, truth["depth_of_cut"], 1.0)
        hardness = np.where(cutting, truth["hardness"], 1.0)
        specific_load = law(
            self._program.cutting_speed,
            1.0,
            depth_of_cut=depth,
            wear=np.maximum(truth["wear"], MIN_WEAR * scenario.tool.wear_criterion),
            hardness=hardness,
        )
        log_depth = np.where(cutting, log(depth), np.nan)
        log_hardness = np.where(cutting, log(hardness), np.nan)
        path = np.array(truth["path"], np.float64)

        # Comparisons with NaN are false, so nothing is extrapolated in the first step in metal.
        depth_change = log_depth - self._log_depth
        hardness_change = log_hardness - self._log_hardness
        goes_on = np.abs(depth_change) < MAX_DEPTH_CHANGE
        distance = np.where(goes_on, path - self._path, 1.0)
        growth = law.depth_of_cut * depth_change / scenario.control.interval
        gradient = law.hardness * hardness_change / distance
        self._log_depth = log_depth
        self._log_hardness = log_hardness
        self._path = path

        name = "thrust_force" if self._holds_roughness else "power"
        return CutState(
            feed=np.array(truth["feed"], np.float64),
            load=np.array(truth[name], np.float64),
            reference=self._reference(),
            log_specific_load=log(specific_load),
            growth=np.where(goes_on, growth, 0.0),
            gradient=np.where(goes_on, gradient, 0.0),
        )

    def _reference(self) -> Array:
        """Return the load to hold: thrust force [N] or spindle power [kW], without idling."""
        scenario = self._program.scenario
        if self._holds_roughness:
            return force_of_roughness(scenario.surface, self._truth["roughness_reference"])
        speed = self._program.cutting_speed
        power = cutting_power_limit(scenario, speed)
        return np.full(len(self._truth["power"]), power)


def _lags(scenario: Scenario, cutting_speed: float) -> Lags:
    """Return the lags of a scenario at its programmed cutting speed [m/min]."""
    control = scenario.control
    machine = scenario.machine
    sub_step = control.interval / control.sub_steps
    turns_per_second = spindle_speed_at(cutting_speed, scenario.workpiece.diameter) / 60.0
    turns = turns_per_second * sub_step
    longest = max(machine.feed_time_constant, machine.chip_lag / turns_per_second)
    return Lags(
        servo_share=float(lag_share(sub_step, machine.feed_time_constant)),
        chip_share=float(lag_share(turns, machine.chip_lag)),
        sub_step=sub_step,
        turns=turns,
        held_sub_steps=HELD_STEPS * control.sub_steps,
        braking_sub_steps=int(BRAKING * longest / sub_step),
    )


@compiled_entry
def quickest_feeds(commands, cutting, cut, lags, feeds):  # type: ignore[no-untyped-def]
    """Set the feeds to command [mm/rev] where an edge cuts: the quickest without an overshoot.

    They are found by halving the range of feeds. ``commands`` and ``cutting`` have shape
    (num_envs,).
    """
    for i in range(len(commands)):
        if not cutting[i]:
            continue
        rises = cut.load[i] < cut.reference[i]
        brake = feeds.lowest if rises else feeds.highest
        # The feed is sought between one that keeps the load and one that overshoots.
        keeps = brake
        overshoots = feeds.highest if rises else feeds.lowest
        for _ in range(HALVINGS):
            command = 0.5 * (keeps + overshoots)
            if passes_reference(i, cut, lags, feeds.exponent, command, brake, rises):
                overshoots = command
            else:
                keeps = command
        commands[i] = keeps


@compiled
def passes_reference(i, cut, lags, exponent, command, brake, rises):  # type: ignore[no-untyped-def]
    """Return whether a load would pass its reference if a command were held and then the brake.

    ``command`` and ``brake`` are feeds [mm/rev], ``exponent`` is that of the feed in the law of the
    load, ``rises`` whether the load is below its reference now.
    """
    sign = 1.0 if rises else -1.0
    feed = cut.feed[i]
    load = cut.load[i]
    path = 0.0
    for k in range(lags.held_sub_steps + lags.braking_sub_steps):
        commanded = command if k < lags.held_sub_steps else brake
        feed += lags.servo_share * (commanded - feed)
        path += lags.turns * feed
        log_change = cut.growth[i] * (k + 1) * lags.sub_step + cut.gradient[i] * path
        settled = exp(cut.log_specific_load[i] + log_change) * real_power(feed, exponent)
        load += lags.chip_share * (settled - load)
        if sign * (load - cut.reference[i]) > 0.0:
            return True
    return False


def covers(scenario: Scenario) -> bool:
    """Return whether an action sets the override, and nothing but two lags delays the load."""
    material = scenario.material
    is_delayed = scenario.machine.command_delay != 0.0
    limit_varies = scenario.spindle.short_time_load != 1.0
    if is_delayed or limit_varies:
        return False
    if holds_roughness(scenario):
        return material.thrust_force.feed > 0.0
    return on_override(scenario) and material.power.feed > 0.0
