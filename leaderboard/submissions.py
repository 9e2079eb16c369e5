"""Names of submitted agents: a result has the name of its file, whatever the file states of itself.

A stranger's file may state any name and training seed, also a rival's. What decides is what the organiser gave: the name of the
file, and of its folder where two files have the same name. The stated name is a label in the description.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from train.agents.agent_file import NAME, ONNX_SUFFIX
from turning_env.console import printable
from turning_env.scoring.policy import PolicySpec

_WITH_SEED = re.compile(r"(?P<name>.+)-seed(?P<seed>\d{1,9})")


@dataclass(frozen=True)
class Submission:
    """An agent that plays, and the path that was given for it."""

    path: Path
    policy: PolicySpec


@dataclass(frozen=True)
class FileName:
    """The name and the training seed that a file's name says: ``team1.onnx`` or ``team1-seed3.onnx``."""

    name: str
    seed: int
    folder: str  # name of the folder that holds the file

    @classmethod
    def of(cls, path: Path, given: str | None = None) -> "FileName":
        """Read the name of a file, or of the only agent in a folder; ValueError if it cannot name a policy.

        A ``given`` name takes the place of the file's, whose training seed remains.
        """
        file = path.absolute()
        if file.is_dir():
            file = next(file.glob(f"*{ONNX_SUFFIX}"), file)
        stem = file.name.removesuffix(ONNX_SUFFIX)
        found = _WITH_SEED.fullmatch(stem)
        name = given or (found["name"] if found else stem)
        if not re.fullmatch(NAME, name):
            raise ValueError(
                f"{printable(name)!r} cannot name a policy: rename the file, or give --name; names have at most 128 letters, "
                "digits, _, . or -, the first no . or -"
            )
        return cls(name=name, seed=int(found["seed"]) if found else 0, folder=file.parent.name)


def renamed(policy: PolicySpec, name: str, seed: int) -> PolicySpec:
    """Return an agent under the name and training seed of its file; the description keeps what the agent calls itself."""
    if (name, seed) == (policy.name, policy.training_seed):
        return policy
    description = (
        f"calls itself {policy.name}, training seed {policy.training_seed}; {policy.description}"
    )
    values = dict(policy) | {"name": name, "training_seed": seed, "description": description}
    return PolicySpec.model_validate(values)


def clashing_names(submissions: Sequence[Submission]) -> set[str]:
    """Return the names that several different agents have with the same training seed."""
    labels: dict[str, Path] = {}
    clashing = set()
    for submission in submissions:
        first = labels.setdefault(submission.policy.label, submission.path)
        if first != submission.path:
            clashing.add(submission.policy.name)
    return clashing


def with_folder(submission: Submission) -> Submission:
    """Return an agent with the name of its folder before its own; ValueError if the folder's name cannot name a policy."""
    folder = FileName.of(submission.path).folder
    if not re.fullmatch(NAME, folder):
        raise ValueError(
            f"another file has its name, and its folder {printable(folder)!r} cannot name a policy: rename the file"
        )
    policy = submission.policy
    qualified = PolicySpec.model_validate(dict(policy) | {"name": f"{folder}_{policy.name}"})
    return Submission(path=submission.path, policy=qualified)
