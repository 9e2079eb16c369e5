"""Simple laws from spindle load to feed override: a constant load, one line, and none."""

import numpy as np
from numpy.typing import NDArray

from baselines.fixed import FixedParameters
from baselines.models.part_program import SPEED_AND_TARGET, PartProgram, on_override, on_speed_and_feed, target_load
from baselines.rule import Parameters, Range, Rule
from turning_env import Scenario, read
from turning_env.action import sets_feed
from turning_env.physics.drives import lag_share
from turning_env.score.policy import Actions, Observations

LOWEST_OVERRIDE = 0.1
"""Lowest override of the commercial controls [-] (assumption): at a standstill of the feed the edge would only rub."""


def towards_load(
    override: NDArray[np.float64], load: NDArray[np.float64], target: NDArray[np.float64] | float, share: float
) -> NDArray[np.float64]:
    """The new override [-] of an integrating law: the present one, moved by a share of the relative distance to the load.

    In proportion to the override itself, since the load's answer to a step of override is too.
    """
    return np.maximum(override * (1.0 + share * (1.0 - load / target)), LOWEST_OVERRIDE)


class ConstantLoad:
    """Constant spindle load by feed, in the manner of FANUC iAdaptS.

    The override integrates the relative distance of the load from its target, within its limits. What iAdaptS does against
    chatter, dithering the feed, is left out: the lathe's model has no limit of stability. The law itself is an assumption, as
    none is published.

    Args:
        program: what the override acts on.
        target: load that is aimed at, as a share of the one at the power limit [-].
        gain: of the integration [1/s].
    """

    def __init__(self, program: PartProgram, target: float, gain: float) -> None:
        self._program = program
        self._target = target_load(program.scenario, target)
        self._share = lag_share(program.scenario.control.interval, 1.0 / gain)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Nothing to forget: what is integrated is the override, which is in the observation."""

    def act(self, observations: Observations) -> Actions:
        """Actions, shape (lanes, 1 to 3), for observations, shape (lanes, entries)."""
        program = self._program
        reading = read(observations, program.scenario)
        return program.act(reading, towards_load(program.override(reading), reading.load, self._target, self._share))


class OneLineLaw:
    """Override = 160 - 2 load, in per cent, within 0 to 120 %: a published law of one line, which has no target.

    Args:
        program: what the override acts on.
    """

    def __init__(self, program: PartProgram) -> None:
        self._program = program

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Nothing to forget."""

    def act(self, observations: Observations) -> Actions:
        """Actions, shape (lanes, 1 to 3), for observations, shape (lanes, entries)."""
        reading = read(observations, self._program.scenario)
        return self._program.act(reading, np.clip(1.6 - 2.0 * reading.load, 0.0, 1.2))


def _build_constant_load(scenario: Scenario, num_envs: int, parameters: Parameters) -> ConstantLoad:
    return ConstantLoad(PartProgram(scenario, parameters), parameters["target"], parameters["gain"])


def _build_one_line_law(scenario: Scenario, num_envs: int, parameters: Parameters) -> OneLineLaw:
    return OneLineLaw(PartProgram(scenario, parameters))


def _build_programmed_feed(scenario: Scenario, num_envs: int, parameters: Parameters) -> FixedParameters:
    return FixedParameters(scenario, scenario.control.initial_cutting_speed, scenario.control.initial_feed)


CONSTANT_LOAD = "constant spindle load by feed, in the manner of FANUC iAdaptS"
ONE_LINE = "override = 160 - 2 load, in per cent, within 0 to 120 %"

RULES = {
    "programmed_feed": Rule("the scenario's programmed speed and feed, uncontrolled", _build_programmed_feed, sets_feed, {}),
    "one_line_law": Rule(ONE_LINE, _build_one_line_law, on_override, {}),
    "iadapts": Rule(
        CONSTANT_LOAD,
        _build_constant_load,
        on_override,
        {"target": Range(0.7, 1.0), "gain": Range(1.0, 40.0, logarithmic=True)},
    ),
    "one_line_law_with_speed": Rule(
        f"{ONE_LINE}, with the program's speed and feed tuned",
        _build_one_line_law,
        on_speed_and_feed,
        {"cutting_speed": Range(50.0, 200.0), "feed": Range(0.06, 0.60, logarithmic=True)},
    ),
    "iadapts_with_speed": Rule(
        f"{CONSTANT_LOAD}, with the program's speed tuned",
        _build_constant_load,
        on_speed_and_feed,
        {**SPEED_AND_TARGET, "gain": Range(0.1, 5.0, logarithmic=True)},
    ),
}
