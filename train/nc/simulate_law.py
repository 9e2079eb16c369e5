"""Play an override law as the control would run it, and compare it with its controller."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from train.nc.laws import STATE
from turning_env import Reading, RoughTurningEnv, Scenario, read
from turning_env.action import towards
from turning_env.scoring.policy import Actions, Observations, PolicyFactory
from turning_nc.program import NcError, Program
from turning_nc.schedule import Totals, with_bars
from turning_nc.synchronous import LOAD, PATH_VELOCITY, SPINDLE_SPEED


class LawPolicy:
    """A program's law as the policy of one environment; it runs once per step."""

    def __init__(self, program: Program, scenario: Scenario) -> None:
        if program.law is None:
            raise NcError("the program has no override law")
        self._law = program.law
        self._scenario = scenario
        self._speed, self._feed = program.bars[0][0].cutting_speed, program.bars[0][0].feed
        self._diameter = program.diameter
        self._variables = self._law.variables()

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Restart the program."""
        self._variables = self._law.variables()

    def override(self, reading: Reading, present: float | None = None) -> float:
        """Return the next override [%] for a reading; ``present`` [%] replaces the program's own present override.

        Raises:
            NcError: the feed would be outside the machine's range, or an expression divides by 0.
        """
        variables, machine = self._variables, self._scenario.machine
        spindle_speed = 1000.0 * float(reading.cutting_speed[0]) / (math.pi * self._diameter)
        variables[LOAD] = 100.0 * max(float(reading.load[0]), 0.0)
        variables[SPINDLE_SPEED], variables[PATH_VELOCITY] = spindle_speed, spindle_speed * float(reading.feed[0])
        if present is not None:
            variables[STATE] = present
        try:
            override = self._law.cycle(variables)
        except ZeroDivisionError as error:
            raise NcError(f"the law divides by 0 at a load of {variables[LOAD]:.1f} %") from error
        feed = 0.01 * override * self._feed
        if not machine.feed_min - 1e-9 <= feed <= machine.feed_max + 1e-9:
            allowed = f"the machine's range is {machine.feed_min} to {machine.feed_max}"
            raise NcError(f"the law sets a feed of {feed:.6f} mm/rev at a load of {variables[LOAD]:.1f} %, but {allowed}")
        return override

    def act(self, observations: Observations) -> Actions:
        """Return actions, shape (1, 1), for observations, shape (1, entries)."""
        reading = read(observations, self._scenario)
        feed = np.array([0.01 * self.override(reading) * self._feed])
        return towards(reading, self._scenario, np.array([self._speed]), feed)


@dataclass(frozen=True)
class Comparison:
    """An override law compared with its controller."""

    steps: int
    """Number of steps on which the next overrides of both were compared, from the same measurements and present override."""
    mean_difference: float  # [percentage points]
    largest_difference: float  # [percentage points]
    original: Totals
    """Totals of the controller's episode."""
    simulated: Totals
    """Totals of the law's own episode."""


def compare(program: Program, make_policy: PolicyFactory, scenario: Scenario, seed: int) -> Comparison:
    """Play a controller on the first bar of a seed, and compare the law's override in every step; then play the law alone.

    Raises:
        NcError: the program is not one for this scenario, or its law is missing or leaves the machine's range.
    """
    program.check(scenario)
    scenario = with_bars(scenario, 1)
    law = LawPolicy(program, scenario)
    policy = make_policy(1)
    policy.reset(np.ones(1, np.bool_))
    feed = program.bars[0][0].feed
    overrides: list[float] = []

    def act(observations: Observations) -> Actions:
        reading = read(observations, scenario)
        overrides.append(law.override(reading, 100.0 * float(reading.commanded_feed[0]) / feed))
        return policy.act(observations)

    commanded: list[float] = []
    original = _play(scenario, seed, act, lambda info: commanded.append(info["commanded_feed"]))
    differences = [abs(mine - 100.0 * its / feed) for mine, its in zip(overrides, commanded, strict=True)]
    simulated = simulate_law(program, scenario, seed)
    return Comparison(len(differences), float(np.mean(differences)), max(differences), original, simulated)


def simulate_law(program: Program, scenario: Scenario, seed: int) -> Totals:
    """Play a program's law on the first bar of a seed; return the totals.

    Raises:
        NcError: see ``compare``.
    """
    program.check(scenario)
    if len(program.bars) != 1 or len(program.bars[0]) != 1 or scenario.control.action != "override":
        raise NcError("a law is played in one block along one bar, of a scenario whose action is the override")
    return _play(with_bars(scenario, 1), seed, LawPolicy(program, scenario).act, lambda info: None)


def _play(
    scenario: Scenario,
    seed: int,
    act: Callable[[Observations], Actions],
    on_step: Callable[[dict[str, Any]], None],
) -> Totals:
    env = RoughTurningEnv(scenario)
    observation, _ = env.reset(seed=seed)
    removed = time = 0.0
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(act(observation[None])[0])
        on_step(info)
        removed, time, ended = removed + info["removed"], time + info["time"] / 60.0, terminated or truncated
    return Totals(removed, time, info["wear"])
