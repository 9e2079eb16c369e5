"""Hold a constant cutting force, and so a constant roughness, with the feed (roughness control paper).

The commanded feed is

    f_c = f(t - 1) F_ref / F

with F the measured force, F_ref its reference and f(t - 1) the previous feed. (The paper's equation (6) is lost; like the text's,
this form grows without bound as the force vanishes.) If f(t - 1) is the actual feed, the feed servo integrates the deviation, and
the loop is stable. If it is the commanded feed, the command runs ahead of the lags of servo and chip, and the feed swings between
its bounds. F_ref is the force at which Ra = a exp(b F), the paper's equation (5), equals the reference of Ra. Without a reference
of Ra, it is a share of the force limit.

The law fails if the force vanishes. So it acts only after the force has been above 100 N for some time; until then it commands
the programmed feed.

It needs of the nominal model: the roughness of a force and the law of thrust force.
"""

import numpy as np
from numpy.typing import NDArray

from baselines.models.part_program import PROGRAM, PartProgram, on_override, on_program, on_roughness, on_speed_and_feed
from baselines.rule import Range, Rule
from turning_env import Reading, Scenario, read
from turning_env.action import towards
from turning_env.numerics.functions import exp, log
from turning_env.scenario.sections import Surface
from turning_env.scoring.policy import Actions, Observations, Policy

THRESHOLD = 100.0
"""Force below which the tool counts as out of the metal [N] (roughness control paper)."""
ENGAGED_TIME = 0.1
"""Time above the threshold after which the law acts [s]: one turn of the paper's spindle, in which a chip reaches its thickness
(assumption; the paper says "a specified time")."""


def force_of_roughness(surface: Surface, roughness: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the thrust force [N], at least 1 N, for a roughness Ra [um]: the inverse of the paper's equation (5).

    Raises:
        ValueError: the roughness does not depend on the force.
    """
    if surface.roughness_rate == 0.0:
        raise ValueError("surface.roughness_rate is 0.0, but where force is to set the roughness it must be above 0")
    return np.asarray(np.maximum(log(roughness / surface.roughness_at_no_force) / surface.roughness_rate, 1.0))


def feed_of_roughness(
    scenario: Scenario, roughness: NDArray[np.float64], wear: NDArray[np.float64] | float = 0.0
) -> NDArray[np.float64]:
    """Return the feed [mm/rev] at which the nominal model has the force for a roughness Ra [um].

    Args:
        scenario: task, with the nominal law of thrust force and depth of cut.
        roughness: Ra [um].
        wear: flank wear [mm].

    Raises:
        ValueError: the force does not grow with the feed, or the roughness does not depend on the force.
    """
    law, machine = scenario.material.thrust_force, scenario.machine
    if law.feed <= 0.0:
        raise ValueError(f"material.thrust_force.feed is {law.feed}, but where feed is to set the force it must be above 0")
    wear = np.maximum(wear, 1e-3 * scenario.tool.wear_criterion)  # before the first cut it is 0
    speed = np.full(len(roughness), scenario.control.initial_cutting_speed)
    force_at_unit_feed = law(speed, 1.0, scenario.workpiece.depth_of_cut, wear=wear)
    force = force_of_roughness(scenario.surface, roughness)
    feed = exp(log(force / force_at_unit_feed) / law.feed)
    return np.asarray(np.clip(feed, machine.feed_min, machine.feed_max))


class ConstantForce:
    """The paper's control law.

    Args:
        program: part program.
        num_envs: number of environments.
        force_share: reference of force over the force limit [-]; unused if a roughness is to be held.
        on_command: whether f(t - 1) is the commanded feed, not the actual one.

    Raises:
        ValueError: a roughness is to be held, but it does not depend on the force.
    """

    def __init__(self, program: PartProgram, num_envs: int, force_share: float = 1.0, on_command: bool = False) -> None:
        scenario = program.scenario
        self._program = program
        self._reference = force_share * scenario.limits.thrust_force
        self._on_command = on_command
        self._steps_needed = max(1, round(ENGAGED_TIME / scenario.control.interval))
        self._steps_engaged = np.zeros(num_envs, np.int64)
        if scenario.control.aim == "roughness":
            force_of_roughness(scenario.surface, np.ones(1))  # raises its error now, not in the first step

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Start out of the metal."""
        self._steps_engaged[mask] = 0

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, action size), for observations, shape (num_envs, entries)."""
        reading = read(observations, self._program.scenario)
        feed, engaged = self._next_feed(reading)
        return self._program.act(reading, np.where(engaged, feed / self._program.feed, 1.0))

    def _next_feed(self, reading: Reading) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the law's feed [mm/rev] and whether the law acts, shape (num_envs,) each."""
        scenario, force = self._program.scenario, reading.thrust_force
        self._steps_engaged = np.where(force > THRESHOLD, self._steps_engaged + 1, 0)
        reference: NDArray[np.float64] | float = self._reference
        if scenario.control.aim == "roughness":
            reference = force_of_roughness(scenario.surface, reading.roughness_reference)
        before = reading.commanded_feed if self._on_command else reading.feed
        return before * reference / np.maximum(force, THRESHOLD), self._steps_engaged >= self._steps_needed


class ModelFeed(Policy):
    """Open-loop control: the feed at which the nominal model has the force for the reference of Ra.

    Args:
        scenario: task, with the nominal law of thrust force and depth of cut.

    Raises:
        ValueError: the force does not grow with the feed, or the roughness does not depend on the force.
    """

    def __init__(self, scenario: Scenario) -> None:
        feed_of_roughness(scenario, np.ones(1))  # raises its errors now, not in the first step
        self._scenario = scenario

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, action size), for observations, shape (num_envs, entries)."""
        scenario = self._scenario
        reading = read(observations, scenario)
        speed = np.full(len(observations), scenario.control.initial_cutting_speed)
        return towards(reading, scenario, speed, feed_of_roughness(scenario, reading.roughness_reference, reading.nominal_wear))


def _holds_roughness(scenario: Scenario) -> bool:
    return on_roughness(scenario) and scenario.surface.roughness_rate > 0.0


def plays_by_model(scenario: Scenario) -> bool:
    """Return whether a roughness is to be held by the feed override, and the nominal model gives the feed for it."""
    return _holds_roughness(scenario) and scenario.material.thrust_force.feed > 0.0


FORCE_SHARE = Range(0.2, 1.1, logarithmic=True)

RULES = {
    "constant_force": Rule(
        "constant cutting force for constant roughness (roughness control paper)",
        on_program(ConstantForce),
        _holds_roughness,
        {},
    ),
    "constant_force_limit": Rule(
        "constant cutting force at a share of the force limit, by override (roughness control paper)",
        on_program(ConstantForce),
        on_override,
        {"force_share": FORCE_SHARE},
    ),
    "constant_force_with_speed": Rule(
        "constant cutting force at a share of the force limit (roughness control paper), with the program's speed and feed tuned",
        on_program(ConstantForce),
        on_speed_and_feed,
        {"force_share": FORCE_SHARE, **PROGRAM},
    ),
    "model_feed": Rule(
        "the feed of the nominal model for the reference of roughness, without measuring (to compare with constant_force)",
        lambda scenario, num_envs, parameters: ModelFeed(scenario),
        plays_by_model,
        {},
    ),
}
