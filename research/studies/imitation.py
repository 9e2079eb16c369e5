"""How far an agent on a belief is from the rule ``self_tuning`` in the states that it visits.

    python -m research.studies.imitation my-agents/dagger-seed0.onnx

The agent plays training jobs, side by side, and the rule says at every step where it would go. The
table has the differences of their next set points. "Per job" is the median difference in a job, as
a root mean square over jobs: the agent believes in another set point. "Rest" is what varies about
it.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.policy_spec import PolicySpec
from leaderboard.agents import onnx_policy
from leaderboard.agents.agent_file import training_family
from leaderboard.inputs import Inputs
from leaderboard.seeds import TUNING_START
from leaderboard.table import markdown
from train.dagger import TaughtVecEnv
from turning_env import FAMILY_ID
from turning_env.console import UserError, described, exits

FIRST_STEPS = 200
"""Steps that do not count [-]: all jobs have just begun."""


def differences(agent: PolicySpec, jobs: int, steps: int) -> dict[str, NDArray[np.float64]]:
    """Return log ratios of the agent's set points over the rule's [-], each of (steps, jobs).

    Raises:
        UserError: the agent does not play a family with a belief.
    """
    family = None
    if "family" in agent.parameters:
        family = training_family(FAMILY_ID, agent.parameters)
    if family is None or not Inputs.of(agent.parameters).belief:
        raise UserError(f"{agent.name} does not play a family with a belief")

    env: Any = TaughtVecEnv(family, jobs)
    env.seed(TUNING_START)
    observations = env.reset()
    policy = agent.make(jobs)
    policy.reset(np.ones(jobs, np.bool_))
    errors = []
    for step in range(FIRST_STEPS + steps):
        actions = policy.act(observations)
        if step >= FIRST_STEPS:
            errors.append(actions - env.labels())
        observations, _, ended, _ = env.step(actions)
        policy.reset(ended)

    control = family.job(0).scenario.control
    action_errors = np.array(errors, np.float64)
    speed = control.cutting_speed_step * action_errors[:, :, 0]
    feed = control.feed_step * action_errors[:, :, 1]
    return {
        "cutting speed": speed,
        "feed": feed,
        "removal rate": speed + feed,
    }


def row(name: str, errors: NDArray[np.float64]) -> dict[str, str]:
    """Return a table's row for errors of shape (steps, jobs)."""
    per_job = np.median(errors, axis=0)
    rest = errors - per_job
    mean = errors.mean()
    spread_per_job = np.sqrt(np.square(per_job).mean())
    spread_of_rest = np.sqrt(np.square(rest).mean())
    return {
        "Set point": name,
        "Mean [%]": f"{100.0 * mean:.1f}",
        "Per job [%]": f"{100.0 * spread_per_job:.1f}",
        "Rest [%]": f"{100.0 * spread_of_rest:.1f}",
    }


@exits(ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m research.studies.imitation", **described(__doc__)
    )
    parser.add_argument("agent", type=Path, help="file of the agent")
    parser.add_argument("--jobs", type=int, default=128, help="jobs (default: %(default)s)")
    parser.add_argument(
        "--steps", type=int, default=1000, help="steps of each that count (default: %(default)s)"
    )
    parsed = parser.parse_args(arguments)
    if parsed.jobs < 1 or parsed.steps < 1:
        parser.error("--jobs and --steps must be at least 1")
    errors = differences(onnx_policy.load(parsed.agent), parsed.jobs, parsed.steps)
    print(markdown([row(name, values) for name, values in errors.items()]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
