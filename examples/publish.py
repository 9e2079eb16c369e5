"""Publish agents and data sets on the Hugging Face hub: a repository each, whose card is its README.

    python -m examples.publish OWNER agents/RoughTurning-v0/rough_turning/ppo.md runs/datasets/rough_turning-mixture-v0
    python -m examples.publish OWNER agents/*/*/*.md runs/datasets/* --upload

An agent is named by its card, a data set by its folder (``examples.offline make``). Without --upload, the command prints what it
would upload. Log in first: ``hf auth login``.
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
    kind: str
    files: dict[str, Path]  # files by their names in the repository


def repository(path: Path) -> Repository:
    """Return the repository of an agent's card or of a data set's folder.

    Raises:
        ValueError: it is neither.
    """
    if path.suffix == ".md" and (agents := sorted(path.parent.glob(f"{path.stem}-seed*.onnx"))):
        files = {"README.md": path} | {each.name: each for each in agents}
        return Repository(
            "-".join((*path.resolve().parts[-3:-1], path.stem)), "model", files
        )  # id, scenario, name
    if (path / "croissant.json").is_file():
        files = {
            each.relative_to(path).as_posix(): each
            for each in sorted(path.rglob("*"))
            if each.is_file()
        }
        return Repository(path.resolve().name, "dataset", files)
    raise ValueError(f"{path} is neither the card of an agent nor the folder of a data set")


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
    for name, kind, files in list(map(repository, options.paths)):
        home = f"{options.owner}/{name}"
        print(f"{kind} {home}: {', '.join(files)}", flush=True)
        if options.upload:
            hub = HfApi()
            hub.create_repo(home, repo_type=kind, exist_ok=True)
            added = [CommitOperationAdd(target, source) for target, source in files.items()]
            hub.create_commit(home, added, commit_message="Upload", repo_type=kind)
    return 0


if __name__ == "__main__":
    sys.exit(main())
