"""Results: the episodes of policies on one task. Everything shown is computed from them.

A result is identified by its meaning: the environment's id, the model's version, the values in which the scenario differs from
the defaults, the seeds, and the policy (``PolicySpec.identity``). Neither source files nor package versions decide whether it is
valid.

The folder ``ID/SCENARIO`` of a folder of results holds them:

* ``LABEL.json.xz``, the result of one policy, written by ``python -m leaderboard run`` as soon as the policy has played;
* ``results.json.xz``, those of many policies, into which ``python -m leaderboard pack`` moves the former. A policy's own file
  counts in place of what it says;
* ``manifest.json`` for reviewers: the task, and for every policy the main numbers and the SHA-256 of its result;
* ``trajectories.json.xz``: see ``trajectories.py``.

Both kinds of result files have one form: JSON compressed with xz (``xzcat`` prints it), whose floats come back bit for bit.
"""

import json
import lzma
import sys
from collections.abc import Callable
from functools import cache, lru_cache
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
    model_validator,
)

from turning_env import MODEL_VERSION
from turning_env.console import printable
from turning_env.files import digest_of, replace_file
from turning_env.scenario import PortableScenario
from turning_env.scenario.family import Family
from turning_env.scoring.play import EPISODE_FIELDS, EXCESS_TIMES, Episodes
from turning_env.scoring.policy import PolicySpec, ScenarioId

SCHEMA: Literal["rough-turning/results/5"] = "rough-turning/results/5"
PACK_FILE = "results.json.xz"
TRAJECTORIES_FILE = "trajectories.json.xz"
MANIFEST_FILE = "manifest.json"
SUFFIX = ".json.xz"
RESULTS = Path(__file__).parent / "results"  # the results that come with the project
MAX_BYTES = 200_000_000  # largest size of a file, uncompressed
SCENARIO_FIELDS = tuple(name for name in EPISODE_FIELDS if name not in EXCESS_TIMES)
"""The fields of an episode that results keep; of ``EXCESS_TIMES`` they keep sums alone, see ``ExcessShares``."""
FAMILY_FIELDS = (
    "return",
    "reward_metal",
    "steps",
    "engaged_time",
    "overload_time",
    "severe_overload_time",
)
"""The fields of an episode that results on a family keep: volumes and edges of different jobs do not add up."""
_FOLDER_NAME = "^[A-Za-z0-9_-][A-Za-z0-9_.-]{0,127}$"
_RECORDED_VERSIONS = ("rough-turning", "numpy", "numba", "onnxruntime")


class ResultError(ValueError):
    """Results that cannot be used. The message names the file, and the field and its value, if any."""


class Part(BaseModel):
    """A part of a file: frozen; unknown keys, wrong types, NaN and infinity are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


def _expanded(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    first, _, last = value.partition("..")
    if not (first.isdecimal() and last.isdecimal() and 0 <= int(last) - int(first) < 10_000_000):
        raise ValueError(f"{value!r} is not a range of seeds like 0..255")
    return list(range(int(first), int(last) + 1))


def _compact(seeds: list[int]) -> str | list[int]:
    whole = bool(seeds) and seeds == list(range(seeds[0], seeds[0] + len(seeds)))
    return f"{seeds[0]}..{seeds[-1]}" if whole else seeds


Seeds = Annotated[list[int], BeforeValidator(_expanded), PlainSerializer(_compact)]
"""Seeds; in a file, ``first..last`` if they are consecutive."""


class FamilySplit(Part):
    """The split of a family whose jobs are played."""

    family: ScenarioId  # name, and SHA-256 of the values
    split: str = Field(pattern=_FOLDER_NAME)
    loaded: Family | None = Field(
        default=None, exclude=True, repr=False
    )  # the family, unless it was read from a file


class Task(Part):
    """The episodes that every policy of one leaderboard plays."""

    env_id: str = Field(pattern=_FOLDER_NAME)  # also names a folder
    model_version: int = MODEL_VERSION
    scenario: PortableScenario  # scenario; for a family, the values that all jobs share, under the name of family and split
    seeds: Seeds
    """Seeds, one per episode; for a family, job numbers. Private seeds are named by their places."""
    private: str | None = (
        None  # SHA-256 of private seeds, which a key determines; None: they are public
    )
    of_family: FamilySplit | None = None

    @model_validator(mode="after")
    def _names_places(self) -> Self:
        if self.private is not None and self.seeds != list(range(len(self.seeds))):
            raise ValueError("seeds that are private must be named by their places, 0 and up")
        return self

    @property
    def fields(self) -> tuple[str, ...]:
        """Return the fields of an episode that results keep."""
        return FAMILY_FIELDS if self.of_family else SCENARIO_FIELDS

    @property
    def home(self) -> str:
        """Return the name of the family or scenario for which policies are tuned and trained."""
        return self.of_family.family.name if self.of_family else self.scenario.name

    @property
    def digest(self) -> str:
        """Return the SHA-256 of the task's identity. Results on different tasks are never ranked together."""
        digest = digest_of(
            [self.env_id, self.model_version, self.scenario.digest(), self.private or self.seeds]
        )
        return (
            digest_of([digest, self.of_family.family.digest, self.of_family.split])
            if self.of_family
            else digest
        )


class ExcessShares(Part):
    """Shares of a policy's cutting time on a task with an excess over a limit above 2 % and above 10 % [-]."""

    above_2_percent: float = Field(ge=0.0, le=1.0)
    above_10_percent: float = Field(ge=0.0, le=1.0)

    @classmethod
    def of(cls, episodes: Episodes) -> Self | None:
        """Return the shares of episodes that have just been played; 0 without cutting, None if the episodes lack the times."""
        if not episodes.keys() >= {*EXCESS_TIMES}:
            return None
        engaged = float(np.sum(episodes["engaged_time"])) or 1.0
        over_2, over_10 = (
            min(float(np.sum(episodes[name])) / engaged, 1.0) for name in EXCESS_TIMES
        )
        return cls(above_2_percent=over_2, above_10_percent=over_10)


class Result(Part):
    """One policy's episodes on one task."""

    task: Task
    policy: PolicySpec
    episodes: dict[str, list[float]]  # values by name in task.fields, one per seed
    versions: dict[str, str]  # versions of packages that played it; they do not identify the result
    checksum: str  # SHA-256 of task, policy and episodes
    excess: ExcessShares | None = None  # a summary beside the episodes, which older results lack

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        optional = (
            {"overload_time"} if self.task.of_family else set()
        )  # older results on a family lack it
        if set(self.episodes) | optional != set(self.task.fields):
            raise ValueError(
                f"episodes holds {', '.join(self.episodes)}, but must hold {', '.join(self.task.fields)}"
            )
        for name, values in self.episodes.items():
            if len(values) != len(self.task.seeds):
                raise ValueError(
                    f"episodes.{name} holds {len(values)} values, but there are {len(self.task.seeds)} seeds"
                )
        if self.checksum != _checksum(self.task, self.policy, self.episodes):
            raise ValueError(
                "checksum does not match task, policy and episodes: the file has been changed since it was written"
            )
        return self

    @classmethod
    def of(cls, task: Task, policy: PolicySpec, episodes: Episodes) -> Self:
        """Return the result of episodes that have just been played: arrays of shape (seeds,) for each of ``task.fields``."""
        values = {name: episodes[name].tolist() for name in task.fields}
        versions = {name: version(name) for name in _RECORDED_VERSIONS}
        return cls(
            task=task,
            policy=policy,
            episodes=values,
            versions=versions,
            checksum=_checksum(task, policy, values),
            excess=ExcessShares.of(episodes),
        )

    def same_as(self, other: "Result") -> bool:
        """Return whether task, policy and every number are the same, whatever else the files say."""
        return self.is_of(other.task, other.policy) and (self.episodes, self.excess) == (
            other.episodes,
            other.excess,
        )

    def is_of(self, task: Task, policy: PolicySpec) -> bool:
        """Return whether this is the result of a policy on a task."""
        return self.task.digest == task.digest and self.policy.identity == policy.identity


def _checksum(task: Task, policy: PolicySpec, episodes: dict[str, list[float]]) -> str:
    return digest_of([task.digest, policy.identity, episodes])


def _without_task(result: Result) -> dict[str, Any]:
    """Return a result's values for a file that states the task once."""
    absent = {"excess"} if result.excess is None else set()
    return result.model_dump(exclude={"task"} | absent)


class ResultFile(Part):
    """A file of results on one task."""

    schema_: Literal["rough-turning/results/5"] = Field(alias="schema", default=SCHEMA)
    task: Task
    results: list[Annotated[Result, PlainSerializer(_without_task)]]

    @model_validator(mode="before")
    @classmethod
    def _tell_task(cls, values: Any) -> Any:
        """Give each result the task, which the file states once."""
        try:
            task = Task.model_validate(values["task"])
            return values | {
                "task": task,
                "results": [each | {"task": task} for each in values["results"]],
            }
        except (TypeError, KeyError, ValidationError):  # what is wrong is found in its place
            return values


class Entry(Part):
    """One policy's result in a manifest: means over episodes."""

    version: int
    return_: float = Field(alias="return")  # mean over episodes [s], as are the next three
    time: float | None = None  # machine time [s]
    removed: float | None = None  # metal [cm3]
    edges: float | None = None  # edges used up
    severe_share: float  # share of cutting time beyond a limit by more than the tolerance
    sha256: str  # the result's checksum

    @classmethod
    def of(cls, result: Result) -> Self:
        """Summarise a result, in six significant digits."""
        mean = {name: float(np.mean(values)) for name, values in result.episodes.items()}
        mean["severe_share"] = mean["severe_overload_time"] / (mean["engaged_time"] or 1.0)
        if "edges_used" in mean:
            mean["edges"] = mean["edges_used"]
        shown = sorted(mean.keys() & {"return", "time", "removed", "edges", "severe_share"})
        rounded = {name: float(f"{mean[name]:.6g}") for name in shown}
        return cls(version=result.policy.version, sha256=result.checksum, **rounded)


class Manifest(Part):
    """The task that is ranked in a folder, and a summary of each policy's result."""

    task: Task
    results: dict[str, Entry]  # entries by the policy's label

    def text(self) -> str:
        """Return the manifest as JSON, a line per policy."""
        entries = {
            label: entry.model_dump_json(by_alias=True, exclude_none=True)
            for label, entry in self.results.items()
        }
        lines = [f"  {json.dumps(label)}: {entry}" for label, entry in sorted(entries.items())]
        task = self.task.model_dump_json(exclude_none=True)
        return f'{{\n "task": {task},\n "results": {{\n' + ",\n".join(lines) + "\n }\n}\n"


def result_folder(results: Path, env_id: str, scenario_name: str) -> Path:
    """Return the folder of the results of one environment's id on one scenario."""
    return results / env_id / scenario_name


def result_path(folder: Path, policy: PolicySpec) -> Path:
    """Return the path of a policy's own file in its ``result_folder``."""
    return folder / f"{policy.label.replace(' ', '_')}{SUFFIX}"


def read_file(path: Path) -> list[Result]:
    """Read a file of results; ResultError unless folders, and a policy's own file, have the names of its content."""
    file = read_part(ResultFile, path)
    folder = result_folder(Path(), file.task.env_id, file.task.scenario.name)
    for each in file.results:
        place = folder / PACK_FILE if path.name == PACK_FILE else result_path(folder, each.policy)
        if path.parts[-3:] != place.parts:
            raise ResultError(
                f"{path} holds the result of {each.policy.label} and should be at {place} in the folder of results"
            )
    return file.results


def result_files(folder: Path) -> list[Path]:
    """Return the files of one ``result_folder`` that should hold results: that of many policies first."""
    # A killed process leaves hidden files.
    found = (path for path in folder.glob(f"[!.]*{SUFFIX}") if path.name != TRAJECTORIES_FILE)
    return sorted(found, key=lambda path: (path.name != PACK_FILE, path.name))


def read_results(folder: Path, complain: Callable[[str], None] | None = None) -> dict[str, Result]:
    """Return the results of one ``result_folder`` by the policies' labels; files that cannot be used are left out.

    ``complain`` receives their faults; None: they go to standard error.
    """
    results: dict[str, Result] = {}
    for path in result_files(folder):
        try:
            results |= {each.policy.label: each for each in read_file(path)}
        except ResultError as error:
            again = f"skipped: {error}: delete it, or play it again by python -m leaderboard run"
            complain(str(error)) if complain else tell_once(again)
    return dict(sorted(results.items()))


def write_result(result: Result, folder: Path) -> None:
    """Write a result into its folder, unless the folder already says the same: no number changes, no file changes."""
    present = read_results(folder).get(result.policy.label)
    if present is None or not present.same_as(result):
        write_part(
            ResultFile(task=result.task, results=[result]), result_path(folder, result.policy)
        )


@cache
def tell_once(text: str) -> None:
    """Print a text on standard error, the first time that a process has it to say. It may quote a file."""
    print(printable(text), file=sys.stderr)


def write_manifest(folder: Path, task: Task) -> None:
    """Write the manifest of a folder: the task that is ranked there and its results."""
    results = [
        result for result in read_results(folder).values() if result.task.digest == task.digest
    ]
    manifest = Manifest(
        task=task, results={result.policy.label: Entry.of(result) for result in results}
    )
    path = folder / MANIFEST_FILE
    if not path.is_file() or path.read_text("utf-8") != manifest.text():
        write_whole(path, manifest.text())


def start_results(folder: Path, task: Task) -> None:
    """Copy the results that come with the project into a folder that has no manifest yet, if they are on this task."""
    source = result_folder(RESULTS, task.env_id, task.scenario.name)
    manifest = source / MANIFEST_FILE
    if (
        (folder / MANIFEST_FILE).exists()
        or not manifest.is_file()
        or read_part(Manifest, manifest).task.digest != task.digest
    ):
        return
    for path in [
        *(each for each in source.glob("[!.]*.xz") if not (folder / each.name).exists()),
        manifest,
    ]:
        write_whole(folder / path.name, path.read_bytes())


PartType = TypeVar("PartType", bound=Part)


def read_part(kind: type[PartType], path: Path) -> PartType:
    """Read a file written by ``write_part``, floats bit for bit; ResultError if something in it is not allowed."""
    try:
        with path.open("rb") as file:
            part: PartType = _parsed(kind, file.read(MAX_BYTES + 1), path.name.endswith(".xz"))
        return part
    except ValidationError as error:
        raise ResultError(f"{path}: {_complaint(error)}") from error
    except (OSError, ValueError, RecursionError, lzma.LZMAError, EOFError) as error:
        raise ResultError(f"{path} cannot be read: {error}") from error


@lru_cache(256)
def _parsed(kind: type[PartType], content: bytes, compressed: bool) -> PartType:
    """Parse a file's content once, as a run reads it several times."""
    if compressed:
        with lzma.open(BytesIO(content), format=lzma.FORMAT_XZ) as stream:
            content = stream.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        raise ValueError(f"it holds more than {MAX_BYTES} bytes")
    return kind.model_validate(json.loads(content))


def write_part(part: Part, path: Path) -> None:
    """Write a file whole or not at all, compressed if its name ends in .xz; make its folder."""
    content = (json.dumps(part.model_dump(by_alias=True), allow_nan=False) + "\n").encode()
    write_whole(
        path,
        lzma.compress(content, preset=9 | lzma.PRESET_EXTREME)
        if path.name.endswith(".xz")
        else content,
    )


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, all of it or nothing; its folder is made."""
    encoded = content.encode() if isinstance(content, str) else content
    replace_file(path, lambda partial: partial.write_bytes(encoded))


def _complaint(error: ValidationError) -> str:
    """Return the field, the value and the allowed values of the first error."""
    detail: Any = error.errors()[0]
    field, message = (
        ".".join(str(part) for part in detail["loc"]),
        detail["msg"].removeprefix("Value error, "),
    )
    if field and detail["type"] != "missing":
        value = repr(detail["input"])
        message = f"{value if len(value) <= 60 else value[:60] + '...'} is not allowed: {message}"
    return f"{field}: {message}" if field else message
