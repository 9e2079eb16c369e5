"""Play override laws in the environment, and compare them with the controllers from which they were made."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Self

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
            sum(info["removed"] for info in steps),
            sum(info["time"] for info in steps) / 60.0,
            steps[-1]["wear"],
        )

    def difference(self, other: "Totals") -> float:
        """Return the largest of the relative differences [-]."""
        mine, its = ((totals.removed, totals.time, totals.wear) for totals in (self, other))
        return max(abs(a - b) / max(abs(b), 1e-9) for a, b in zip(mine, its, strict=True))


def _steps(
    scenario: Scenario, seed: int, act: Callable[[Observations], Actions]
) -> Iterator[dict[str, Any]]:
    """Play the first bar of a seed; yield the ``info`` of every step."""
    workpiece = scenario.workpiece.model_copy(update={"bars": 1})
    env = RoughTurningEnv(scenario.model_copy(update={"workpiece": workpiece}))
    observation, _ = env.reset(seed=seed)
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(act(observation[None])[0])
        yield info
        ended = terminated or truncated


class LawPolicy:
    """A program's law as the policy of one episode; it runs once per step.

    Raises:
        NcError: the program is not one for this scenario, or its law is missing.
    """

    def __init__(self, program: Program, scenario: Scenario) -> None:
        program.check(scenario)
        if scenario.control.action != "override" or scenario.control.edge_changes != "end":
            raise NcError(
                f"scenario {scenario.name!r} does not set the override of a programmed feed, with one edge"
            )
        if not program.law.actions:
            raise NcError("the program has no override law: no synchronized actions")
        self._program, self._scenario, self._variables = program, scenario, program.law.variables()

    def override(self, reading: Reading, present: float | None = None) -> float:
        """Return the next override [%] for a reading; ``present`` [%] replaces the program's own present override.

        Raises:
            NcError: the feed would be outside the machine's range, or an expression has no value, as it divides by 0.
        """
        program, variables, machine = self._program, self._variables, self._scenario.machine
        spindle_speed = 1000.0 * float(reading.cutting_speed[0]) / (math.pi * program.diameter)
        variables[LOAD] = 100.0 * max(float(reading.load[0]), 0.0)
        variables[SPINDLE_SPEED], variables[PATH_VELOCITY] = (
            spindle_speed,
            spindle_speed * float(reading.feed[0]),
        )
        if present is not None:
            variables[STATE] = present
        try:
            override = program.law.cycle(variables)
        except ZeroDivisionError as error:
            raise NcError(f"the law divides by 0 at a load of {variables[LOAD]:.1f} %") from error
        except ValueError as error:
            raise NcError(
                f"the law has no value at a load of {variables[LOAD]:.1f} %: {error}"
            ) from error
        feed = 0.01 * override * program.feed
        if not machine.feed_min - 1e-9 <= feed <= machine.feed_max + 1e-9:
            allowed = f"the machine's range is {machine.feed_min} to {machine.feed_max}"
            raise NcError(
                f"the law sets a feed of {feed:.6f} mm/rev at a load of {variables[LOAD]:.1f} %, but {allowed}"
            )
        return override

    def act(self, observations: Observations) -> Actions:
        """Return actions, shape (1, 1), for observations, shape (1, entries)."""
        reading, program = read(observations, self._scenario), self._program
        feed = np.array([0.01 * self.override(reading) * program.feed])
        return towards(reading, self._scenario, np.array([program.cutting_speed]), feed)


def simulate(program: Program, scenario: Scenario, seed: int) -> Totals:
    """Play a program on the first bar of a seed until the bar or the edge ends; return the totals.

    Raises:
        NcError: see ``LawPolicy``.
    """
    return Totals.of(_steps(scenario, seed, LawPolicy(program, scenario).act))


def compare(
    program: Program, make_policy: PolicyFactory, scenario: Scenario, seed: int
) -> tuple[list[float], Totals]:
    """Play a controller on the first bar of a seed; return by how much the law's overrides differ from it, and its totals.

    Both compute the next override [%] of every step from the same measurements and present override.

    Raises:
        NcError: see ``LawPolicy``.
    """
    law, policy = LawPolicy(program, scenario), make_policy(1)
    policy.reset(np.ones(1, np.bool_))
    overrides: list[float] = []

    def act(observations: Observations) -> Actions:
        reading = read(observations, scenario)
        overrides.append(
            law.override(reading, 100.0 * float(reading.commanded_feed[0]) / program.feed)
        )
        return policy.act(observations)

    infos = list(_steps(scenario, seed, act))
    differences = [
        abs(mine - 100.0 * info["commanded_feed"] / program.feed)
        for mine, info in zip(overrides, infos, strict=True)
    ]
    return differences, Totals.of(infos)
