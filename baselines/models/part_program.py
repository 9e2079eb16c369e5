"""The part program on which a feed override acts: a programmed cutting speed and feed; and rules of such overrides."""

from collections.abc import Callable, Mapping

import numpy as np

from baselines.rule import Array, Mask, Parameters, Range, Rule
from turning_env import Reading, Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.scoring.policy import Actions, Observations, Policy

PROGRAM = {"cutting_speed": Range(50.0, 200.0), "feed": Range(0.06, 0.60, logarithmic=True)}
"""Tuned parameters of a part program if actions set speed and feed [m/min], [mm/rev], clipped to the machine."""
SPEED_AND_TARGET = {"cutting_speed": PROGRAM["cutting_speed"], "target": Range(0.5, 1.0)}
"""Tuned parameters of a load controller with its own program: cutting speed, and target load over the load at the power limit."""


class PartProgram:
    """A programmed speed [m/min] and feed [mm/rev], by default the scenario's, and an override [-] of 0 to ``override_max``."""

    def __init__(self, scenario: Scenario, parameters: Parameters) -> None:
        self.scenario, control, machine = scenario, scenario.control, scenario.machine
        speed = parameters.get("cutting_speed", control.initial_cutting_speed)
        feed = parameters.get("feed", control.initial_feed)
        self.cutting_speed = min(max(speed, machine.cutting_speed_min), scenario.cutting_speed_max)
        self.feed = min(max(feed, machine.feed_min), machine.feed_max)
        self.override_max = control.override_max

    def override(self, reading: Reading) -> Array:
        """Return the commanded override [-], shape (num_envs,): commanded over programmed feed."""
        return np.clip(reading.commanded_feed / self.feed, 0.0, self.override_max)

    def act(self, reading: Reading, override: Array, change_edge: Mask | None = None) -> Actions:
        """Return the actions that command the programmed cutting speed, and the programmed feed times an override [-].

        Override and feed are clipped to their ranges. ``change_edge``: see ``turning_env.action.towards``.
        """
        feed = np.clip(override, 0.0, self.override_max) * self.feed
        feed = np.clip(feed, self.scenario.machine.feed_min, self.scenario.machine.feed_max)
        return towards(
            reading, self.scenario, np.full(len(feed), self.cutting_speed), feed, change_edge
        )


class OverrideLaw(Policy):
    """A controller without state: a ``law`` returns the new override [-] for a reading and the commanded override."""

    def __init__(self, program: PartProgram, law: Callable[[Reading, Array], Array]) -> None:
        self._program, self._law = program, law

    def act(self, observations: Observations) -> Actions:
        reading = read(observations, self._program.scenario)
        return self._program.act(reading, self._law(reading, self._program.override(reading)))


def on_program(controller: Callable[..., Policy]) -> Callable[..., Policy]:
    """Return the controller of a rule; its program takes cutting speed and feed from the parameters, it gets the others."""

    def build(scenario: Scenario, num_envs: int, **parameters: float) -> Policy:
        own = {name: parameters.pop(name) for name in PROGRAM if name in parameters}
        return controller(PartProgram(scenario, own), num_envs, **parameters)

    return build


def override_rules(
    name: str,
    description: str,
    controller: Callable[..., Policy],
    parameters: Mapping[str, float | Range],
    with_speed: Mapping[str, float | Range],
    plays: Callable[[Scenario], bool] = lambda scenario: True,
    *,
    changes_edges: bool = False,
    worth_tuning: bool = False,
) -> dict[str, Rule]:
    """Return two rules for a controller of the feed override: on the scenario's program, and ``..._with_speed`` on a tuned one.

    The first has ``parameters`` and may be ``worth_tuning``, the second has ``with_speed``, including its program's. Both play if
    ``plays`` is true and metal removal is rewarded. See ``on_program`` and ``Rule`` for the other arguments.
    """
    build, tuned = on_program(controller), "speed and feed" if "feed" in with_speed else "speed"
    return {
        name: Rule(
            description,
            build,
            lambda scenario: on_override(scenario) and plays(scenario),
            parameters,
            changes_edges=changes_edges,
            worth_tuning=worth_tuning,
        ),
        f"{name}_with_speed": Rule(
            f"{description}, with the program's {tuned} tuned",
            build,
            lambda scenario: on_speed_and_feed(scenario) and plays(scenario),
            with_speed,
            changes_edges=changes_edges,
        ),
    }


def target_load(scenario: Scenario, share: float) -> float:
    """Return the spindle load [-] at a share of the power limit."""
    return share * scenario.limits.power / scenario.machine.rated_power


def on_override(scenario: Scenario, aim: str = "removal") -> bool:
    """Return whether an action sets the feed override alone, and metal removal is rewarded, or another ``aim``."""
    return scenario.control.action == "override" and scenario.control.aim == aim


def on_speed_and_feed(scenario: Scenario) -> bool:
    """Return whether an action sets speed and feed, so that the controller chooses the program, and metal removal is rewarded."""
    return sets_speed_and_feed(scenario) and scenario.control.aim == "removal"
