"""An agent as one file for any machine: a network in ONNX, with metadata on the agent and its training.

The network takes ``observation`` (float32, num_envs x entries) and, where the agent has a memory, ``memory`` (float32,
num_envs x memory_size); it gives ``action`` (num_envs x actions, -1..1) and then also ``next_memory``. Before an episode's first
observation the memory is 0. All that belongs to the agent is inside: scaling, clipping, weights.

A file may come from anywhere, so it is refused unless it is small, plain arithmetic from inputs to outputs, and says all that
``Metadata`` names. Nothing in it can run code, read another file, loop, or ask for more memory than stated here.
"""

import hashlib
import json
import os
import stat
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from gymnasium.spaces import Box
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError, model_validator

from baselines.belief import Belief, BeliefPolicy, with_belief
from baselines.guided import HOLD, GuidedPolicy, decision_space, feature_space
from train.agents import network
from train.agents.network import MAX_BYTES, MAX_MEMORY
from train.run import Run
from turning_env import FAMILY_ID, IDS, Family, Scenario
from turning_env.batch.driver import action_space, observation_space
from turning_env.scenario import PortableScenario
from turning_env.scoring.policy import Policy, PolicyFactory, PolicySpec, ScenarioId
from turning_env.scoring.sandbox_child import Outline

NAME = r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,127}$"  # pattern of agents' names, which also name files
FORMAT: Literal["rough-turning/agent/2"] = "rough-turning/agent/2"
ONNX_SUFFIX = ".onnx"
MAX_NUMBER = 2**63 - 1  # largest training seed, which also names files, and largest number of steps
_STRICT = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class Space(BaseModel):
    """The bounds of a box, one value per entry."""

    model_config = _STRICT

    low: list[float]
    high: list[float]

    @classmethod
    def of(cls, box: Any) -> Self:
        """Return the bounds of a Gymnasium ``Box`` of one axis."""
        return cls(low=box.low.tolist(), high=box.high.tolist())


class Metadata(BaseModel):
    """The metadata of an agent's file: one ONNX property per field, text as it is, all else as JSON."""

    model_config = _STRICT

    format: Literal["rough-turning/agent/2"]
    algorithm: str = Field(pattern="^[a-z][a-z0-9_]{0,63}$")
    name: str = Field(pattern=NAME)  # name on leaderboards; a file without it has its algorithm's
    seed: int = Field(ge=0, le=MAX_NUMBER)  # training seed
    env_id: str
    scenario: PortableScenario  # scenario of the training: its name and the values that differ from the defaults
    observation_space: Space
    action_space: Space
    parameters: dict[str, JsonValue]  # the algorithm's hyperparameters
    trained_steps: int = Field(ge=0, le=MAX_NUMBER)
    command: str  # command line of the training
    versions: dict[str, str]  # versions of the packages that made the file

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if self.env_id not in (*IDS, FAMILY_ID):
            raise ValueError(
                f"env_id is {self.env_id!r}, but must be one of {', '.join((*IDS, FAMILY_ID))}"
            )
        for name, box in (
            ("observation_space", seen_space(self.env_id, self.scenario, self.parameters)),
            ("action_space", acting_space(self.scenario, self.parameters)),
        ):
            if getattr(self, name) != Space.of(box):
                raise ValueError(f"{name} is not that of scenario {self.scenario.name!r}")
        return self

    @property
    def label(self) -> str:
        """Return the agent's name and training seed: its file's name without the suffix."""
        return f"{self.name}-seed{self.seed}"

    def properties(self) -> dict[str, str]:
        """Return the metadata as ONNX keeps it."""
        values = self.model_dump(
            mode="json", exclude={"name"} if self.name == self.algorithm else None
        )
        return {
            name: value if isinstance(value, str) else json.dumps(value)
            for name, value in values.items()
        }

    @classmethod
    def of(cls, properties: dict[str, str]) -> Self:
        """Read the metadata from an ONNX model's properties. Raise ValueError if something is missing, unknown or not allowed."""
        values: dict[str, Any] = {"name": properties.get("algorithm", "")}
        for name, text in properties.items():
            field = cls.model_fields.get(name)
            try:
                values[name] = (
                    _from_json(text)
                    if field is not None and field.annotation in _JSON_FIELDS
                    else text
                )
            except (ValueError, RecursionError) as error:
                raise ValueError(f"metadata {name} is not JSON: {error}") from error
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            details = error.errors()[0]
            place = ".".join(str(part) for part in details["loc"])
            raise ValueError(
                f"metadata {place}: {details['msg']}".replace(
                    "metadata : Value error, ", "metadata "
                )
            ) from error


def seen_space(env_id: str, scenario: Scenario, parameters: Mapping[str, Any]) -> Box:
    """Return the space of an agent's observations: the environment's, with what its parameters name of model and belief."""
    try:
        context = len(parameters["context"]["names"]) if env_id == FAMILY_ID else 0
    except (KeyError, TypeError) as error:
        raise ValueError(
            f"parameters must have context.names, as env_id is {FAMILY_ID!r}"
        ) from error
    if parameters.get("guide") is True:
        return feature_space(context)
    space: Any = observation_space(scenario, context)
    box: Box = with_belief(space) if parameters.get("belief") is True else space
    return box


def acting_space(scenario: Scenario, parameters: Mapping[str, Any]) -> Box:
    """Return the space of an agent's actions: the environment's, or a guide's decisions if its parameters say so."""
    space: Any = decision_space() if parameters.get("guide") is True else action_space(scenario)
    box: Box = space
    return box


def informed(
    agent: PolicySpec,
    scenarios: Scenario | Sequence[Scenario],
    shown: Mapping[str, float] | None = None,
) -> PolicyFactory:
    """Return the function that makes an agent, with the belief or the rule that its parameters name, for the scenarios it plays.

    If the nominal model of its training was wrong, the belief expects errors of the laws. ``shown`` is what a guide must know of
    scenarios that are no jobs of a family, beside their nominal models: the values of ``Family.shown`` of its training. The
    function raises ValueError if one is missing, or has another name.
    """
    guides = agent.parameters.get("guide") is True
    if not guides and agent.parameters.get("belief") is not True:
        return agent.make

    def with_model(num_envs: int) -> Policy:
        played = [scenarios] * num_envs if isinstance(scenarios, Scenario) else scenarios
        models = [each.nominal() for each in played]
        if guides:
            context = None
            if shown is not None:
                family = Family.load(str(agent.parameters["family"]))
                context = np.stack([family.context_of(each, shown) for each in played]).astype(
                    np.float32
                )
            return GuidedPolicy(agent.make(num_envs), models, context)
        learns_laws = agent.trained_on is not None and bool(agent.trained_on.nominal_model)
        return BeliefPolicy(agent.make(num_envs), Belief(models, learns_laws))

    return with_model


def _from_json(text: str) -> Any:
    value = json.loads(text)
    json.dumps(
        value, ensure_ascii=False
    ).encode()  # halves of surrogate pairs can be read, but not written
    return value


_JSON_FIELDS = (int, Scenario, Space, dict[str, JsonValue], dict[str, str])


def description_of_training(parameters: Mapping[str, Any], steps: Any, scenario: str) -> str:
    """Return the length of a training in environment steps, and what it was trained on: the jobs of a family, or a scenario."""
    count = steps * HOLD if type(steps) is int and parameters.get("guide") is True else steps
    length = (
        f"{count:,} environment steps"
        if type(count) is int and 0 <= count <= HOLD * MAX_NUMBER
        else "an unstated length"
    )
    family = parameters.get("family")
    name = family.get("name") if isinstance(family, dict) else family
    if name is None:
        return f"trained for {length} on scenario {scenario}"
    return f"trained for {length} on the training jobs of family {str(name)[:64]!r}"


def trained_policy(
    about: Metadata | Run, trained_steps: int, sha256: str, make: PolicyFactory
) -> PolicySpec:
    """Return the policy of a finished training, from its file's metadata or its run."""
    return PolicySpec(
        name=about.name,
        kind="agent",
        description=description_of_training(about.parameters, trained_steps, about.scenario.name),
        parameters=about.parameters,
        training_seed=about.seed,
        sha256=sha256,
        command=about.command,
        tuned_for=ScenarioId.of(about.scenario),
        trained_on=about.scenario,
        make=make,
    )


def check_fits(agent: PolicySpec, scenario: Scenario) -> None:
    """Raise ValueError if actions or observations of a scenario mean something else than where an agent was trained."""
    if "context" in agent.parameters:
        raise ValueError(
            f"{agent.name} plays jobs of {FAMILY_ID}, not scenario {scenario.name!r}: add --env {FAMILY_ID}"
        )
    trained_on = agent.trained_on or scenario
    for field in (
        "control.action",
        "control.aim",
        "control.edge_changes",
        "sensors.force",
        "sensors.probe",
    ):
        section, name = field.split(".")
        mine, its = (getattr(getattr(each, section), name) for each in (trained_on, scenario))
        if mine != its:
            raise ValueError(
                f"{agent.name}, trained on scenario {trained_on.name!r} with {field} = {mine!r}, cannot play {scenario.name!r}, "
                f"where it is {its!r}: actions or observations would mean something else"
            )


@dataclass(frozen=True)
class AgentFile:
    """An agent's file that has passed every check."""

    content: bytes
    metadata: Metadata
    memory_size: int

    @property
    def digest(self) -> str:
        """Return the SHA-256 of the file."""
        return hashlib.sha256(self.content).hexdigest()


def read(path: Path) -> AgentFile:
    """Read an agent's file of one's own or raise ValueError; load a stranger's with ``onnx_policy.load``."""
    content = read_content(path)
    try:
        return checked(content)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def read_content(path: Path) -> bytes:
    """Read a file, or the only ONNX file in a folder, up to a byte more than is allowed; links, pipes and devices are refused."""
    if path.is_dir() and not path.is_symlink():
        found = sorted(path.glob(f"*{ONNX_SUFFIX}"))
        if (path / "run.json").exists():
            raise ValueError(
                f"{path} holds a training run: python -m train.export {path} --out FOLDER makes a file of it"
            )
        if len(found) != 1:
            raise ValueError(
                f"{path} is a folder with {len(found)} {ONNX_SUFFIX} files: give a file, or a folder with one"
            )
        path = found[0]
    # Not to wait for whoever may write into a pipe. A link would have another file read than the one that was given.
    flags = (
        os.O_RDONLY
        | getattr(os, "O_NOFOLLOW", 0)
        | getattr(os, "O_NONBLOCK", 0)
        | getattr(os, "O_BINARY", 0)
    )
    if path.is_symlink():
        raise ValueError(f"{path} is a link: give the file itself")
    with os.fdopen(os.open(path, flags), "rb") as stream:
        if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
            raise ValueError(f"{path} is not an ordinary file")
        return stream.read(MAX_BYTES + 1)


def checked(content: bytes) -> AgentFile:
    """Check a file's content; raises ValueError as ``read``."""
    model, outline = network.read(content)
    file = of_outline(content, outline)
    network.check_sizes(model)
    return file


def of_outline(content: bytes, outline: Outline) -> AgentFile:
    """Check the metadata and shapes of a file whose graph is plain; raises ValueError as ``read``."""
    metadata = Metadata.of(outline.properties)
    entries, actions = len(metadata.observation_space.low), len(metadata.action_space.low)
    inputs, outputs = outline.inputs, outline.outputs
    memory = inputs.get("memory", 0)
    expected_inputs = {"observation": entries} | ({"memory": memory} if "memory" in inputs else {})
    expected_outputs = {"action": actions} | ({"next_memory": memory} if "memory" in inputs else {})
    for what, found, expected in (
        ("inputs", inputs, expected_inputs),
        ("outputs", outputs, expected_outputs),
    ):
        if found != expected:
            raise ValueError(
                f"has {what} {found}, but must have {expected} entries per environment for its scenario"
            )
    if "memory" in inputs and not 1 <= memory <= MAX_MEMORY:
        raise ValueError(f"has a memory of {memory} entries, but may have 1 to {MAX_MEMORY}")
    return AgentFile(content, metadata, memory)
