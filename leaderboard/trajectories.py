"""Recorded trajectories of policies on the same few seeds, thinned to a screen's resolution."""

from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from leaderboard.result import Part
from turning_env import RoughTurningEnv, Scenario
from turning_env.scoring.policy import PolicySpec

SCHEMA: Literal["rough-turning/trajectories/4"] = "rough-turning/trajectories/4"
SERIES = (
    "path",  # tool position, air and metal [mm]
    "depth_of_cut",  # [mm], 0 in air
    "hardness",  # relative to nominal [-], 0 in air
    "cutting_speed",  # [m/min]
    "feed",  # [mm/rev]
    "thrust_force",  # [N]; of a whole part, its mean
    "power",  # [kW]; likewise
    "wear",  # [mm]
    "roughness",  # [um], 0 where none is held
    "roughness_reference",  # [um], likewise
)
"""Recorded from ``info`` at the end of steps, beside ``minutes``, the machine time elapsed."""
RECORDED_SEEDS = 3  # so many of the first seeds of a task are recorded
MAX_RECORDED = 12  # so many of the best policies are recorded, beside those that others are compared with and one's own
MAX_STEPS = 300  # steps kept of an episode; a screen does not show more
_DIGITS = {"minutes": 5, "path": 5}  # significant ones, enough to draw; of others 4


class Trajectory(Part):
    """One episode of one policy."""

    policy: PolicySpec
    seed: int
    steps: int  # steps played; see kept for those in series
    series: dict[str, list[float]]  # minutes and each of SERIES, one value per step kept

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if set(self.series) != {"minutes", *SERIES}:
            raise ValueError(
                f"series holds {', '.join(self.series)}, but must hold {', '.join(('minutes', *SERIES))}"
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
    """Play one episode and keep its trajectory, thinned. Raise ValueError if an action has the wrong shape or is not finite."""
    # After a whole part the tool may be in air, so the part's means are recorded.
    reported = (
        {"thrust_force": "mean_thrust_force", "power": "mean_power"}
        if scenario.control.action == "part"
        else {}
    )
    env, policy = RoughTurningEnv(scenario), spec.make(1)
    observation, _ = env.reset(seed=seed)
    policy.reset(np.ones(1, np.bool_))
    rows: list[tuple[float, ...]] = []
    elapsed, ended = 0.0, False
    while not ended:
        observation, _, terminated, truncated, info = env.step(policy.act(observation[None])[0])
        elapsed += info["time"] / 60.0
        rows.append((elapsed, *(info[reported.get(name, name)] for name in SERIES)))
        ended = terminated or truncated
    whole = dict(zip(("minutes", *SERIES), np.array(rows).T, strict=True))
    steps = kept(whole, scenario)
    series = {
        name: [float(f"{value:.{_DIGITS.get(name, 4)}g}") for value in values[steps]]
        for name, values in whole.items()
    }
    return Trajectory(policy=spec, seed=seed, steps=len(rows), series=series)


def kept(trajectory: dict[str, NDArray[np.float64]], scenario: Scenario) -> NDArray[np.intp]:
    """Return the steps of a trajectory to keep: all if they are no more than ``MAX_STEPS``.

    Otherwise the steps with the least and the greatest load relative to a limit in each group of neighbours, so that no overload
    is lost however short. Steps in metal come before steps in air. The last step is always kept.
    """
    count = len(trajectory["minutes"])
    if count <= MAX_STEPS:
        return np.arange(count)
    load = np.maximum(
        trajectory["thrust_force"] / scenario.limits.thrust_force,
        trajectory["power"] / scenario.limits.power,
    )
    chosen = {count - 1}
    for group in np.array_split(np.arange(count), (MAX_STEPS - 1) // 2):
        metal = group[trajectory["depth_of_cut"][group] > 0.0]
        seen = metal if metal.size else group
        chosen |= {int(seen[np.argmin(load[seen])]), int(seen[np.argmax(load[seen])])}
    return np.array(sorted(chosen))
