"""The part program on which a feed override acts, and rules of such overrides.

A program is a cutting speed and a feed. An override scales its feed.
"""

from collections.abc import Callable, Mapping

import numpy as np

from baselines.rule import Array, Mask, Parameters, Rule, TuningRange
from turning_env import Reading, Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.policy import Actions, Observations, Policy

PROGRAM = {
    "cutting_speed": TuningRange(50.0, 200.0),
    "feed": TuningRange(0.06, 0.60, logarithmic=True),
}
"""Tuned parameters of a part program if actions set speed and feed [m/min], [mm/rev].

They are clipped to the machine.
"""
SPEED_AND_TARGET = {"cutting_speed": PROGRAM["cutting_speed"], "target": TuningRange(0.5, 1.0)}
"""Tuned parameters of a load controller with its own program.

They are the cutting speed [m/min], and the target load over the load at the power limit [-].
"""


class PartProgram:
    """A programmed speed and feed, and the range of an override on it.

    Args:
        scenario: task, whose program is the default.
        parameters: ``cutting_speed`` [m/min] and ``feed`` [mm/rev], which replace the task's.

    Attributes:
        cutting_speed: programmed cutting speed [m/min], within the machine's range.
        feed: programmed feed [mm/rev], within the machine's range.
        override_max: highest override [-].
    """

    def __init__(self, scenario: Scenario, parameters: Parameters) -> None:
        control = scenario.control
        machine = scenario.machine
        speed = parameters.get("cutting_speed", control.initial_cutting_speed)
        feed = parameters.get("feed", control.initial_feed)
        self.scenario = scenario
        self.cutting_speed = min(max(speed, machine.cutting_speed_min), scenario.cutting_speed_max)
        self.feed = min(max(feed, machine.feed_min), machine.feed_max)
        self.override_max = control.override_max

    def override(self, reading: Reading) -> Array:
        """Return the commanded override [-], shape (num_envs,): commanded over programmed feed."""
        return np.clip(reading.commanded_feed / self.feed, 0.0, self.override_max)

    def act(self, reading: Reading, override: Array, change_edge: Mask | None = None) -> Actions:
        """Return the actions that command the programmed cutting speed and an override [-].

        Override and feed are clipped to their ranges. ``change_edge``: see
        ``turning_env.action.towards``.
        """
        machine = self.scenario.machine
        feed = np.clip(override, 0.0, self.override_max) * self.feed
        feed = np.clip(feed, machine.feed_min, machine.feed_max)
        speed = np.full(len(feed), self.cutting_speed)
        return towards(reading, self.scenario, speed, feed, change_edge)


class OverrideLaw(Policy):
    """A controller without state.

    Args:
        program: the part program.
        law: returns the new override [-] for a reading and the commanded override.
    """

    def __init__(self, program: PartProgram, law: Callable[[Reading, Array], Array]) -> None:
        self._program = program
        self._law = law

    def act(self, observations: Observations) -> Actions:
        reading = read(observations, self._program.scenario)
        override = self._law(reading, self._program.override(reading))
        return self._program.act(reading, override)


def on_program(controller: Callable[..., Policy]) -> Callable[..., Policy]:
    """Return a rule's controller, given a function of a program, ``num_envs`` and parameters.

    The program takes cutting speed and feed from the parameters; the function gets the others.
    """

    def build(scenario: Scenario, num_envs: int, **parameters: float) -> Policy:
        of_program = {}
        for name in PROGRAM:
            if name in parameters:
                of_program[name] = parameters.pop(name)
        return controller(PartProgram(scenario, of_program), num_envs, **parameters)

    return build


def override_rules(
    name: str,
    description: str,
    controller: Callable[..., Policy],
    parameters: Mapping[str, float | TuningRange],
    with_speed: Mapping[str, float | TuningRange],
    plays: Callable[[Scenario], bool] = lambda scenario: True,
    *,
    changes_edges: bool = False,
    worth_tuning: bool = False,
) -> dict[str, Rule]:
    """Return two rules for a controller of the feed override.

    The rule ``name`` acts on the scenario's program, ``NAME_with_speed`` on a tuned one. Both need
    a task that rewards metal removal.

    Args:
        name: name of the first rule.
        description: one line that names the source.
        controller: builds the controller from a program and the parameters (``on_program``).
        parameters: parameters of the first rule.
        with_speed: parameters of the second rule, including its program's.
        plays: further condition on a scenario.
        changes_edges: whether the rules decide when to change the edge.
        worth_tuning: whether ``--quick`` tuning includes the first rule.
    """
    build = on_program(controller)
    tuned = "speed and feed" if "feed" in with_speed else "speed"
    on_scenario = Rule(
        description,
        build,
        plays=lambda scenario: on_override(scenario) and plays(scenario),
        parameters=parameters,
        changes_edges=changes_edges,
        worth_tuning=worth_tuning,
    )
    on_own_program = Rule(
        f"{description}, with the program's {tuned} tuned",
        build,
        plays=lambda scenario: on_speed_and_feed(scenario) and plays(scenario),
        parameters=with_speed,
        changes_edges=changes_edges,
    )
    return {name: on_scenario, f"{name}_with_speed": on_own_program}


def target_load(scenario: Scenario, share: float) -> float:
    """Return the spindle load [-] at a share of the power limit."""
    return share * scenario.limits.power / scenario.machine.rated_power


def on_override(scenario: Scenario, aim: str = "removal") -> bool:
    """Return whether an action sets the feed override alone, and the task has this aim."""
    return scenario.control.action == "override" and scenario.control.aim == aim


def on_speed_and_feed(scenario: Scenario) -> bool:
    """Return whether an action sets speed and feed, and metal removal is rewarded.

    Then the controller chooses the program.
    """
    return sets_speed_and_feed(scenario) and scenario.control.aim == "removal"
