"""The linear policy at which a search on a family starts: the nominal optimum of each job.

It commands the speed and feed that are best by the job's nominal model, and changes the edge when
it is worn by that model, as ``fixed_nominal_optimum`` does. Observations show commands by their
place in the machine's range of logarithms, -1 at the low end and 1 at the high one. There, the
optimum x* is linear in the context, so least squares on training jobs finds it. An action of 1
moves a command x by s, so x* is reached with

    action = (x* - x) / s
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.nominal_optimum import CHANGE_WEAR
from turning_env import Family, Scenario
from turning_env.physics.quantities import action_size, layout
from turning_env.scenario.family import Job

Array = NDArray[np.float64]

JOBS = 256
"""Training jobs on which the optimum is fitted."""
EDGE_GAIN = 5.0
"""Action of an edge change per nominal wear over the criterion [-]; any number above 0 will do."""


class LinearStart(NamedTuple):
    """An action W x + c of an observation x with the context at its end."""

    matrix: Array  # W, shape (actions, entries)
    constants: Array  # c, shape (actions,)


def nominal_optimum(family: Family) -> LinearStart:
    """Return the linear policy that plays the nominal optimum of each job of a family.

    The family's actions are incremental.
    """
    scenario = family.job(0).scenario
    control = scenario.control
    entries = layout(scenario)
    context = slice(len(entries), len(entries) + len(family.context_names))
    matrix = np.zeros((action_size(scenario), context.stop))
    constants = np.zeros(len(matrix))

    jobs = [family.job(index) for index in range(JOBS)]
    contexts_and_one = np.column_stack([[job.context for job in jobs], np.ones(JOBS)])
    steps = {"cutting_speed": control.cutting_speed_step, "feed": control.feed_step}
    for row, (name, step) in enumerate(steps.items()):
        places = [_place(job, name) for job in jobs]
        weights = np.linalg.lstsq(contexts_and_one, places)[0]
        gain = 0.5 * _log_range(scenario, name) / step
        matrix[row, entries.index(f"commanded_{name}")] = -gain
        matrix[row, context] = gain * weights[:-1]
        constants[row] = gain * weights[-1]
    if control.edge_changes == "commanded":
        matrix[-1, entries.index("nominal_wear")] = EDGE_GAIN
        constants[-1] = -EDGE_GAIN * CHANGE_WEAR
    return LinearStart(matrix, constants)


def _place(job: Job, name: str) -> float:
    """Return the place of the nominal optimum's cutting speed or feed in the machine's range."""
    lowest = getattr(job.scenario.machine, f"{name}_min")
    optimum = getattr(job, name)
    return 2.0 * math.log(optimum / lowest) / _log_range(job.scenario, name) - 1.0


def _log_range(scenario: Scenario, name: str) -> float:
    """Return the logarithm of the highest over the lowest cutting speed or feed."""
    machine = scenario.machine
    return math.log(getattr(machine, f"{name}_max") / getattr(machine, f"{name}_min"))
