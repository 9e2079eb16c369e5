"""Simple laws from spindle load to feed override: constant load, a straight line, and no control.

The law of constant load imitates FANUC iAdaptS: the override integrates the relative deviation of the load from its target
(assumption: no law is published). The dithering of the feed against chatter is left out, because the model has no stability
limit.

They need nothing of the nominal model.
"""

import numpy as np
from numpy.typing import NDArray

from baselines.fixed import FixedParameters
from baselines.models.part_program import PROGRAM, SPEED_AND_TARGET, OverrideLaw, PartProgram, override_rules, target_load
from baselines.rule import Range, Rule
from turning_env.action import sets_feed
from turning_env.physics.drives import lag_share

LOWEST_OVERRIDE = 0.1
"""Lowest override of the commercial controls [-] (assumption): at zero feed, the edge would only rub."""


def towards_load(
    override: NDArray[np.float64], load: NDArray[np.float64], target: NDArray[np.float64] | float, share: float
) -> NDArray[np.float64]:
    """Return ``override * (1 + share * (1 - load / target))`` [-], at least ``LOWEST_OVERRIDE``.

    The change is proportional to the override, because the resulting change of load is, too.
    """
    return np.maximum(override * (1.0 + share * (1.0 - load / target)), LOWEST_OVERRIDE)


def constant_load(program: PartProgram, num_envs: int, target: float, gain: float) -> OverrideLaw:
    """Return the controller of constant load.

    Args:
        program: part program.
        num_envs: number of environments.
        target: load over the load at the power limit [-].
        gain: gain of the integration [1/s].
    """
    aim = target_load(program.scenario, target)
    share = lag_share(program.scenario.control.interval, 1.0 / gain)
    return OverrideLaw(program, lambda reading, override: towards_load(override, reading.load, aim, share))


def one_line_law(program: PartProgram, num_envs: int) -> OverrideLaw:
    """Return the controller of a published law without target: override = 160 - 2 load [%], within 0 to 120 %."""
    return OverrideLaw(program, lambda reading, override: np.clip(1.6 - 2.0 * reading.load, 0.0, 1.2))


RULES = {
    "programmed_feed": Rule(
        "the scenario's programmed speed and feed, uncontrolled",
        lambda scenario, num_envs, parameters: FixedParameters(
            scenario, scenario.control.initial_cutting_speed, scenario.control.initial_feed
        ),
        sets_feed,
        {},
    ),
    **override_rules("one_line_law", "override = 160 - 2 load, in per cent, within 0 to 120 %", one_line_law, {}, PROGRAM),
    **override_rules(
        "iadapts",
        "constant spindle load by feed, in the manner of FANUC iAdaptS",
        constant_load,
        {"target": Range(0.7, 1.0), "gain": Range(1.0, 40.0, logarithmic=True)},
        {**SPEED_AND_TARGET, "gain": Range(0.1, 5.0, logarithmic=True)},
        worth_tuning=True,
    ),
}
