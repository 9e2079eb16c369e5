"""Names of submitted agents: a result has the name of its file, whatever the file states.

A stranger's file may state any name and training seed, also a rival's. So the organiser's names
decide: that of the file, and that of its folder if two files have the same name. The stated name
becomes part of the description.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from baselines.policy_spec import PolicySpec
from leaderboard.agents.agent_file import NAME, ONNX_SUFFIX
from turning_env.console import printable

_WITH_SEED = re.compile(r"(?P<name>.+)-seed(?P<seed>\d{1,9})")


@dataclass(frozen=True)
class Submission:
    """An agent that plays, and the path that was given for it."""

    path: Path
    policy: PolicySpec


@dataclass(frozen=True)
class FileName:
    """The name and the training seed in a file's name: ``team1.onnx`` or ``team1-seed3.onnx``."""

    name: str
    seed: int
    folder: str  # name of the folder that holds the file

    @classmethod
    def of(cls, path: Path, given: str | None = None) -> "FileName":
        """Read the name of a file, or of the only agent in a folder.

        A ``given`` name takes the place of the file's; the training seed remains that of the file.
        Raise ValueError if the name cannot name a policy.
        """
        file = path.absolute()
        if file.is_dir():
            file = next(file.glob(f"*{ONNX_SUFFIX}"), file)
        stem = file.name.removesuffix(ONNX_SUFFIX)
        with_seed = _WITH_SEED.fullmatch(stem)
        if with_seed is None:
            name, seed = stem, 0
        else:
            name, seed = with_seed["name"], int(with_seed["seed"])
        if given:
            name = given
        if not re.fullmatch(NAME, name):
            raise ValueError(
                f"{printable(name)!r} cannot name a policy: rename the file, or give --name; names "
                "have at most 128 letters, digits, _, . or -, the first no . or -"
            )
        return cls(name=name, seed=seed, folder=file.parent.name)


def renamed(policy: PolicySpec, name: str, seed: int) -> PolicySpec:
    """Return an agent under the name and training seed of its file.

    The description keeps what the agent calls itself.
    """
    if name == policy.name and seed == policy.training_seed:
        return policy
    stated = f"calls itself {policy.name}, training seed {policy.training_seed}"
    changes = {
        "name": name,
        "training_seed": seed,
        "description": f"{stated}; {policy.description}",
    }
    return PolicySpec.model_validate(dict(policy) | changes)


def clashing_names(submissions: Sequence[Submission]) -> set[str]:
    """Return the names that several different agents have with the same training seed."""
    first_paths: dict[str, Path] = {}
    clashing = set()
    for submission in submissions:
        first_path = first_paths.setdefault(submission.policy.label, submission.path)
        if first_path != submission.path:
            clashing.add(submission.policy.name)
    return clashing


def with_folder(submission: Submission) -> Submission:
    """Return an agent called FOLDER_NAME, after its folder and its name.

    Raise ValueError if the folder's name cannot name a policy.
    """
    folder = FileName.of(submission.path).folder
    if not re.fullmatch(NAME, folder):
        raise ValueError(
            f"another file has its name, and its folder {printable(folder)!r} cannot name a "
            "policy: rename the file"
        )
    policy = submission.policy
    changes = {"name": f"{folder}_{policy.name}"}
    qualified = PolicySpec.model_validate(dict(policy) | changes)
    return Submission(path=submission.path, policy=qualified)
