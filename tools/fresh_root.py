"""Prepare the publication of the repository from a fresh root, with its history in an archive.

Most of the history's size is results and agents that were replaced before anything was published.
This makes a branch of two commits: the tree of HEAD with the agents of all training seeds, and the
same without seeds 1 to 9, whose Makefile names the first commit as ALL_SEEDS. It writes all
branches and tags, as they were, to a Git bundle. No existing branch and no file of the working tree
changes. CONTRIBUTING.md has the steps that follow.

    python -m tools.fresh_root --archive ../rough-turning-history.bundle
"""

import argparse
import hashlib
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from turning_env.console import UserError, described, exits

OTHER_SEED = re.compile(r"^agents/.*-seed[1-9]\.onnx$")
"""Paths of agents that only the commit of all seeds holds."""
ALL_SEEDS = re.compile(r"^(?P<assignment>ALL_SEEDS \?= )(?P<commit>[0-9a-f]{40})$", re.MULTILINE)
"""The Makefile's line that names this commit."""


def git(*arguments: str, text: str | None = None, index: Path | None = None) -> str:
    """Run git and return what it prints; ``text`` is its input, ``index`` replaces its index.

    Raise UserError with git's message if it fails.
    """
    variables = dict(os.environ)
    if index is not None:
        variables["GIT_INDEX_FILE"] = str(index)
    finished = subprocess.run(
        ["git", *arguments],
        input=text,
        capture_output=True,
        text=True,
        env=variables,
        check=False,
    )
    if finished.returncode:
        raise UserError(f"git {arguments[0]}: {finished.stderr.strip()}")
    return finished.stdout


def entries_of_other_seeds(commit: str) -> str:
    """Return the agents of training seeds 1 to 9 in a commit, as ``git update-index`` reads them.

    Raise UserError if there is none.
    """
    entries = []
    for entry in git("ls-tree", "-r", commit, "agents").splitlines():
        _, path = entry.split("\t")
        if OTHER_SEED.match(path):
            entries.append(entry)
    if not entries:
        raise UserError(f"{commit} holds no agents of training seeds 1 to 9")
    return "\n".join(entries) + "\n"


def fresh_commits(version: str) -> str:
    """Make the two commits without changing a branch, and return the hash of the second.

    Raise UserError if the Makefile of HEAD names no commit of all seeds, or this holds none.
    """
    makefile = git("show", "HEAD:Makefile")
    setting = ALL_SEEDS.search(makefile)
    if setting is None:
        raise UserError("the Makefile of HEAD has no line ALL_SEEDS ?= COMMIT")
    other_seeds = entries_of_other_seeds(setting["commit"])
    with tempfile.TemporaryDirectory() as folder:
        # An index of its own leaves what the user has staged as it is.
        index = Path(folder) / "index"
        git("read-tree", "HEAD", index=index)
        git("update-index", "--index-info", text=other_seeds, index=index)
        tree = git("write-tree", index=index).strip()
        all_seeds = git("commit-tree", tree, "-m", f"Publish {version} with all seeds").strip()

        changed = ALL_SEEDS.sub(rf"\g<assignment>{all_seeds}", makefile)
        blob = git("hash-object", "-w", "--stdin", text=changed).strip()
        git("read-tree", "HEAD", index=index)
        git("update-index", "--cacheinfo", f"100644,{blob},Makefile", index=index)
        tree = git("write-tree", index=index).strip()
    message = "Keep one training seed of each agent"
    return git("commit-tree", tree, "-p", all_seeds, "-m", message).strip()


@exits()
def main(arguments: Sequence[str] | None = None) -> int:
    """Write the archive and make the branch; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.fresh_root", **described(__doc__))
    parser.add_argument("--archive", type=Path, required=True, help="file of the bundle, new")
    parser.add_argument("--branch", default="published", help="new branch (default: %(default)s)")
    parser.add_argument("--version", default="0.6.0", help="named in the first commit")
    options = parser.parse_args(arguments)
    if options.archive.exists():
        raise UserError(f"{options.archive} exists: name a new file")
    if git("branch", "--list", options.branch):
        raise UserError(f"the branch {options.branch} exists: name a new one with --branch")

    commit = fresh_commits(options.version)
    # Before the new branch, so that the archive holds the old history alone.
    git("bundle", "create", str(options.archive), "--all")
    git("bundle", "verify", str(options.archive))
    git("branch", options.branch, commit)
    digest = hashlib.sha256(options.archive.read_bytes()).hexdigest()
    print(f"{options.archive}: {options.archive.stat().st_size / 1e6:.0f} MB, SHA-256 {digest}")
    print(f"{options.branch}: {commit}, two commits; push it as main of the new repository")
    return 0


if __name__ == "__main__":
    sys.exit(main())
