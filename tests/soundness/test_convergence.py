"""The integration is of first order.

Twice as many sub-steps halve the error of an episode's first sums.
"""

from typing import Any

import numpy as np
import pytest

from tests.turning_env.playing import changed, fixed_actions, infos
from turning_env import Scenario

SUB_STEPS = (5, 10, 20, 40)
SMOOTH = {
    "workpiece": {"depth_ripple": 0.0, "approach": 0.0, "depth_profile": ()},
    "tool": {"edge_strength": 1e6},
    "mismatch": {"initial_wear": 0.0},
}
"""A lathe without depth steps and breakage, whose positions would hide the order.

Fields, lags and wear stay.
"""


def sums(preset: str, seed: int, sub_steps: int) -> dict[str, float]:
    """Return the sums over a dozen steps of a swinging command."""
    control = {"sub_steps": sub_steps, "time_limit": 60.0}
    scenario: Any = changed(Scenario.load(preset), **SMOOTH, control=control)
    actions = 0.5 * fixed_actions(12, 1, scenario)[:, 0]
    steps = infos(scenario, actions, seed)
    return {
        "removed": sum(info["removed"] for info in steps),
        "path": steps[-1]["path"],
        "used_life": steps[-1]["used_life"],
    }


@pytest.mark.parametrize("preset", ["rough_turning", "override", "forging"])
def test_errors_halve_with_twice_as_many_sub_steps(preset: str) -> None:
    for seed in range(2):
        refinements = [sums(preset, seed, sub_steps) for sub_steps in SUB_STEPS]
        for name in refinements[0]:
            values = [refinement[name] for refinement in refinements]
            differences = np.abs(np.diff(values))
            ratios = differences[:-1] / differences[1:]
            assert ratios.min() > 1.6, (seed, name, ratios)
            assert ratios.max() < 2.6, (seed, name, ratios)
