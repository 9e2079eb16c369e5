"""An agent as one file for any machine: a network in ONNX with metadata.

The network takes ``observation`` (float32, num_envs x entries). If the agent has a memory, it also
takes ``memory`` (float32, num_envs x memory_size). It returns ``action`` (num_envs x actions,
-1..1), and with a memory also ``next_memory``. Before an episode's first observation the memory is
0. All that belongs to the agent is inside: scaling, clipping, weights.

A file may come from anywhere. So it is refused unless it is small, plain arithmetic from inputs to
outputs (``network.py``), and states all that ``Metadata`` names. Nothing in it can run code, read
another file, loop, or ask for more memory than stated here.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol, Self

from gymnasium.spaces import Box
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError, model_validator

from baselines.belief import Belief, BeliefPolicy, VectorBeliefObservation, with_belief
from baselines.derived_observation import VectorDerivedObservation, with_derived, with_entries
from baselines.load_target import VectorLoadTargetAction, own_actions, space_of
from baselines.models.nominal_points import PointsOfModels
from baselines.policy_spec import Parameters, PolicySpec, ScenarioId, Text
from baselines.rule import Mask
from leaderboard.agents import network
from leaderboard.agents.messages import Outline
from leaderboard.agents.network import MAX_BYTES, MAX_MEMORY
from leaderboard.inputs import Inputs
from turning_env import ALL_IDS, FAMILY_ID, Family, Scenario
from turning_env.batch.driver import action_space, observation_space
from turning_env.files import read_regular
from turning_env.policy import Actions, Observations, Policy, PolicyFactory
from turning_env.scenario import PortableScenario

NAME = r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,127}$"
"""Pattern of agents' names, which also name files."""
FORMAT: Literal["rough-turning/agent/2"] = "rough-turning/agent/2"
ONNX_SUFFIX = ".onnx"
MAX_NUMBER = 2**63 - 1
"""Largest training seed, which also names files, and largest number of steps."""
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
    """The metadata of an agent's file.

    Each field is one ONNX property: text as it is, all else as JSON.
    """

    model_config = _STRICT

    format: Literal["rough-turning/agent/2"]
    algorithm: str = Field(pattern="^[a-z][a-z0-9_]{0,63}$")
    name: str = Field(pattern=NAME)
    """Name on leaderboards."""
    seed: int = Field(ge=0, le=MAX_NUMBER)
    """Training seed."""
    env_id: str
    scenario: PortableScenario
    """Scenario of the training: its name and the values that differ from the defaults."""
    observation_space: Space
    action_space: Space
    parameters: Parameters
    """The algorithm's hyperparameters, and what else the training states of itself."""
    trained_steps: int = Field(ge=0, le=MAX_NUMBER)
    command: Text
    """Command line of the training."""
    versions: dict[str, str]
    """Versions of the packages that made the file."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if self.env_id not in ALL_IDS:
            raise ValueError(f"env_id is {self.env_id!r}, but must be one of {', '.join(ALL_IDS)}")
        observation_space = seen_space(self.env_id, self.scenario, self.parameters)
        if self.observation_space != Space.of(observation_space):
            raise ValueError(f"observation_space is not that of scenario {self.scenario.name!r}")
        action_space = acting_space(self.scenario, self.parameters)
        if self.action_space != Space.of(action_space):
            raise ValueError(f"action_space is not that of scenario {self.scenario.name!r}")
        return self

    @property
    def label(self) -> str:
        """Return the agent's name and training seed: its file's name without the suffix."""
        return f"{self.name}-seed{self.seed}"

    def properties(self) -> dict[str, str]:
        """Return the metadata as ONNX keeps it."""
        values = self.model_dump(mode="json")
        return {
            name: value if isinstance(value, str) else json.dumps(value)
            for name, value in values.items()
        }

    @classmethod
    def of(cls, properties: dict[str, str]) -> Self:
        """Read the metadata from an ONNX model's properties.

        Raises:
            ValueError: something is missing, unknown or not allowed.
        """
        values: dict[str, Any] = {}
        for name, text in properties.items():
            field = cls.model_fields.get(name)
            is_json = field is not None and field.annotation in _JSON_FIELDS
            try:
                values[name] = _from_json(text) if is_json else text
            except (ValueError, RecursionError) as error:
                raise ValueError(f"metadata {name} is not JSON: {error}") from error
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            details = error.errors()[0]
            place = ".".join(str(part) for part in details["loc"])
            message = f"metadata {place}: {details['msg']}"
            # The message of a validator of this class, which has no place.
            message = message.replace("metadata : Value error, ", "metadata ")
            raise ValueError(message) from error


_JSON_FIELDS = (int, Scenario, Space, dict[str, JsonValue], dict[str, str])


def _from_json(text: str) -> Any:
    value = json.loads(text)
    # Halves of surrogate pairs can be read, but not written.
    json.dumps(value, ensure_ascii=False).encode()
    return value


def seen_space(env_id: str, scenario: Scenario, parameters: Mapping[str, Any]) -> Box:
    """Return the space of an agent's observations.

    It is the environment's, with the entries that its parameters name, as of a belief. Raise
    ValueError if the parameters of a family's agent name no context.
    """
    try:
        context = len(parameters["context"]["names"]) if env_id == FAMILY_ID else 0
    except (KeyError, TypeError) as error:
        raise ValueError(
            f"parameters must have context.names, as env_id is {FAMILY_ID!r}"
        ) from error
    inputs = Inputs.of(parameters)
    space: Any = observation_space(scenario, context)
    if inputs.derived:
        space = with_entries(space)
    box: Box = with_belief(space) if inputs.belief else space
    return box


def acting_space(scenario: Scenario, parameters: Mapping[str, Any]) -> Box:
    """Return the space of an agent's actions.

    It is the environment's, or that of load targets. Raise ValueError if the scenario's actions
    know no load targets.
    """
    has_target = Inputs.of(parameters).load_target
    space: Any = space_of(scenario) if has_target else action_space(scenario)
    box: Box = space
    return box


def informed(agent: PolicySpec, scenarios: Scenario | Sequence[Scenario]) -> PolicyFactory:
    """Return the function that makes an agent for scenarios, with what goes with it.

    The agent's parameters say whether it has a belief, derived inputs or a feed loop. If the
    nominal model of its training was wrong, the belief expects errors of the laws.

    Args:
        agent: the agent.
        scenarios: the scenarios that it plays: one for all environments, or one each.
    """
    inputs = Inputs.of(agent.parameters)
    if not inputs.wrappers:
        return agent.make

    def make(num_envs: int) -> Policy:
        played = [scenarios] * num_envs if isinstance(scenarios, Scenario) else scenarios
        models = [scenario.nominal() for scenario in played]
        policy = agent.make(num_envs)
        # The belief stands behind the derived inputs: in reverse order of ``wrapped``.
        if inputs.belief:
            learns_laws = agent.trained_on is not None and bool(agent.trained_on.nominal_model)
            policy = BeliefPolicy(policy, Belief(models, learns_laws))
        if inputs.derived or inputs.load_target:
            policy = _WithNominalPoints(policy, inputs, models)
        return policy

    return make


class _WithNominalPoints(Policy):
    """A policy that is shown derived inputs, sets load targets, or does both, as ``inputs`` say."""

    def __init__(self, policy: Policy, inputs: Inputs, models: Sequence[Scenario]) -> None:
        self._policy = policy
        self._inputs = inputs
        self._models = PointsOfModels(models)

    def reset(self, mask: Mask) -> None:
        self._policy.reset(mask)

    def act(self, observations: Observations) -> Actions:
        shown = observations
        if self._inputs.derived:
            shown = with_derived(self._models, observations)
        actions = self._policy.act(shown)
        if self._inputs.load_target:
            # The loop reads the environment's own observations.
            actions = own_actions(self._models, actions, observations)
        return actions


def wrapped(envs: Any, inputs: Inputs) -> Any:
    """Return vector environments whose observations and actions are those of an agent's training.

    ``informed`` does the same in play.
    """
    if inputs.load_target:
        envs = VectorLoadTargetAction(envs)
    if inputs.derived:
        envs = VectorDerivedObservation(envs)
    return VectorBeliefObservation(envs) if inputs.belief else envs


def description_of_training(parameters: Mapping[str, Any], steps: Any, scenario: str) -> str:
    """Return a description of a training.

    It states the length in environment steps, and the jobs of a family, or the scenario. A
    stranger's file may hold anything as these.
    """
    length = "an unstated length"
    if type(steps) is int and 0 <= steps <= MAX_NUMBER:
        length = f"{steps:,} environment steps"
    family = parameters.get("family")
    name = family.get("name") if isinstance(family, dict) else family
    if name is None:
        return f"trained for {length} on scenario {scenario}"
    return f"trained for {length} on the training jobs of family {str(name)[:64]!r}"


def training_family(env_id: str, parameters: Mapping[str, Any]) -> Family | None:
    """Return the family that a training's parameters name, if its id plays one."""
    return Family.load(parameters["family"]) if env_id == FAMILY_ID else None


class Training(Protocol):
    """A training, as its file's metadata or the folder of its run states it."""

    @property
    def name(self) -> str:
        """Name of the agent."""

    @property
    def scenario(self) -> Scenario:
        """Scenario of the training; for a family, that of its first training job."""

    @property
    def seed(self) -> int:
        """Training seed."""

    @property
    def parameters(self) -> dict[str, Any]:
        """Hyperparameters of the algorithm."""

    @property
    def command(self) -> str:
        """Command line of the training."""


def trained_policy(
    about: Training, trained_steps: int, sha256: str, make: PolicyFactory
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


MEANINGFUL_FIELDS = (
    "control.action",
    "control.aim",
    "control.edge_changes",
    "sensors.force",
    "sensors.probe",
    "sensors.observes_all",
)
"""Fields of a scenario that decide what actions and observations mean."""


def check_fits(agent: PolicySpec, scenario: Scenario) -> None:
    """Raise ValueError if an agent's actions or observations mean something else on a scenario."""
    if "context" in agent.parameters:
        raise ValueError(
            f"{agent.name} plays jobs of {FAMILY_ID}, not scenario {scenario.name!r}: "
            f"add --env {FAMILY_ID}"
        )
    trained_on = agent.trained_on or scenario
    for field in MEANINGFUL_FIELDS:
        section, name = field.split(".")
        trained_value = getattr(getattr(trained_on, section), name)
        value = getattr(getattr(scenario, section), name)
        if value != trained_value:
            raise ValueError(
                f"{agent.name}, trained on scenario {trained_on.name!r} with "
                f"{field} = {trained_value!r}, cannot play {scenario.name!r}, where it is "
                f"{value!r}: actions or observations would mean something else"
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
    """Read an agent's file of your own; load a stranger's with ``onnx_policy.load``.

    Raises:
        ValueError: the file is no agent's.
    """
    # The errors of checks do not name the file, as they also serve files without one.
    content = read_content(path)
    try:
        return checked(content)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def read_content(path: Path) -> bytes:
    """Read a file, or the only ONNX file in a folder.

    Raise ValueError for a link, a pipe or a device, for a folder with none or several, and for a
    file that cannot be read or is too large.
    """
    try:
        if path.is_dir() and not path.is_symlink():
            path = _only_file(path)
        # A link would have another file read than the one that was given.
        return read_regular(path, MAX_BYTES, follow_links=False)
    except OSError as error:
        raise ValueError(f"{path}: {error.strerror}") from error


def _only_file(folder: Path) -> Path:
    """Return the only ONNX file in a folder."""
    files = sorted(folder.glob(f"*{ONNX_SUFFIX}"))
    if (folder / "run.json").exists():
        raise ValueError(
            f"{folder} holds a training run: "
            f"python -m train.export {folder} --out FOLDER makes a file of it"
        )
    if len(files) != 1:
        raise ValueError(
            f"{folder} is a folder with {len(files)} {ONNX_SUFFIX} files: "
            "give a file, or a folder with one"
        )
    return files[0]


def checked(content: bytes) -> AgentFile:
    """Check a file's content; raises ValueError as ``read``."""
    model, outline = network.read(content)
    file = of_outline(content, outline)
    network.check_sizes(model)
    return file


def of_outline(content: bytes, outline: Outline) -> AgentFile:
    """Check metadata and shapes of a file whose graph is plain; raises ValueError as ``read``."""
    metadata = Metadata.of(outline.properties)
    inputs = {"observation": len(metadata.observation_space.low)}
    outputs = {"action": len(metadata.action_space.low)}
    memory_size = 0
    if "memory" in outline.inputs:
        memory_size = outline.inputs["memory"]
        inputs["memory"] = memory_size
        outputs["next_memory"] = memory_size
    _check_entries("inputs", outline.inputs, expected=inputs)
    _check_entries("outputs", outline.outputs, expected=outputs)
    if "memory" in outline.inputs and not 1 <= memory_size <= MAX_MEMORY:
        raise ValueError(f"has a memory of {memory_size} entries, but may have 1 to {MAX_MEMORY}")
    return AgentFile(content, metadata, memory_size)


def _check_entries(kind: str, entries: Mapping[str, int], expected: Mapping[str, int]) -> None:
    if entries != expected:
        raise ValueError(
            f"has {kind} {entries}, but must have {expected} entries per environment "
            "for its scenario"
        )
