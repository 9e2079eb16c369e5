"""Result files: what one policy did on one task, episode by episode. Everything shown is computed from these rows.

They are JSON, compressed with xz (``xzcat`` shows it): floats come back bit for bit, in less than a third of the space.
"""

import hashlib
import json
import lzma
import re
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal, Self, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    JsonValue,
    SerializerFunctionWrapHandler,
    ValidationError,
    field_validator,
    model_serializer,
    model_validator,
)

from baselines.code import code_digest
from turning_env import Scenario
from turning_env.files import replace_file
from turning_env.score.play import EPISODE_FIELDS, Episodes

SCHEMA: Literal["rough-turning/results/3"] = "rough-turning/results/3"
TRAJECTORIES_FILE = "trajectories.json.xz"
SUFFIX = ".json.xz"
MAX_BYTES = 200_000_000
"""Of a file, uncompressed."""
_RECORDED_VERSIONS = ("rough-turning", "numpy", "numba", "onnxruntime")


class ResultError(ValueError):
    """Results that cannot be used. The message names the file, and where there is one the field and its value."""


class Part(BaseModel):
    """A piece of a file: frozen; unknown keys, wrong types, NaN and infinity are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)


class Task(Part):
    """What every policy of one ranking plays."""

    env_id: str
    scenario: Scenario
    draws: list[int]
    """One episode of each of these seeds; or, if they are private, of the seeds at these places of their file."""
    private: str | None = None
    """SHA-256 of private seeds: see ``private_draws.py``."""

    @model_validator(mode="after")
    def _names_places(self) -> Self:
        if self.private is not None and self.draws != list(range(len(self.draws))):
            raise ValueError("draws that are private must be named by their places, 0 and up")
        return self

    @model_serializer(mode="wrap")
    def _as_before_there_were_private_ones(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        values: dict[str, Any] = serialize(self)
        return values if self.private is not None else {name: value for name, value in values.items() if name != "private"}


class Digests(Part):
    """SHA-256 of what decides a result beside the policy; results whose ``task`` differs are never ranked together."""

    scenario: str
    draws: str
    code: str
    """Of the Python sources of ``turning_env`` and ``baselines``: what plays, and the rules."""
    task: str
    """Of the three, and of the version of the environment."""

    @classmethod
    def of(cls, task: Task, environment_version: str, code: str) -> Self:
        """The digests of a task as played by one version of ``rough-turning`` with the sources of digest ``code``."""
        scenario, draws = task.scenario.digest(), task.private or digest_of(task.draws)
        whole = digest_of([environment_version, scenario, draws, code])
        return cls(scenario=scenario, draws=draws, code=code, task=whole)


class MadeFor(Part):
    """The scenario that a policy was tuned or trained on."""

    scenario: str
    """Its name."""
    digest: str

    @field_validator("scenario")
    @classmethod
    def _names_no_path(cls, scenario: str) -> str:
        if not re.fullmatch(r"(?!\.)[A-Za-z0-9_.-]{1,64}", scenario):
            raise ValueError(f"{scenario!r} cannot be a scenario's name")
        return scenario

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """Of a scenario."""
        return cls(scenario=scenario.name, digest=scenario.digest())


class PolicyRecord(Part):
    """Who played."""

    name: str
    kind: Literal["rule", "agent", "reference"]
    """A reference is no policy: it is computed from what no policy is told."""
    description: str
    parameters: dict[str, JsonValue]
    digest: str
    """SHA-256 of what it acts by: a rule's parameters, an agent's ONNX file, or all that its training's folder holds."""
    training_seed: int | None
    """Of an agent. Agents of one name and several training seeds are one policy on the board."""
    command: str | None
    """What trained an agent."""
    made_for: MadeFor | None = None
    """None: the scenario that is played."""

    @field_validator("name")
    @classmethod
    def _names_a_file(cls, name: str) -> str:
        if not re.fullmatch(r"(?!\.)[^/\\\0-\x1f\x7f-\x9f]+", name) or f"{name}{SUFFIX}" == TRAJECTORIES_FILE:
            raise ValueError(f"{name!r} cannot be a policy's name, as its results are kept in a file of that name")
        return name

    @model_validator(mode="after")
    def _agents_have_seeds(self) -> Self:
        if (self.kind == "agent") != (self.training_seed is not None):
            raise ValueError(f"training_seed is {self.training_seed}, but an agent has one and others have none")
        return self

    @property
    def label(self) -> str:
        """Its name, and of an agent also the training seed."""
        return self.name if self.training_seed is None else f"{self.name}-seed{self.training_seed}"


class Result(Part):
    """What one policy did on one task."""

    schema_: Literal["rough-turning/results/3"] = Field(alias="schema")
    task: Task
    digests: Digests
    policy: PolicyRecord
    versions: dict[str, str]
    episodes: dict[str, list[float]]
    """Of each of ``EPISODE_FIELDS``, the value on each draw."""

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if set(self.episodes) != set(EPISODE_FIELDS):
            raise ValueError(f"episodes holds {', '.join(self.episodes)}, but must hold {', '.join(EPISODE_FIELDS)}")
        for name, values in self.episodes.items():
            if len(values) != len(self.task.draws):
                raise ValueError(f"episodes.{name} holds {len(values)} values, but there are {len(self.task.draws)} draws")
        if self.digests != Digests.of(self.task, self.versions.get("rough-turning", ""), self.digests.code):
            raise ValueError(
                "digests do not match scenario, draws, version and code: the file has been changed since it was written"
            )
        return self

    @classmethod
    def of(cls, task: Task, policy: PolicyRecord, episodes: Episodes) -> Self:
        """The result of episodes that have just been played: arrays of shape (draws,) for each of ``EPISODE_FIELDS``."""
        return cls(
            schema=SCHEMA,
            task=task,
            digests=current_digests(task),
            policy=policy,
            versions=present_versions(),
            episodes={name: values.tolist() for name, values in episodes.items()},
        )


def current_digests(task: Task) -> Digests:
    """The digests of a task as this process plays it."""
    return Digests.of(task, version("rough-turning"), code_digest())


def present_versions() -> dict[str, str]:
    """Versions of what plays."""
    return {name: version(name) for name in _RECORDED_VERSIONS}


def digest_of(value: Any) -> str:
    """SHA-256 of a value that JSON can hold."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def result_folder(results: Path, env_id: str, scenario_name: str) -> Path:
    """Where the results of one environment's id on one scenario lie."""
    return results / env_id / scenario_name


def result_path(folder: Path, policy: PolicyRecord) -> Path:
    """Where a policy's result lies in its ``result_folder``."""
    return folder / f"{policy.label}{SUFFIX}"


def read_result(path: Path) -> Result:
    """Read the result of a policy; folders and file are named by the environment's id, the scenario and the policy.

    Raises:
        ResultError: the file is no result, or not one of this environment, scenario and policy.
    """
    result = read_part(Result, path)
    scenario, env_id = path.parent.name, path.parent.parent.name
    if result.task.env_id != env_id:
        raise ResultError(f"{path}: task.env_id is {result.task.env_id!r}, but the folder is of {env_id!r}")
    if result.task.scenario.name != scenario:
        raise ResultError(f"{path}: task.scenario.name is {result.task.scenario.name!r}, but the folder is of {scenario!r}")
    if path != result_path(path.parent, result.policy):
        raise ResultError(f"{path}: policy is {result.policy.label!r}, but the file is named otherwise")
    return result


def result_files(folder: Path) -> list[Path]:
    """The files of one ``result_folder`` that should be results."""
    # Hidden ones are what a killed process has left.
    return sorted(path for path in folder.glob(f"[!.]*{SUFFIX}") if path.name != TRAJECTORIES_FILE)


PartType = TypeVar("PartType", bound=Part)


def read_part(kind: type[PartType], path: Path) -> PartType:
    """Read a file written by ``write_part``; floats come back bit for bit.

    Raises:
        ResultError: the file cannot be read, or something in it is not allowed.
    """
    try:
        return kind.model_validate(json.loads(_content(path)))
    except ValidationError as error:
        raise ResultError(f"{path}: " + "; ".join(_complaints(error))) from error
    except (OSError, ValueError, RecursionError, lzma.LZMAError, EOFError) as error:
        raise ResultError(f"{path} cannot be read: {error}") from error


def _content(path: Path) -> bytes:
    if not path.name.endswith(".xz"):
        return path.read_bytes()
    with lzma.open(path, format=lzma.FORMAT_XZ) as stream:
        content = stream.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        raise ValueError(f"it holds more than {MAX_BYTES} bytes")
    return content


def write_part(part: Part, path: Path) -> None:
    """Write a file, all of it or nothing, compressed where its name ends in .xz; its folder is made.

    Raises:
        ResultError: the folder or the file cannot be written.
    """
    content = (json.dumps(part.model_dump(by_alias=True), allow_nan=False) + "\n").encode()
    _write(path, lzma.compress(content, preset=9 | lzma.PRESET_EXTREME) if path.name.endswith(".xz") else content)


def write_whole(path: Path, text: str) -> None:
    """Write a text file, all of it or nothing; its folder is made.

    Raises:
        ResultError: the folder or the file cannot be written.
    """
    _write(path, text.encode())


def _write(path: Path, content: bytes) -> None:
    try:
        replace_file(path, lambda partial: partial.write_bytes(content))
    except OSError as error:
        raise ResultError(f"{path} cannot be written: {error.strerror}") from error


def _complaints(error: ValidationError, most: int = 5) -> Iterator[str]:
    details: Sequence[Any] = error.errors()
    for detail in details[:most]:
        field = ".".join(str(part) for part in detail["loc"])
        message = detail["msg"].removeprefix("Value error, ")
        if field and detail["type"] != "missing":
            value = repr(detail["input"])
            message = f"{value if len(value) <= 60 else value[:60] + '...'} is not allowed: {message}"
        yield f"{field}: {message}" if field else message
    if len(details) > most:
        yield f"and {len(details) - most} more"
