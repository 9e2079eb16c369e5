"""Publish agents and data sets on the Hugging Face hub: one repository each.

    python -m examples.publish OWNER agents/*/*/*.md runs/datasets/rough_turning-mixture-v0
    python -m examples.publish OWNER agents/*/*/*.md runs/datasets/* --upload

An agent is named by its card, a data set by its folder (``examples.offline make``). The card is the
repository's README. Without --upload, the command prints what it would upload. Log in first: ``hf
auth login``.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from huggingface_hub import CommitOperationAdd, HfApi

from turning_env.console import described, exits


class Repository(NamedTuple):
    """A repository of the hub."""

    name: str
    kind: str  # "model" or "dataset"
    files: dict[str, Path]  # files by their names in the repository


def repository(path: Path) -> Repository:
    """Return the repository of an agent's card or of a data set's folder.

    Raises:
        ValueError: it is neither.
    """
    agents = sorted(path.parent.glob(f"{path.stem}-seed*.onnx"))
    if path.suffix == ".md" and agents:
        id_and_scenario = path.resolve().parts[-3:-1]
        name = "-".join((*id_and_scenario, path.stem))
        files = {"README.md": path} | {agent.name: agent for agent in agents}
        return Repository(name, "model", files)
    if (path / "croissant.json").is_file():
        below = sorted(file for file in path.rglob("*") if file.is_file())
        files = {file.relative_to(path).as_posix(): file for file in below}
        return Repository(path.resolve().name, "dataset", files)
    raise ValueError(f"{path} is neither the card of an agent nor the folder of a data set")


def upload(home: str, repository: Repository) -> None:
    """Create a repository on the hub, under the name ``home``, and upload its files."""
    hub = HfApi()
    hub.create_repo(home, repo_type=repository.kind, exist_ok=True)
    operations = [CommitOperationAdd(name, file) for name, file in repository.files.items()]
    hub.create_commit(home, operations, commit_message="Upload", repo_type=repository.kind)


@exits(ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print or upload; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m examples.publish", **described(__doc__))
    parser.add_argument("owner", metavar="OWNER", help="user or organisation")
    parser.add_argument(
        "paths", nargs="+", type=Path, metavar="PATH", help="cards of agents, folders of data sets"
    )
    parser.add_argument("--upload", action="store_true", help="create the repositories and upload")
    options = parser.parse_args(arguments)
    # All paths are checked before anything is uploaded.
    repositories = [repository(path) for path in options.paths]
    for present in repositories:
        home = f"{options.owner}/{present.name}"
        print(f"{present.kind} {home}: {', '.join(present.files)}", flush=True)
        if options.upload:
            upload(home, present)
    return 0


if __name__ == "__main__":
    sys.exit(main())
