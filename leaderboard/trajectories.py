"""Recorded trajectories of policies on the same few seeds, thinned to a screen's resolution."""

from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from baselines.comparators import CAUSAL
from baselines.policy_spec import PolicySpec
from leaderboard.family import environment_of, episode_of
from leaderboard.result import Part
from turning_env import Scenario

SCHEMA: Literal["rough-turning/trajectories/4"] = "rough-turning/trajectories/4"
SERIES = (
    "path",  # tool position, air and metal [mm]
    "depth_of_cut",  # [mm], 0 in air
    "hardness",  # relative to nominal [-], 0 in air
    "cutting_speed",  # [m/min]
    "feed",  # [mm/rev]
    "thrust_force",  # [N]; of a whole part, its mean
    "power",  # [kW]; of a whole part, its mean
    "wear",  # [mm]
    "roughness",  # [um], 0 where none is held
    "roughness_reference",  # [um], 0 where none is held
)
"""Recorded from ``info`` at the end of steps, beside ``minutes``, the machine time elapsed."""
PART_MEANS = {"thrust_force": "mean_thrust_force", "power": "mean_power"}
"""Entries of ``info`` that are recorded if a step is a whole part, after which the tool may be in
air."""
RECORDED_SEEDS = 3  # number of a task's first seeds that are recorded
MAX_RECORDED = 12
"""Number of the best policies that are recorded.

The policies that others are compared with, and one's own, are recorded as well. On a family the
best of each class stands for all: jobs last long.
"""
MAX_STEPS = 300  # steps kept of an episode; a screen does not show more
DIGITS = 4  # significant digits, enough to draw
LONG_DIGITS = 5  # of series that grow throughout the episode
_GROWING = ("minutes", "path")


class JobLimits(Part):
    """The limits of a job."""

    thrust_force: float  # [N]
    power: float  # [kW]
    wear: float  # tool-life criterion [mm]

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """Return the limits of a scenario."""
        limits = scenario.limits
        wear = scenario.tool.wear_criterion
        return cls(thrust_force=limits.thrust_force, power=limits.power, wear=wear)


class Trajectory(Part):
    """One episode of one policy."""

    policy: PolicySpec
    seed: int  # of a family, the job's number
    steps: int  # steps played; see steps_to_keep for those in series
    series: dict[str, list[float]]  # minutes and each of SERIES, one value per step kept
    limits: JobLimits | None = None  # of a family's job; None: those of the task's scenario

    @model_validator(mode="after")
    def _check_series(self) -> Self:
        required = ("minutes", *SERIES)
        if set(self.series) != set(required):
            raise ValueError(
                f"series holds {', '.join(self.series)}, but must hold {', '.join(required)}"
            )
        lengths = {len(values) for values in self.series.values()}
        if len(lengths) != 1 or not 1 <= min(lengths) <= self.steps:
            raise ValueError(
                f"the series must be of one length, of at least one and at most {self.steps} steps"
            )
        return self


class Trajectories(Part):
    """Episodes of several policies on a few seeds."""

    schema_: Literal["rough-turning/trajectories/4"] = Field(alias="schema", default=SCHEMA)
    task: str  # the task's digest
    episodes: list[Trajectory]


def record(spec: PolicySpec, scenario: Scenario, seed: int) -> Trajectory:
    """Play one episode and keep its trajectory, thinned.

    Args:
        spec: the policy; on a family, it knows the family.
        scenario: the scenario of its task.
        seed: seed, or number of a family's job.

    Raises:
        ValueError: an action has the wrong shape or is not finite.
    """
    episode = episode_of(spec, scenario, seed)
    is_job = episode.scenario is not scenario
    scenario = episode.scenario
    entries = {name: name for name in SERIES}
    if scenario.control.action == "part":
        entries |= PART_MEANS
    env = environment_of(episode)
    policy: Any = episode.policy
    observation, info = env.reset(seed=seed)
    policy.reset(np.ones(1, np.bool_))

    recorded: dict[str, list[float]] = {name: [] for name in ("minutes", *SERIES)}
    minutes = 0.0
    ended = False
    while not ended:
        if spec.name == CAUSAL:
            policy.tell({name: np.atleast_1d(value) for name, value in info.items()})
        actions = policy.act(observation[None])
        observation, _, terminated, truncated, info = env.step(actions[0])
        minutes += info["time"] / 60.0
        recorded["minutes"].append(minutes)
        for name, entry in entries.items():
            recorded[name].append(info[entry])
        ended = terminated or truncated

    trajectory = {name: np.array(values, np.float64) for name, values in recorded.items()}
    kept = steps_to_keep(trajectory, scenario)
    series = {name: _rounded(name, values[kept]) for name, values in trajectory.items()}
    return Trajectory(
        policy=spec,
        seed=seed,
        steps=len(recorded["minutes"]),
        series=series,
        limits=JobLimits.of(scenario) if is_job else None,
    )


def _rounded(name: str, values: NDArray[np.float64]) -> list[float]:
    """Return the values of a series in few significant digits."""
    digits = LONG_DIGITS if name in _GROWING else DIGITS
    return [float(f"{value:.{digits}g}") for value in values]


def steps_to_keep(
    trajectory: dict[str, NDArray[np.float64]], scenario: Scenario
) -> NDArray[np.intp]:
    """Return the indices of the steps of a trajectory to keep, in order.

    These are all steps if there are no more than ``MAX_STEPS``. Otherwise the steps are split into
    groups of neighbours. Each group keeps the steps with the least and the greatest load relative
    to a limit, so that no overload is lost however short. Steps in metal come before steps in air.
    The last step is always kept.
    """
    count = len(trajectory["minutes"])
    if count <= MAX_STEPS:
        return np.arange(count)
    load = np.maximum(
        trajectory["thrust_force"] / scenario.limits.thrust_force,
        trajectory["power"] / scenario.limits.power,
    )
    in_metal = trajectory["depth_of_cut"] > 0.0
    chosen = {count - 1}
    # Each group keeps two steps, and one place is for the last step.
    for group in np.array_split(np.arange(count), (MAX_STEPS - 1) // 2):
        candidates = group[in_metal[group]]
        if not candidates.size:
            candidates = group
        chosen.add(int(candidates[np.argmin(load[candidates])]))
        chosen.add(int(candidates[np.argmax(load[candidates])]))
    return np.array(sorted(chosen))
