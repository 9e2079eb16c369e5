"""Results: the episodes of policies on one task, and their files.

All that is shown follows from them.

A result is identified by its meaning: the environment's id, the model's version, the values in
which the scenario differs from the defaults, the seeds, and the policy (``PolicySpec.identity``).
Neither source files nor package versions decide whether it is valid.

The folder ``ID/SCENARIO`` of a folder of results holds them:

* ``LABEL.json.xz``, the result of one policy, written by ``python -m leaderboard run`` as soon as
  the policy has played;
* ``results.json.xz``, those of many policies, into which ``python -m leaderboard pack`` moves the
  former. A policy's own file counts in place of what it says;
* ``manifest.json`` for reviewers: the task, and for every policy the main numbers and the SHA-256
  of its result;
* ``trajectories.json.xz``: see ``trajectories.py``.

Both kinds of result files have one form: JSON compressed with xz (``xzcat`` prints it), whose
floats come back bit for bit.
"""

import json
import lzma
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, Self, TypeVar

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
from pydantic_core import from_json

from baselines.policy_spec import Digest, PolicySpec, ScenarioId
from leaderboard.notices import notify_once
from leaderboard.play import EPISODE_FIELDS, EXCESS_TIMES, Episodes
from turning_env import MODEL_VERSION
from turning_env.files import digest_of, read_regular, write_file
from turning_env.scenario import PortableScenario
from turning_env.scenario.family import Family

SCHEMA: Literal["rough-turning/results/5"] = "rough-turning/results/5"
PACK_FILE = "results.json.xz"
TRAJECTORIES_FILE = "trajectories.json.xz"
MANIFEST_FILE = "manifest.json"
SUFFIX = ".json.xz"
RESULTS = Path(__file__).parent / "results"  # the results that come with the project
MAX_BYTES = 100_000_000
"""Largest size of a file, uncompressed, and of all files of results in a folder together.

The results that ship have up to 7 MB in a folder.
"""
MAX_RESULTS = 500
"""Largest number of results in a file, and in a folder up to those of one more file.

A file that is refused counts as a result.

Ranking compares every two. The folders that ship have up to 88.
"""
MIN_DICTIONARY = 4096  # smallest that xz allows [bytes]
MAX_DICTIONARY = 64 << 20  # that of xz's preset 9 [bytes]
MAX_XZ_MEMORY = 2 * MAX_DICTIONARY  # memory with which a file is decompressed [bytes]
CHUNK = 1_000_000  # bytes that are decompressed at once
MAX_SEEDS = 10_000_000  # largest number of seeds in a range
SCENARIO_FIELDS = tuple(name for name in EPISODE_FIELDS if name not in EXCESS_TIMES)
"""The fields of an episode that results keep.

Of ``EXCESS_TIMES`` they keep sums alone: see ``ExcessShares``.
"""
FAMILY_FIELDS = (
    "return",
    "reward_metal",
    "steps",
    "engaged_time",
    "overload_time",
    "severe_overload_time",
)
"""The fields of an episode that results on a family keep.

Volumes and edges of different jobs do not add up.
"""
SIGNIFICANT_DIGITS = 6  # of the numbers in a manifest
_FOLDER_NAME = "^[A-Za-z0-9_-][A-Za-z0-9_.-]{0,127}$"
_RECORDED_VERSIONS = ("rough-turning", "numpy", "numba", "onnxruntime")
MAX_VERSIONS = 20  # packages
_Word = Annotated[str, Field(max_length=100)]
_MAX_QUOTED = 60  # characters of a value that is quoted in a complaint


class ResultError(ValueError):
    """Results that cannot be used. The message names the file, and the field and its value."""


class Part(BaseModel):
    """A part of a file: frozen; unknown keys, wrong types, NaN and infinity are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


def _seeds_from_text(value: Any) -> Any:
    """Return the seeds of a text ``first..last``; ValueError if a text is no such range."""
    if not isinstance(value, str):
        return value
    first, _, last = value.partition("..")
    is_range = first.isdecimal() and last.isdecimal()
    if not is_range or not 0 <= int(last) - int(first) < MAX_SEEDS:
        raise ValueError(f"{value!r} is not a range of seeds like 0..255")
    return list(range(int(first), int(last) + 1))


def _seeds_as_text(seeds: list[int]) -> str | list[int]:
    """Return consecutive seeds as a text ``first..last``, and others as they are."""
    if seeds and seeds == list(range(seeds[0], seeds[0] + len(seeds))):
        return f"{seeds[0]}..{seeds[-1]}"
    return seeds


Seeds = Annotated[list[int], BeforeValidator(_seeds_from_text), PlainSerializer(_seeds_as_text)]
"""Seeds; in a file, ``first..last`` if they are consecutive."""


class FamilySplit(Part):
    """The split of a family whose jobs are played."""

    family: ScenarioId  # name, and SHA-256 of the values
    split: str = Field(pattern=_FOLDER_NAME)
    # The family itself, unless the task was read from a file.
    loaded: Family | None = Field(default=None, exclude=True, repr=False)


class Task(Part):
    """The episodes that every policy of one leaderboard plays."""

    env_id: str = Field(pattern=_FOLDER_NAME)  # also names a folder
    model_version: int = MODEL_VERSION
    # For a family: the values that all jobs share, under the name of family and split.
    scenario: PortableScenario
    # One per episode; for a family, job numbers. Private seeds are named by their places.
    seeds: Seeds
    # SHA-256 of private seeds, which a key determines. None: they are public.
    private: Digest | None = None
    of_family: FamilySplit | None = None

    @model_validator(mode="after")
    def _check_seeds(self) -> Self:
        if not self.seeds:
            raise ValueError("seeds must hold a seed or more")
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
        """Return the SHA-256 of the task's identity.

        Results on different tasks are never ranked together.
        """
        return _digest_of(self)

    def __hash__(self) -> int:
        """Return a number that equal tasks share, by few fields: a cache needs no more."""
        return hash((self.env_id, self.scenario.name, len(self.seeds)))


# All results in a file share their task, and each has its digest in its checksum.
@lru_cache(64)
def _digest_of(task: Task) -> str:
    """Return the digest of a task."""
    seeds = task.private or task.seeds
    digest = digest_of([task.env_id, task.model_version, task.scenario.digest(), seeds])
    if task.of_family is None:
        return digest
    return digest_of([digest, task.of_family.family.digest, task.of_family.split])


class ExcessShares(Part):
    """Shares of a policy's cutting time over a limit by more than 2 % and more than 10 % [-]."""

    above_2_percent: float = Field(ge=0.0, le=1.0)
    above_10_percent: float = Field(ge=0.0, le=1.0)

    @classmethod
    def of(cls, episodes: Episodes) -> Self | None:
        """Return the shares of episodes that have just been played, 0 without cutting.

        Return None if the episodes lack the times over a limit.
        """
        if not episodes.keys() >= {*EXCESS_TIMES}:
            return None
        # Without cutting both times are 0, and so are the shares.
        engaged_time = float(np.sum(episodes["engaged_time"])) or 1.0
        shares = [float(np.sum(episodes[name])) / engaged_time for name in EXCESS_TIMES]
        # The sums are rounded, so a share of all time may come out just above 1.
        above_2_percent, above_10_percent = (min(share, 1.0) for share in shares)
        return cls(above_2_percent=above_2_percent, above_10_percent=above_10_percent)


class Result(Part):
    """One policy's episodes on one task."""

    task: Task
    policy: PolicySpec
    episodes: dict[str, list[float]]  # values by name in task.fields, one per seed
    # Packages that played it; they do not identify the result.
    versions: Annotated[dict[_Word, _Word], Field(max_length=MAX_VERSIONS)]
    checksum: Digest  # SHA-256 of task, policy and episodes
    excess: ExcessShares | None = None  # a summary beside the episodes; older results lack it

    @model_validator(mode="after")
    def _check_episodes(self) -> Self:
        required = set(self.task.fields)
        # Older results on a family lack the time over a limit.
        optional = {"overload_time"} if self.task.of_family else set()
        if set(self.episodes) | optional != required:
            raise ValueError(
                f"episodes holds {', '.join(self.episodes)}, "
                f"but must hold {', '.join(self.task.fields)}"
            )
        num_seeds = len(self.task.seeds)
        for name, values in self.episodes.items():
            if len(values) != num_seeds:
                raise ValueError(
                    f"episodes.{name} holds {len(values)} values, but there are {num_seeds} seeds"
                )
        if self.checksum != _checksum(self.task, self.policy, self.episodes):
            raise ValueError(
                "checksum does not match task, policy and episodes: "
                "the file has been changed since it was written"
            )
        return self

    @classmethod
    def of(cls, task: Task, policy: PolicySpec, episodes: Episodes) -> Self:
        """Return the result of episodes that have just been played.

        ``episodes``: arrays of shape (seeds,) for each of ``task.fields``.
        """
        values = {name: episodes[name].tolist() for name in task.fields}
        return cls(
            task=task,
            policy=policy,
            episodes=values,
            versions={name: version(name) for name in _RECORDED_VERSIONS},
            checksum=_checksum(task, policy, values),
            excess=ExcessShares.of(episodes),
        )

    def same_as(self, other: "Result") -> bool:
        """Return whether task, policy and every number are the same."""
        return (
            self.is_of(other.task, other.policy)
            and self.episodes == other.episodes
            and self.excess == other.excess
        )

    def is_of(self, task: Task, policy: PolicySpec) -> bool:
        """Return whether this is the result of a policy on a task."""
        return self.task.digest == task.digest and self.policy.identity == policy.identity


def _checksum(task: Task, policy: PolicySpec, episodes: dict[str, list[float]]) -> str:
    return digest_of([task.digest, policy.identity, episodes])


def _without_task(result: Result) -> dict[str, Any]:
    """Return a result's values for a file that states the task once."""
    left_out = {"task"}
    if result.excess is None:
        left_out.add("excess")
    return result.model_dump(exclude=left_out)


class ResultFile(Part):
    """A file of results on one task."""

    schema_: Literal["rough-turning/results/5"] = Field(alias="schema", default=SCHEMA)
    task: Task
    results: Annotated[
        list[Annotated[Result, PlainSerializer(_without_task)]], Field(max_length=MAX_RESULTS)
    ]

    @model_validator(mode="before")
    @classmethod
    def _give_task(cls, values: Any) -> Any:
        """Give each result the task, which the file states once."""
        try:
            task = Task.model_validate(values["task"])
            results = [result | {"task": task} for result in values["results"]]
            return values | {"task": task, "results": results}
        except (TypeError, KeyError, ValidationError):
            # The validation of the fields, which follows, names the fault and its place.
            return values

    @model_validator(mode="after")
    def _check_policies(self) -> Self:
        labels = Counter(result.policy.label for result in self.results)
        repeated = [label for label, count in labels.items() if count > 1]
        if repeated:
            raise ValueError(f"results holds more than one result of {', '.join(repeated)}")
        return self


class ManifestEntry(Part):
    """One policy's result in a manifest: means over episodes."""

    version: int
    return_: float = Field(alias="return")  # [s]
    time: float | None = None  # machine time [s]
    removed: float | None = None  # metal [cm3]
    edges: float | None = None  # edges used up
    severe_share: float  # share of cutting time beyond a limit by more than the tolerance
    sha256: Digest  # the result's checksum

    @classmethod
    def of(cls, result: Result) -> Self:
        """Summarise a result, in six significant digits."""
        means = {name: float(np.mean(values)) for name, values in result.episodes.items()}
        summary = {"return": means["return"]}
        # Results on a family lack these three.
        for name, field in (("time", "time"), ("removed", "removed"), ("edges", "edges_used")):
            if field in means:
                summary[name] = means[field]
        engaged_time = means["engaged_time"] or 1.0
        summary["severe_share"] = means["severe_overload_time"] / engaged_time
        rounded = {
            name: float(f"{value:.{SIGNIFICANT_DIGITS}g}") for name, value in summary.items()
        }
        return cls(version=result.policy.version, sha256=result.checksum, **rounded)


class Manifest(Part):
    """The task that is ranked in a folder, and a summary of each policy's result."""

    task: Task
    results: dict[str, ManifestEntry]  # entries by the policy's label

    def text(self) -> str:
        """Return the manifest as JSON, a line per policy."""
        lines = []
        for label, entry in sorted(self.results.items()):
            summary = entry.model_dump_json(by_alias=True, exclude_none=True)
            lines.append(f"  {json.dumps(label)}: {summary}")
        task = self.task.model_dump_json(exclude_none=True)
        return f'{{\n "task": {task},\n "results": {{\n' + ",\n".join(lines) + "\n }\n}\n"


def result_folder(results: Path, env_id: str, scenario_name: str) -> Path:
    """Return the folder of the results of one environment's id on one scenario."""
    return results / env_id / scenario_name


def result_path(folder: Path, policy: PolicySpec) -> Path:
    """Return the path of a policy's own file in its ``result_folder``."""
    return folder / f"{policy.label.replace(' ', '_')}{SUFFIX}"


def read_file(path: Path) -> list[Result]:
    """Return the results in a file: those of a task, or that of one policy.

    Raises:
        ResultError: the file cannot be read, or its path is not that of its content: folders are
            named after id and scenario, the file of one policy after the policy.
    """
    return _results_of(path, read_part(ResultFile, path))


def _results_of(path: Path, file: ResultFile) -> list[Result]:
    """Return the results of a file; ResultError if its path is not that of its content."""
    folder = result_folder(Path(), file.task.env_id, file.task.scenario.name)
    for result in file.results:
        expected = result_path(folder, result.policy)
        if path.name == PACK_FILE:
            expected = folder / PACK_FILE
        if path.parts[-3:] != expected.parts:
            raise ResultError(
                f"{path} holds the result of {result.policy.label} and should be at {expected} "
                "in the folder of results"
            )
    return file.results


def result_files(folder: Path) -> list[Path]:
    """Return the files of one ``result_folder`` that should hold results.

    The file of many policies comes first.
    """
    # A killed process leaves hidden files.
    paths = [path for path in folder.glob(f"[!.]*{SUFFIX}") if path.name != TRAJECTORIES_FILE]
    return sorted(paths, key=lambda path: (path.name != PACK_FILE, path.name))


def read_results(folder: Path, complain: Callable[[str], None] | None = None) -> dict[str, Result]:
    """Return the results of one ``result_folder`` by the policies' labels.

    Files that cannot be used are left out, and those after the first ``MAX_BYTES`` or
    ``MAX_RESULTS``. ``complain`` receives their faults; if it is None, they go to stderr.
    """
    results: dict[str, Result] = {}
    total_size = 0  # of files that are refused, too, as reading them takes as long
    num_refused = 0
    for path in result_files(folder):
        try:
            if total_size > MAX_BYTES or len(results) + num_refused > MAX_RESULTS:
                raise ResultError(
                    f"{path} is not read, as the files before it in its folder hold more than "
                    f"{MAX_BYTES} bytes or {MAX_RESULTS} results"
                )
            content = _read(ResultFile, path)
            total_size += content.size
            results_in_file = _results_of(path, content.checked())
        except ResultError as error:
            num_refused += 1
            if complain is not None:
                complain(str(error))
            else:
                advice = "delete it, or play it again by python -m leaderboard run"
                notify_once(f"skipped: {error}: {advice}")
            continue
        for result in results_in_file:
            results[result.policy.label] = result
    return dict(sorted(results.items()))


def write_result(result: Result, folder: Path) -> None:
    """Write a result into its folder, unless the folder already holds the same numbers."""
    present = read_results(folder).get(result.policy.label)
    if present is not None and present.same_as(result):
        return
    file = ResultFile(task=result.task, results=[result])
    write_part(file, result_path(folder, result.policy))


def write_manifest(folder: Path, task: Task) -> None:
    """Write the manifest of a folder: the task that is ranked there and its results."""
    entries = {
        label: ManifestEntry.of(result)
        for label, result in read_results(folder).items()
        if result.task.digest == task.digest
    }
    text = Manifest(task=task, results=entries).text()
    path = folder / MANIFEST_FILE
    if not path.is_file() or path.read_bytes() != text.encode():
        write_file(path, text)


def start_results(folder: Path, task: Task) -> None:
    """Copy the results that come with the project into a folder, if they are on this task.

    A folder that already has a manifest stays as it is.
    """
    source = result_folder(RESULTS, task.env_id, task.scenario.name)
    manifest = source / MANIFEST_FILE
    if (folder / MANIFEST_FILE).exists() or not manifest.is_file():
        return
    if read_part(Manifest, manifest).task.digest != task.digest:
        return
    for path in source.glob("[!.]*.xz"):
        if not (folder / path.name).exists():
            write_file(folder / path.name, path.read_bytes())
    # The manifest comes last: a folder that has one is complete.
    write_file(folder / MANIFEST_FILE, manifest.read_bytes())


def shipped_seeds(env_id: str, scenario_name: str) -> int | None:
    """Return the number of seeds of the results that come with the project; None if none do."""
    manifest = result_folder(RESULTS, env_id, scenario_name) / MANIFEST_FILE
    return len(read_part(Manifest, manifest).task.seeds) if manifest.is_file() else None


PartType = TypeVar("PartType", bound=Part)


@dataclass(frozen=True)
class _Content(Generic[PartType]):
    """The content of a file, which may be refused."""

    path: Path
    part: PartType | None
    fault: str  # why the content is refused
    size: int  # bytes that were read until the fault, uncompressed

    def checked(self) -> PartType:
        """Return the part. Raise ResultError if the content is refused."""
        if self.part is None:
            raise ResultError(f"{self.path}{self.fault}")
        return self.part


def read_part(kind: type[PartType], path: Path) -> PartType:
    """Read a file written by ``write_part``, floats bit for bit.

    Raise ResultError if the file cannot be read, or if something in it is not allowed.
    """
    return _read(kind, path).checked()


def _read(kind: type[PartType], path: Path) -> _Content[PartType]:
    """Read a file, see ``read_part``. Raise ResultError if it cannot be read."""
    try:
        content = read_regular(path, MAX_BYTES)
    except OSError as error:
        raise ResultError(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:  # a null character in the path
        raise ResultError(f"{path} cannot be read: {error}") from error
    part: PartType | None
    part, fault, size = _parsed(kind, content, compressed=path.name.endswith(".xz"))
    return _Content(path, part, fault=fault, size=size)


# A run reads its folder again after each policy. The content is the key, so nothing is outdated;
# parsing takes up to a second per folder, and reading the content a millisecond.
@lru_cache(256)
def _parsed(
    kind: type[PartType], content: bytes, compressed: bool
) -> tuple[PartType | None, str, int]:
    """Return the part of a content, its fault or "", and its size [bytes], uncompressed."""
    plain = bytearray()
    try:
        if compressed:
            _decompress(content, plain)
        else:
            plain += content
        return kind.model_validate(from_json(plain)), "", len(plain)
    except ValidationError as error:
        fault = f": {_complaint(error)}"
    except (ValueError, RecursionError, lzma.LZMAError, EOFError) as error:
        fault = f" cannot be read: {error}"
    return None, fault, len(plain)


def _decompress(content: bytes, plain: bytearray) -> None:
    """Append the content of an xz file; a small file may hold, or ask for, very much.

    Raise ValueError, LZMAError or EOFError for a file that is damaged or too large, of which a part
    has been appended.
    """
    decompressor = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=MAX_XZ_MEMORY)
    plain += decompressor.decompress(content, max_length=CHUNK)
    while not decompressor.eof:
        if len(plain) > MAX_BYTES:
            raise ValueError(f"it holds more than {MAX_BYTES} bytes")
        if decompressor.needs_input:
            raise EOFError("it ends too early")
        plain += decompressor.decompress(b"", max_length=CHUNK)
    if len(plain) > MAX_BYTES:
        raise ValueError(f"it holds more than {MAX_BYTES} bytes")
    if decompressor.unused_data:
        raise ValueError("bytes follow its end")


def write_part(part: Part, path: Path) -> None:
    """Write a file whole or not at all, compressed if its name ends in .xz; make its folder."""
    text = json.dumps(part.model_dump(by_alias=True), allow_nan=False)
    content = f"{text}\n".encode()
    if len(content) > MAX_BYTES:
        raise ResultError(f"{path} would hold {len(content)} bytes, but may hold {MAX_BYTES}")
    if path.name.endswith(".xz"):
        content = _compressed(content)
    write_file(path, content)


def _compressed(content: bytes) -> bytes:
    """Return content in xz's strongest compression.

    A dictionary as large as the content compresses as well as the preset's one of 64 MiB, whose
    set-up takes most of the time of a small file.
    """
    dictionary = min(max(len(content), MIN_DICTIONARY), MAX_DICTIONARY)
    strongest = {
        "id": lzma.FILTER_LZMA2,
        "preset": 9 | lzma.PRESET_EXTREME,
        "dict_size": dictionary,
    }
    return lzma.compress(content, filters=[strongest])


def _complaint(error: ValidationError) -> str:
    """Return the field, the value and the allowed values of the first error."""
    details: Any = error.errors()[0]
    field = ".".join(str(key) for key in details["loc"])
    message = details["msg"].removeprefix("Value error, ")
    if field and details["type"] != "missing":
        value = repr(details["input"])
        if len(value) > _MAX_QUOTED:
            value = value[:_MAX_QUOTED] + "..."
        message = f"{value} is not allowed: {message}"
    return f"{field}: {message}" if field else message
