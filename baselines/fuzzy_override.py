"""Feed override by fuzzy aggregation of spindle load and present override.

The equations (1) to (7) are those of the fuzzy override paper. Each step computes the new override
O_n from the present one O_a and the load M_a. M_z is the target load, O_m the highest override. All
are shares; the paper states per cent, with O_m = 200 %.

    W_k = k exp(-5 (M_a / M_z)^2)                                    M_a < M_z    (1), (5)
    O_n = O_m (O_a / O_m + W_k - W_k O_a / O_m)                      M_a < M_z    (3)
    W_k = p exp(-10 / (1 - M_z) (M_a - M_z)^2) + 1 - p               M_a >= M_z   (2), (6)
    O_n = W_k (O_a - d) + d                                          M_a >= M_z   (4), (7)

The first form, (1) to (4), has k = p = 1 and d = 0. The modified form, (5) to (7), has k = p = 0.1
and d = 25 %, to reduce over-regulation.

The paper does not say which branch holds for M_a = M_z. Here it is (4), which keeps the override.
The paper calls O_n continuous, but it jumps at M_z: just below, (1) and (3) still raise the
override, by exp(-5) = 0.67 % of its distance from O_m.

Uses nothing from the nominal model.
"""

import numpy as np

from baselines.models.part_program import (
    SPEED_AND_TARGET,
    OverrideLaw,
    PartProgram,
    override_rules,
    target_load,
)
from baselines.rule import Array, published
from turning_env import Reading
from turning_env.numerics.functions import exp

MIN_HEADROOM = 0.05
"""Lower bound of 1 - M_z in (2) and (6) [-] (assumption): the target may be the rated load or
more."""

FIRST_FORM = {"k": 1.0, "p": 1.0, "d": 0.0}  # published values [-]
MODIFIED_FORM = {"k": 0.1, "p": 0.1, "d": 0.25}  # published values [-]


def rising_correction(load: Array, target: float, k: float) -> Array:
    """Return W_k [-] below the target load, by equations (1) and (5)."""
    return np.asarray(k * exp(-5.0 * (load / target) ** 2))


def falling_correction(load: Array, target: float, p: float) -> Array:
    """Return W_k [-] from the target load on, by equations (2) and (6)."""
    headroom = max(1.0 - target, MIN_HEADROOM)
    return np.asarray(p * exp(-10.0 / headroom * (load - target) ** 2) + 1.0 - p)


def disjunction(override: Array, correction: Array, override_max: float) -> Array:
    """Return the raised override [-], by equation (3)."""
    return override + correction * (override_max - override)


def conjunction(override: Array, correction: Array, d: float) -> Array:
    """Return the lowered override [-], by equations (4) and (7)."""
    return correction * (override - d) + d


def new_override(
    override: Array, load: Array, target: float, override_max: float, k: float, p: float, d: float
) -> Array:
    """Return the new override [-] by equations (1) to (7).

    Args:
        override: present override O_a [-], shape (num_envs,).
        load: load M_a [-], shape (num_envs,).
        target: target load M_z [-].
        override_max: highest override O_m [-].
        k: constant of equation (5).
        p: constant of equation (6).
        d: constant of equation (7).
    """
    raised = disjunction(override, rising_correction(load, target, k), override_max)
    lowered = conjunction(override, falling_correction(load, target, p), d)
    return np.asarray(np.where(load < target, raised, lowered))


def fuzzy_override(
    program: PartProgram, num_envs: int, target: float, k: float, p: float, d: float
) -> OverrideLaw:
    """Return the controller that applies the equations in every step.

    Args:
        program: part program, whose feed the override scales.
        num_envs: number of environments; every environment follows the same law.
        target: target load over the load at the power limit [-].
        k: constant of equation (5).
        p: constant of equation (6).
        d: constant of equation (7).
    """
    target_now = target_load(program.scenario, target)

    def law(reading: Reading, override: Array) -> Array:
        return new_override(
            override,
            reading.load,
            target=target_now,
            override_max=program.override_max,
            k=k,
            p=p,
            d=d,
        )

    return OverrideLaw(program, law)


RULES = published(
    {
        **override_rules(
            "fuzzy_override",
            "fuzzy feed override, first form (fuzzy override paper, equations (1) to (4))",
            controller=fuzzy_override,
            parameters={"target": 1.0, **FIRST_FORM},
            with_speed={**SPEED_AND_TARGET, **FIRST_FORM},
        ),
        **override_rules(
            "modified_fuzzy_override",
            "fuzzy feed override, modified against over-regulation "
            "(fuzzy override paper, equations (5) to (7))",
            controller=fuzzy_override,
            parameters={"target": 1.0, **MODIFIED_FORM},
            with_speed={**SPEED_AND_TARGET, **MODIFIED_FORM},
        ),
    }
)
