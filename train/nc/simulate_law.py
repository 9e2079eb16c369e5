"""Plays an override law as the control would run it, and compares it with the rule that it was made from."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from train.nc.laws import STATE
from turning_env import Reading, RoughTurningEnv, Scenario, read
from turning_env.action import towards
from turning_env.programs.program import NcError, Program
from turning_env.programs.schedule import Sums, job
from turning_env.programs.synchronous import LOAD, PATH_VELOCITY, SPINDLE_SPEED
from turning_env.score.policy import Actions, Observations, PolicyFactory


class LawPolicy:
    """One lane under a program's law, which runs once per control interval."""

    def __init__(self, program: Program, scenario: Scenario) -> None:
        if program.law is None:
            raise NcError("the program has no override law")
        self._law = program.law
        self._scenario = scenario
        self._speed, self._feed = program.bars[0][0].cutting_speed, program.bars[0][0].feed
        self._diameter = program.diameter
        self._variables = self._law.variables()

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """The program begins anew."""
        self._variables = self._law.variables()

    def override(self, reading: Reading, present: float | None = None) -> float:
        """The override [%] for what is measured, after ``present`` [%] where that is not to be the program's own last one.

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
        """Actions, shape (1, 1), for observations, shape (1, entries)."""
        reading = read(observations, self._scenario)
        feed = np.array([0.01 * self.override(reading) * self._feed])
        return towards(reading, self._scenario, np.array([self._speed]), feed)


@dataclass(frozen=True)
class Comparison:
    """A law beside the rule that it was made from."""

    steps: int
    """On how many the rule's and the law's next overrides were compared, from the same measurements and present override."""
    mean_difference: float
    """Between these [percentage points]."""
    largest_difference: float  # [percentage points]
    original: Sums
    """Of the rule's play."""
    simulated: Sums
    """Of the law's own."""


def compare(program: Program, make_policy: PolicyFactory, scenario: Scenario, seed: int) -> Comparison:
    """Play a rule on the first bar of a draw with the law beside it, and then the law alone.

    Raises:
        NcError: the program is not one for this scenario, has no law, or one that leaves the machine's range.
    """
    program.check(scenario)
    scenario = job(scenario, 1)
    law = LawPolicy(program, scenario)
    env = RoughTurningEnv(scenario)
    observation, _ = env.reset(seed=seed)
    policy = make_policy(1)
    policy.reset(np.ones(1, np.bool_))
    feed, differences = program.bars[0][0].feed, []
    removed = time = 0.0
    ended = False
    while not ended:
        reading = read(observation[None], scenario)
        mine = law.override(reading, 100.0 * float(reading.commanded_feed[0]) / feed)
        observation, _, terminated, truncated, info = env.step(policy.act(observation[None])[0])
        differences.append(abs(mine - 100.0 * info["commanded_feed"] / feed))
        removed, time, ended = removed + info["removed"], time + info["time"] / 60.0, terminated or truncated
    return Comparison(
        len(differences),
        float(np.mean(differences)),
        max(differences),
        Sums(removed, time, info["wear"]),
        simulate_law(program, scenario, seed),
    )


def simulate_law(program: Program, scenario: Scenario, seed: int) -> Sums:
    """Play a program's law on the first bar of a draw.

    Raises:
        NcError: see ``compare``.
    """
    program.check(scenario)
    if len(program.bars) != 1 or len(program.bars[0]) != 1 or scenario.control.action != "override":
        raise NcError("a law is played in one block along one bar, of a scenario whose action is the override")
    env = RoughTurningEnv(job(scenario, 1))
    observation, _ = env.reset(seed=seed)
    law = LawPolicy(program, scenario)
    removed = time = 0.0
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(law.act(observation[None])[0])
        removed, time, ended = removed + info["removed"], time + info["time"] / 60.0, terminated or truncated
    return Sums(removed, time, info["wear"])
