"""Play override laws in the environment, and compare them with the controllers they came from.

``program`` and ``law`` hold what is played; ``export_law`` is the command.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from turning_nc.law import LOAD, PATH_VELOCITY, SPINDLE_SPEED, STATE
from turning_nc.program import Program
from turning_nc.words import NcError

from turning_env import Reading, RoughTurningEnv, Scenario, read
from turning_env.action import towards
from turning_env.scoring.policy import Actions, Observations, PolicyFactory


@dataclass(frozen=True)
class Totals:
    """Totals of an episode."""

    removed: float  # [cm3]
    time: float  # machine time [min]
    wear: float  # flank wear at the end [mm]

    @classmethod
    def of(cls, infos: Iterable[dict[str, Any]]) -> Self:
        """Return the totals of an episode's steps."""
        steps = list(infos)
        return cls(
            removed=sum(info["removed"] for info in steps),
            time=sum(info["time"] for info in steps) / 60.0,
            wear=steps[-1]["wear"],
        )

    def difference(self, reference: "Totals") -> float:
        """Return the largest of the differences, relative to the reference [-]."""
        return max(
            _relative_difference(self.removed, reference.removed),
            _relative_difference(self.time, reference.time),
            _relative_difference(self.wear, reference.wear),
        )


def _relative_difference(value: float, reference: float) -> float:
    return abs(value - reference) / max(abs(reference), 1e-9)


class Comparison(NamedTuple):
    """How a law differs from the controller from which it was made."""

    differences: list[float]  # of the next override, for every step [%]
    controller: Totals  # of the controller's episode


class LawPolicy:
    """A program's law as the policy of one episode; it runs once per step.

    Raises:
        NcError: the program is not one for this scenario, or its law is missing.
    """

    def __init__(self, program: Program, scenario: Scenario) -> None:
        program.check(scenario)
        control = scenario.control
        if control.action != "override" or control.edge_changes != "end":
            raise NcError(
                f"scenario {scenario.name!r} does not set the override of a programmed feed, "
                "with one edge"
            )
        if not program.law.actions:
            raise NcError("the program has no override law: no synchronized actions")
        self._program = program
        self._scenario = scenario
        self._variables = program.law.variables()

    def override(self, reading: Reading, present: float | None = None) -> float:
        """Return the next override [%] for a reading.

        Args:
            reading: of one environment.
            present: replaces the program's own present override [%].

        Raises:
            NcError: the feed would be outside the machine's range, or an expression has no value,
                as it divides by 0.
        """
        program = self._program
        variables = self._variables
        cutting_speed = float(reading.cutting_speed[0])
        spindle_speed = 1000.0 * cutting_speed / (math.pi * program.diameter)
        variables[LOAD] = 100.0 * max(float(reading.load[0]), 0.0)
        variables[SPINDLE_SPEED] = spindle_speed
        variables[PATH_VELOCITY] = spindle_speed * float(reading.feed[0])
        if present is not None:
            variables[STATE] = present
        at_load = f"at a load of {variables[LOAD]:.1f} %"
        try:
            override = program.law.cycle(variables)
        except ZeroDivisionError as error:
            raise NcError(f"the law divides by 0 {at_load}") from error
        except ValueError as error:
            raise NcError(f"the law has no value {at_load}: {error}") from error
        feed = 0.01 * override * program.feed
        machine = self._scenario.machine
        if not machine.feed_min - 1e-9 <= feed <= machine.feed_max + 1e-9:
            raise NcError(
                f"the law sets a feed of {feed:.6f} mm/rev {at_load}, "
                f"but the machine's range is {machine.feed_min} to {machine.feed_max}"
            )
        return override

    def act(self, observations: Observations) -> Actions:
        """Return actions, shape (1, 1), for observations, shape (1, entries)."""
        reading = read(observations, self._scenario)
        feed = np.array([0.01 * self.override(reading) * self._program.feed])
        speed = np.array([self._program.cutting_speed])
        return towards(reading, self._scenario, speed, feed)


def simulate(program: Program, scenario: Scenario, seed: int) -> Totals:
    """Play a program on the first bar of a seed until the bar or the edge ends.

    Raises:
        NcError: see ``LawPolicy``.
    """
    policy = LawPolicy(program, scenario)
    return Totals.of(_steps(scenario, seed, act=policy.act))


def compare(
    program: Program, make_policy: PolicyFactory, scenario: Scenario, seed: int
) -> Comparison:
    """Play a controller on the first bar of a seed, and compute the law's overrides beside it.

    Both compute the next override of every step from the same measurements and present override.

    Raises:
        NcError: see ``LawPolicy``.
    """
    law = LawPolicy(program, scenario)
    policy = make_policy(1)
    policy.reset(np.ones(1, np.bool_))
    overrides_by_law: list[float] = []  # [%]

    def act(observations: Observations) -> Actions:
        """Note the override that the law would set, and return the controller's action."""
        reading = read(observations, scenario)
        present = 100.0 * float(reading.commanded_feed[0]) / program.feed
        overrides_by_law.append(law.override(reading, present))
        return policy.act(observations)

    infos = list(_steps(scenario, seed, act=act))
    differences = []
    for by_law, info in zip(overrides_by_law, infos, strict=True):
        commanded = 100.0 * info["commanded_feed"] / program.feed
        differences.append(abs(by_law - commanded))
    return Comparison(differences, controller=Totals.of(infos))


def _steps(
    scenario: Scenario, seed: int, act: Callable[[Observations], Actions]
) -> Iterator[dict[str, Any]]:
    """Play the first bar of a seed; yield the ``info`` of every step."""
    workpiece = scenario.workpiece.model_copy(update={"bars": 1})
    env = RoughTurningEnv(scenario.model_copy(update={"workpiece": workpiece}))
    observation, _ = env.reset(seed=seed)
    ended = False
    while not ended:
        action = act(observation[None])[0]
        observation, _, terminated, truncated, info = env.step(action)
        yield info
        ended = terminated or truncated
