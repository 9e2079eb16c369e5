"""Feed override by fuzzy aggregation of spindle load and present override (fuzzy override paper, equations (1) to (7)).

In every interpolator cycle the new override follows from the present one and from the load. In equations, where M_a is the load,
M_z its target, O_a the present override, O_n the new one and O_m the highest, all as shares (the paper has them in per cent, and
O_m = 200 %):

    W_k = k exp(-5 (M_a / M_z)^2)                                    M_a < M_z    (1), (5)
    O_n = O_m (O_a / O_m + W_k - W_k O_a / O_m)                      M_a < M_z    (3)
    W_k = p exp(-10 / (1 - M_z) (M_a - M_z)^2) + 1 - p               M_a >= M_z   (2), (6)
    O_n = W_k (O_a - d) + d                                          M_a >= M_z   (4), (7)

(1) to (4) are the first form: k = p = 1, d = 0. Against its over-regulation, (5) to (7) have k = p = 0.1 and d = 25 %.

The paper leaves M_a = M_z open. Here it belongs to the upper branch, which then keeps the override as it is; the lower one would
go on raising it.
"""

import numpy as np
from numpy.typing import NDArray

from baselines.models.part_program import SPEED_AND_TARGET, PartProgram, on_override, on_speed_and_feed, target_load
from baselines.rule import Parameters, Rule
from turning_env import Scenario, read
from turning_env.score.policy import Actions, Observations

MIN_HEADROOM = 0.05
"""What (2) and (6) take for 1 - M_z where it is less [-]: the target may lie at the rated load or above (assumption)."""

FIRST_FORM = {"k": 1.0, "p": 1.0, "d": 0.0}
MODIFIED_FORM = {"k": 0.1, "p": 0.1, "d": 0.25}
"""As published [-]."""


def new_override(
    override: NDArray[np.float64], load: NDArray[np.float64], target: float, override_max: float, k: float, p: float, d: float
) -> NDArray[np.float64]:
    """The new override [-] for a present one and a load [-], each of shape (lanes,): equations (1) to (7)."""
    rising = k * np.exp(-5.0 * (load / target) ** 2)
    headroom = max(1.0 - target, MIN_HEADROOM)
    falling = p * np.exp(-10.0 / headroom * (load - target) ** 2) + 1.0 - p
    real_power = override + rising * (override_max - override)
    lowered = falling * (override - d) + d
    return np.where(load < target, real_power, lowered)


class FuzzyOverride:
    """Applies the equations in every control interval.

    Args:
        program: what the override acts on.
        target: load that is aimed at, as a share of the one at the power limit [-].
        k, p, d: coefficients of the equations [-].
    """

    def __init__(self, program: PartProgram, target: float, k: float, p: float, d: float) -> None:
        self._program = program
        self._target = target_load(program.scenario, target)
        self._coefficients = (k, p, d)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Nothing to forget: the present override is in the observation."""

    def act(self, observations: Observations) -> Actions:
        """Actions, shape (lanes, 1 to 3), for observations, shape (lanes, entries)."""
        program = self._program
        reading = read(observations, program.scenario)
        present = program.override(reading)
        new = new_override(present, reading.load, self._target, program.override_max, *self._coefficients)
        return program.act(reading, new)


def _build(scenario: Scenario, num_envs: int, parameters: Parameters) -> FuzzyOverride:
    coefficients = {name: parameters[name] for name in ("target", "k", "p", "d")}
    return FuzzyOverride(PartProgram(scenario, parameters), **coefficients)


FIRST = "fuzzy feed override, first form (fuzzy override paper, equations (1) to (4))"
MODIFIED = "fuzzy feed override, modified against over-regulation (fuzzy override paper, equations (5) to (7))"

RULES = {
    "fuzzy_override": Rule(FIRST, _build, on_override, {"target": 1.0, **FIRST_FORM}),
    "modified_fuzzy_override": Rule(MODIFIED, _build, on_override, {"target": 1.0, **MODIFIED_FORM}),
    "fuzzy_override_with_speed": Rule(
        f"{FIRST}, with speed and target tuned", _build, on_speed_and_feed, {**SPEED_AND_TARGET, **FIRST_FORM}
    ),
    "modified_fuzzy_override_with_speed": Rule(
        f"{MODIFIED}, with speed and target tuned", _build, on_speed_and_feed, {**SPEED_AND_TARGET, **MODIFIED_FORM}
    ),
}
"""As published where the feed override is all there is to set."""
