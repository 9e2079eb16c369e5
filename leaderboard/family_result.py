"""Results on the jobs of a family, a file per split and policy. They hold what the table of a family is computed from.

A result is identified as on other leaderboards (``leaderboard/result.py``), and by the family's values and the split. A file may
hold some of the jobs only: those that have been played.
"""

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import ClassVar, Self

import numpy as np

from leaderboard.result import Result, ResultError, Task, read_result, result_folder, result_path, tell_once
from turning_env import FAMILY_ID, Scenario
from turning_env.files import digest_of
from turning_env.scenario.family import Family
from turning_env.scoring.play import Episodes
from turning_env.scoring.policy import PolicySpec, ScenarioId

FIELDS = ("return", "reward_metal", "steps", "engaged_time", "severe_overload_time")
"""The fields of an episode that are kept."""
Rows = Mapping[int, Collection[float]]
"""Values of ``FIELDS`` by the seeds of episodes."""


class FamilyTask(Task):
    """Episodes on the jobs of one split of a family. The scenario, named after both, has the values that no job draws."""

    family: ScenarioId
    """Name, and SHA-256 of the values."""
    split: str
    jobs: int
    """Number of jobs of the split. A seed plays the job of its remainder."""

    @classmethod
    def of(cls, family: Family, split: str, seeds: Iterable[int] = ()) -> Self:
        """Return the task of a family's split."""
        allowance = family.job(0).scenario.limits.overload_allowance
        values = {"base": family.base, "name": f"{family.name}-{split}", "limits": {"overload_allowance": allowance}}
        identity = ScenarioId(name=family.name, digest=family.digest())
        jobs = family.jobs if split == "train" else family.held_out_jobs
        scenario = Scenario.load(values)
        return cls(env_id=FAMILY_ID, scenario=scenario, seeds=sorted(seeds), family=identity, split=split, jobs=jobs)

    def seeds_of(self, numbers: Iterable[int], episodes: int) -> list[int]:
        """Return the seeds of the first episodes of jobs."""
        return [number + self.jobs * k for number in numbers for k in range(episodes)]

    @property
    def digest(self) -> str:
        """Return the SHA-256 of what identifies the task."""
        return digest_of([super().digest, self.family.digest, self.split])

    def present(self) -> Family:
        """Return the family.

        Raises:
            ResultError: there is none of that name, or it has other values.
        """
        try:
            family = Family.load(self.family.name)
            if FamilyTask.of(family, self.split, self.seeds).digest == self.digest:
                return family
        except ValueError as error:
            raise ResultError(f"cannot be played again: {error}") from error
        raise ResultError(f"is not of the present family {family.name!r}: values differ")


class FamilyResult(Result):
    """One policy's episodes on a family's split."""

    FIELDS: ClassVar = FIELDS
    task: FamilyTask

    @classmethod
    def of_rows(cls, task: FamilyTask, policy: PolicySpec, rows: Rows) -> Self:
        """Return the result of episodes that are given by seed."""
        seeds = sorted(rows)
        return cls.of(task.model_copy(update={"seeds": seeds}), policy, columns(rows, seeds))

    @property
    def rows(self) -> Rows:
        """Return the episodes by seed."""
        return dict(zip(self.task.seeds, zip(*(self.episodes[name] for name in FIELDS), strict=True), strict=True))


def columns(rows: Rows, seeds: Collection[int]) -> Episodes:
    """Return the episodes of seeds as an array of shape (seeds,) for each of ``FIELDS``."""
    values = np.array([rows[seed] for seed in seeds]).T
    return dict(zip(FIELDS, values, strict=True))


def kept(results: Path, task: FamilyTask, policy: PolicySpec) -> Rows:
    """Return the episodes that a folder of results keeps of a policy on a task, by seed; none if either has changed."""
    path = result_path(result_folder(results, task.env_id, task.scenario.name), policy)
    try:
        if not path.exists():
            return {}
        result = read_result(path, FamilyResult)
        if result.is_of(task.model_copy(update={"seeds": result.task.seeds}), policy):
            return result.rows
        tell_once(f"{path} is of another version of family or policy, and is played again")
    except ResultError as error:
        tell_once(f"played again: {error}")
    return {}
