"""The identity of a policy: a controller, an agent or an oracle, and how to make it."""

import json
import re
from collections.abc import Callable
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    JsonValue,
    field_validator,
    model_validator,
)

from turning_env.policy import Policy, PolicyFactory
from turning_env.scenario import Scenario

MAX_NAME = 200
"""Largest number of bytes of a policy's name. With a training seed and a suffix it names a file,
whose name may have 255."""
MAX_TRAINING_SEED = 2**63 - 1
MAX_TEXT = 10_000  # characters of a description or a command
MAX_PARAMETERS = 100_000  # characters of parameters, as JSON
DIGEST_LENGTH = 64  # characters of a SHA-256


def _known_by_name(num_envs: int) -> Policy:
    raise ValueError("a policy that is known by name only cannot play: load the policy itself")


def _of_moderate_size(parameters: dict[str, JsonValue]) -> dict[str, JsonValue]:
    """Refuse parameters that are larger than any training's."""
    size = len(json.dumps(parameters))
    if size > MAX_PARAMETERS:
        raise ValueError(f"{size} characters of parameters, but at most {MAX_PARAMETERS} are read")
    return parameters


Text = Annotated[str, Field(max_length=MAX_TEXT)]
Digest = Annotated[str, Field(max_length=DIGEST_LENGTH)]
Knowledge = Literal["nominal", "true_laws"]
"""Model from which a family's policy is built: each job's nominal one, without or with all true
laws."""
Parameters = Annotated[dict[str, JsonValue], AfterValidator(_of_moderate_size)]


class ScenarioId(BaseModel):
    """A scenario's name, and the digest of its values."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    name: str = Field(pattern="^[A-Za-z0-9_-][A-Za-z0-9_.-]{0,63}$")
    """It also names a folder."""
    digest: Digest

    @classmethod
    def of(cls, scenario: Scenario) -> Self:
        """Identify a scenario."""
        return cls(name=scenario.name, digest=scenario.digest())


class PolicySpec(BaseModel):
    """A policy that can play: its identity and how to make it.

    Two specs are the same policy if their ``identity`` is equal. You may change descriptions and
    commands freely. Raise a rule's ``version`` if its actions change.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True)

    name: str
    version: int = Field(default=1, ge=1)
    """Version of a rule or an oracle, raised when its actions change (golden actions)."""
    kind: Literal["rule", "agent", "oracle"] = "rule"
    """An oracle sees hidden quantities, or is a bound that nobody can play."""
    description: Text = ""
    parameters: Parameters = Field(default_factory=dict)
    """A rule's settings, or hyperparameters of an agent's training."""
    knows: Knowledge = "nominal"
    forgets: bool = False  # whether it forgets everything at each change of the edge
    training_seed: int | None = Field(default=None, ge=0, le=MAX_TRAINING_SEED)
    """Training seed of an agent. Agents of one name are one policy on a leaderboard."""
    sha256: Digest | None = None  # SHA-256 of an agent's file
    command: Text | None = None  # the command that trained an agent or tuned a rule
    tuned_for: ScenarioId | None = None
    """The scenario on which it was tuned or trained; None: the one that it plays."""
    trained_on: Scenario | None = Field(default=None, exclude=True, repr=False)
    """The scenario of a loaded agent's training."""
    make: PolicyFactory = Field(default=_known_by_name, exclude=True, repr=False)
    """Makes the policy for a number of environments."""
    compute: Callable[..., Any] | None = Field(default=None, exclude=True, repr=False)
    """Function of a bound in place of ``make``: returns its episodes for a scenario, seeds and a
    callback."""

    @field_validator("name")
    @classmethod
    def _names_a_file(cls, name: str) -> str:
        reserved = ("trajectories", "manifest", "results")
        if not re.fullmatch(r"(?!\.)[^/\\]+", name) or not name.isprintable() or name in reserved:
            raise ValueError(
                f"{name[:MAX_NAME]!r} cannot be a policy's name, "
                "as its results are kept in a file of that name"
            )
        if len(name.encode()) > MAX_NAME:
            raise ValueError(
                f"{name[:20]!r}... cannot be a policy's name: it has more than {MAX_NAME} bytes"
            )
        return name

    @model_validator(mode="after")
    def _agents_have_seeds(self) -> Self:
        if (self.kind == "agent") != (self.training_seed is not None):
            raise ValueError(
                f"training_seed is {self.training_seed}, but an agent has one and others have none"
            )
        return self

    @property
    def title(self) -> str:
        """Name with, in words, its knowledge and its memory."""
        title = self.name
        if self.knows == "true_laws":
            title += " with true laws"
        if self.forgets:
            title += " without memory between edges"
        return title

    @property
    def label(self) -> str:
        """Title with an agent's training seed."""
        if self.training_seed is None:
            return self.title
        return f"{self.title}-seed{self.training_seed}"

    @property
    def identity(self) -> dict[str, Any]:
        """Fields that distinguish this policy from others."""
        excluded = {"description", "command"}
        # Fields that were added later count only if they are used.
        if self.knows == "nominal":
            excluded.add("knows")
        if not self.forgets:
            excluded.add("forgets")
        return self.model_dump(exclude=excluded)
