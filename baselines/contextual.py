"""``self_tuning`` whose highest speed is a linear law of the catalogue's numbers of a job.

    log(highest speed / start speed) = speed + sum of speed_NAME * (number NAME - 0.5)

Edges are changed at the used life ``change_at``. ``python -m train.tune_contextual`` finds the
law on the training jobs of a family; its parameters ship in ``baselines/tuned/families``. The rule
uses from the nominal model what ``optimiser`` uses.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from baselines import self_tuning
from baselines.guided import START_SHARE
from baselines.rule import Array, Scenarios
from baselines.self_tuning import SelfTuning
from turning_env.numerics.functions import exp

# Names of the parameters that are no slopes.
SPEED = "speed"
CHANGE_AT = "change_at"
MIDDLE = 0.5
"""Middle of the catalogue's numbers, most of which run from 0 to 1."""

Numbers = Sequence[Mapping[str, float]]
"""The catalogue's numbers of each job, by name (``Job.numbers``)."""


def slope_name(number: str) -> str:
    """Return the name of the parameter that is the slope of log speed over a catalogue's number."""
    return f"{SPEED}_{number}"


def log_speeds(parameters: Mapping[str, float], numbers: Numbers) -> Array:
    """Return the log highest speed over the start speed of each job by the law [-], shape (jobs,).

    Raises:
        ValueError: the law needs a number that a job lacks.
    """
    values = np.full(len(numbers), float(parameters[SPEED]))
    for name, slope in parameters.items():
        if not name.startswith(slope_name("")):
            continue
        number = name.removeprefix(slope_name(""))
        for job, known in enumerate(numbers):
            if number not in known:
                raise ValueError(
                    f"{name} needs the number {number!r} of the job, "
                    f"but there are {', '.join(known)}"
                )
            values[job] += slope * (known[number] - MIDDLE)
    return values


def with_highest_speeds(
    scenario: Scenarios, num_envs: int, log_speed: Array, change_at: float, **others: float
) -> SelfTuning:
    """Return a policy ``SelfTuning`` with a highest cutting speed for each environment, or for all.

    Args:
        scenario: nominal model, or one for each environment.
        num_envs: number of environments.
        log_speed: log of the highest speed over the start speed [-], shape (num_envs,) or (1,).
        change_at: used life at which edges are changed [-].
        others: the other parameters of ``SelfTuning``.
    """
    policy = SelfTuning(scenario, num_envs, change_at=change_at, **others)
    policy.top_speed[:] = START_SHARE * exp(log_speed)
    return policy


def contextual(
    scenario: Scenarios, num_envs: int, numbers: Numbers, **parameters: float
) -> SelfTuning:
    """Return a policy ``SelfTuning`` whose highest cutting speed the law sets for each job.

    Args:
        scenario: nominal model, or one for each environment.
        num_envs: number of environments.
        numbers: the catalogue's numbers of each scenario's job [-].
        parameters: those of the law, whose names begin with ``SPEED`` [-], and those of
            ``SelfTuning``.

    Raises:
        ValueError: the law needs a number that a job lacks.
    """
    log_speed = log_speeds(parameters, numbers)
    others = {name: value for name, value in parameters.items() if not name.startswith(SPEED)}
    return with_highest_speeds(scenario, num_envs, log_speed, **others)


RULES = {
    "contextual": replace(
        self_tuning.RULES["self_tuning"],
        description="self_tuning with a highest speed by a regression on the catalogue's numbers "
        "of the job",
        controller=contextual,
        version=1,
        needs_numbers=True,
    )
}
