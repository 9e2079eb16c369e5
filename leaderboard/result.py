"""Result files: the episodes of one policy on one task. Everything shown is computed from them.

A result is identified by its meaning: the environment's id, the model's version, the values in which the scenario differs from
the defaults, the seeds, and the policy (``PolicySpec.identity``). Neither source files nor package versions decide whether it is
valid.

Results are JSON compressed with xz (``xzcat`` prints it); floats come back bit for bit. ``manifest.json`` beside them is for
reviewers: the task, and for every policy the main numbers and the SHA-256 of its result.
"""

import json
import lzma
import sys
from contextlib import suppress
from functools import cache, lru_cache
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, ValidationError, model_validator

from turning_env import MODEL_VERSION
from turning_env.files import digest_of, replace_file
from turning_env.scenario import PortableScenario
from turning_env.scoring.play import EPISODE_FIELDS, Episodes
from turning_env.scoring.policy import PolicySpec

SCHEMA: Literal["rough-turning/result/4"] = "rough-turning/result/4"
TRAJECTORIES_FILE = "trajectories.json.xz"
MANIFEST_FILE = "manifest.json"
SUFFIX = ".json.xz"
MAX_BYTES = 200_000_000
"""Largest size of a file, uncompressed."""
_RECORDED_VERSIONS = ("rough-turning", "numpy", "numba", "onnxruntime")


class ResultError(ValueError):
    """Results that cannot be used. The message names the file, and where there is one the field and its value."""


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


class Task(Part):
    """The episodes that every policy of one leaderboard plays."""

    env_id: str
    model_version: int = MODEL_VERSION
    scenario: PortableScenario
    seeds: Seeds
    """One episode is played per seed. Private seeds are given by their places in their file."""
    private: str | None = None
    """SHA-256 of private seeds: see ``private_seeds.py``."""

    @model_validator(mode="after")
    def _names_places(self) -> Self:
        if self.private is not None and self.seeds != list(range(len(self.seeds))):
            raise ValueError("seeds that are private must be named by their places, 0 and up")
        return self

    @property
    def digest(self) -> str:
        """Return the SHA-256 of what identifies the task. Results on different tasks are never ranked together."""
        return digest_of([self.env_id, self.model_version, self.scenario.digest(), self.private or self.seeds])


class Result(Part):
    """One policy's episodes on one task."""

    FIELDS: ClassVar[tuple[str, ...]] = EPISODE_FIELDS
    schema_: Literal["rough-turning/result/4"] = Field(alias="schema", default=SCHEMA)
    task: Task
    policy: PolicySpec
    episodes: dict[str, list[float]]
    """For each of ``FIELDS``, one value per seed."""
    versions: dict[str, str]
    """Versions of packages that played it; they do not identify the result."""
    checksum: str
    """SHA-256 of task, policy and episodes."""

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if set(self.episodes) != set(self.FIELDS):
            raise ValueError(f"episodes holds {', '.join(self.episodes)}, but must hold {', '.join(self.FIELDS)}")
        for name, values in self.episodes.items():
            if len(values) != len(self.task.seeds):
                raise ValueError(f"episodes.{name} holds {len(values)} values, but there are {len(self.task.seeds)} seeds")
        if self.checksum != _checksum(self.task, self.policy, self.episodes):
            raise ValueError("checksum does not match task, policy and episodes: the file has been changed since it was written")
        return self

    @classmethod
    def of(cls, task: Task, policy: PolicySpec, episodes: Episodes) -> Self:
        """Return the result of episodes that have just been played: arrays of shape (seeds,) for each of ``FIELDS``."""
        values = {name: array.tolist() for name, array in episodes.items()}
        versions = {name: version(name) for name in _RECORDED_VERSIONS}
        return cls(task=task, policy=policy, episodes=values, versions=versions, checksum=_checksum(task, policy, values))

    def same_as(self, other: "Result") -> bool:
        """Return whether task, policy and every number are the same, whatever else the files say."""
        return self.is_of(other.task, other.policy) and self.episodes == other.episodes

    def is_of(self, task: Task, policy: PolicySpec) -> bool:
        """Return whether this is the result of a policy on a task."""
        return self.task.digest == task.digest and self.policy.identity == policy.identity


def _checksum(task: Task, policy: PolicySpec, episodes: dict[str, list[float]]) -> str:
    return digest_of([task.digest, policy.identity, episodes])


class Entry(Part):
    """One policy's result in a manifest: means over episodes."""

    version: int
    return_: float = Field(alias="return")
    """Mean over episodes [s], as are the next three."""
    time: float
    """Machine time [s]."""
    removed: float
    """Metal [cm3]."""
    edges: float
    """Edges used up."""
    severe_share: float
    """Share of cutting time beyond a limit by more than the tolerance."""
    sha256: str
    """The result's checksum."""

    @classmethod
    def of(cls, result: Result) -> Self:
        """Summarise a result, in six significant digits."""
        mean = {name: float(np.mean(values)) for name, values in result.episodes.items()}
        mean |= {"edges": mean["edges_used"], "severe_share": mean["severe_overload_time"] / (mean["engaged_time"] or 1.0)}
        rounded = {name: float(f"{mean[name]:.6g}") for name in ("return", "time", "removed", "edges", "severe_share")}
        return cls(version=result.policy.version, sha256=result.checksum, **rounded)


class Manifest(Part):
    """The task that is ranked in a folder, and a summary of each policy's result."""

    task: Task
    results: dict[str, Entry]
    """By the policy's label."""

    def text(self) -> str:
        """Return the manifest as JSON, a line per policy."""
        lines = [
            f"  {json.dumps(label)}: {entry.model_dump_json(by_alias=True)}" for label, entry in sorted(self.results.items())
        ]
        return f'{{\n "task": {self.task.model_dump_json()},\n "results": {{\n' + ",\n".join(lines) + "\n }\n}\n"


def result_folder(results: Path, env_id: str, scenario_name: str) -> Path:
    """Return the folder of the results of one environment's id on one scenario."""
    return results / env_id / scenario_name


def result_path(folder: Path, policy: PolicySpec) -> Path:
    """Return the path of a policy's result in its ``result_folder``; "mine, forgetful" is in ``mine-forgetful``."""
    return folder / f"{policy.label.replace(', ', '-').replace(' ', '_')}{SUFFIX}"


ResultType = TypeVar("ResultType", bound=Result)


def read_result(path: Path, kind: type[ResultType] = Result) -> ResultType:  # type: ignore[assignment]
    """Read the result of a policy; folders and file are named by the environment's id, the scenario and the policy.

    Raises:
        ResultError: the file is no result, or not one of this environment, scenario and policy.
    """
    result = read_part(kind, path)
    place = result_path(result_folder(Path(), result.task.env_id, result.task.scenario.name), result.policy)
    if path.parts[-3:] != place.parts:
        raise ResultError(f"{path} holds the result of {result.policy.label} and should be at {place} in the folder of results")
    return result


def write_result(result: Result, folder: Path) -> None:
    """Write a result into its folder, unless the file there already says the same: no number changes, no file changes."""
    path = result_path(folder, result.policy)
    with suppress(ResultError):
        if read_result(path, type(result)).same_as(result):
            return
    write_part(result, path)


def result_files(folder: Path) -> list[Path]:
    """Return the files of one ``result_folder`` that should be results."""
    # A killed process leaves hidden files.
    return sorted(path for path in folder.glob(f"[!.]*{SUFFIX}") if path.name != TRAJECTORIES_FILE)


def read_results(folder: Path) -> dict[Path, Result]:
    """Return the results of one ``result_folder``. A file that cannot be used is named on standard error and left out."""
    results: dict[Path, Result] = {}
    for path in result_files(folder):
        try:
            results[path] = read_result(path)
        except ResultError as error:
            tell_once(f"skipped: {error}: delete it, or play it again by python -m leaderboard run")
    return results


@cache
def tell_once(text: str) -> None:
    """Print a text on standard error, the first time that a process has it to say."""
    print(text, file=sys.stderr)


def write_manifest(folder: Path, task: Task) -> None:
    """Write the manifest of a folder: the task that is ranked there and its results."""
    results = [result for result in read_results(folder).values() if result.task.digest == task.digest]
    manifest = Manifest(task=task, results={result.policy.label: Entry.of(result) for result in results})
    path = folder / MANIFEST_FILE
    if not path.is_file() or path.read_text("utf-8") != manifest.text():
        write_whole(path, manifest.text())


PartType = TypeVar("PartType", bound=Part)


def read_part(kind: type[PartType], path: Path) -> PartType:
    """Read a file written by ``write_part``; floats come back bit for bit.

    Raises:
        ResultError: the file cannot be read, or something in it is not allowed.
    """
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
    """Write a file, all of it or nothing, compressed where its name ends in .xz; its folder is made."""
    content = (json.dumps(part.model_dump(by_alias=True), allow_nan=False) + "\n").encode()
    write_whole(path, lzma.compress(content, preset=9 | lzma.PRESET_EXTREME) if path.name.endswith(".xz") else content)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file, all of it or nothing; its folder is made."""
    encoded = content.encode() if isinstance(content, str) else content
    replace_file(path, lambda partial: partial.write_bytes(encoded))


def _complaint(error: ValidationError) -> str:
    """Return the field, the value and what is allowed, of the first error."""
    detail: Any = error.errors()[0]
    field, message = ".".join(str(part) for part in detail["loc"]), detail["msg"].removeprefix("Value error, ")
    if field and detail["type"] != "missing":
        value = repr(detail["input"])
        message = f"{value if len(value) <= 60 else value[:60] + '...'} is not allowed: {message}"
    return f"{field}: {message}" if field else message
