"""The output block of the roughness control paper: wear, tool life, operation cost and resultant force from ``info``.

They are computed from what steps report, so a step costs no more where nobody asks for them.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turning_env.scenario import Scenario

Values = NDArray[np.float64]


class OutputBlock(NamedTuple):
    """Quantities at the end of a step; arrays of the shape of the values in ``info``."""

    wear: Values
    """Flank wear [mm]."""
    tool_life: Values
    """Cutting time in which this insert, fresh, would wear out at the present conditions [min]; infinite in air."""
    operation_cost: Values
    """Price of the step's machine time and edges [s of machine time]."""
    resultant_force: Values
    """Resultant cutting force [N]."""


def output_block(infos: Mapping[str, Any], scenario: Scenario) -> OutputBlock:
    """Return the output block for the ``info`` of one step or of many.

    The tool life solves the wear law W = K t^n for the tool-life criterion; a skin's wear is left out. The main cutting force is
    60000 power / cutting speed. With the thrust force it makes the resultant; no law gives the third component. In scenarios
    that hold a roughness, the thrust force replaces the resultant, as equation (5) of the paper takes it.

    Args:
        infos: values of ``info``, such as those of ``RoughTurningVectorEnv.step``; arrays of one shape.
        scenario: task.
    """
    law, cutting = scenario.material.wear, np.asarray(infos["cutting"]) > 0
    speed, power, thrust = infos["cutting_speed"], infos["power"], np.asarray(infos["thrust_force"])
    depth, hardness = (np.where(cutting, infos[name], 1.0) for name in ("depth_of_cut", "hardness"))
    wear_after_a_minute = infos["wear_factor"] * law(speed, infos["feed"], depth, 1.0, hardness=hardness)
    life = (scenario.tool.wear_criterion / wear_after_a_minute) ** (1.0 / law.time)
    cost = -(infos["reward_time"] + infos["reward_edge"] + infos["reward_breakage"])
    resultant = thrust if scenario.control.aim == "roughness" else np.hypot(60000.0 * power / speed, thrust)
    return OutputBlock(np.asarray(infos["wear"]), np.where(cutting, life, np.inf), np.asarray(cost), resultant)
