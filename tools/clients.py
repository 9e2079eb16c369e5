"""Test the recipes of other libraries, each in an empty virtual environment.

    python -m tools.clients
    python -m tools.clients skrl sbx-rl --write docs/ecosystem.md

It needs a package index and 2 GB of disk, and takes some minutes per library. The exit status is 1
if a recipe fails.
"""

import argparse
import datetime
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from tools.wheel import ROOT, built, new_python
from turning_env.console import described, exits
from turning_env.files import replace_file

MAX_INSTALL = 1800.0  # time limit of the installation [s]
MAX_RUN = 900.0  # time limit of the recipe [s]
VERSIONS = """
import json, sys
from importlib.metadata import version
print(json.dumps([version(name) for name in sys.argv[1:]]))
"""


class Client(NamedTuple):
    """The recipe of a library."""

    recipe: str  # module in examples
    uses: str
    packages: tuple[str, ...]
    words: str = (
        "--env RoughTurning-Family-v1 --steps 5000 --tuning-seeds 2"  # options that make it small
    )


CLIENTS = {
    "skrl": Client("skrl_ppo", "PPO on the batch of any id", ("skrl",)),
    "ray": Client("rllib_ppo", "RLlib's PPO on the batch of any id", ("ray[rllib]",)),
    "sbx-rl": Client("sbx_sac", "SAC on the batch of any id", ("sbx-rl",)),
    "d3rlpy": Client(
        "offline_rl",
        "BC, IQL, CQL, TD3+BC on data of Minari",
        ("d3rlpy", "minari[hdf5]", "pillow"),
        "--steps 100 --training-seeds 1 --seeds 2",
    ),
}
"""Recipes by name of the distribution."""


def attempt(library: str, wheel: Path, folder: Path) -> tuple[list[str], str | None]:
    """Install and run a recipe in an empty folder.

    Returns:
        The versions of the library and of Gymnasium, and the failure, if any.
    """
    client = CLIENTS[library]
    python = new_python(folder)
    install = [
        str(Path(sys.executable).with_name("uv")),
        "pip",
        "install",
        "--quiet",
        "--python",
        python,
    ]
    # Folders of pip's settings may hold a build of torch without CUDA.
    config = [sys.executable, "-m", "pip", "config", "get", "global.find-links"]
    setting = subprocess.run(
        config,
        check=False,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    for wheels in setting.stdout.split():
        install += ["--find-links", wheels]
    # The clone's version of torch.
    constraints = (ROOT / "packaging/constraints.txt").read_text("utf-8")
    pin = re.findall(r"^torch==\S+", constraints, re.MULTILINE)
    shutil.copytree(ROOT / "examples", folder / "examples")
    versions = ["-", "-"]
    stage = "the installation"
    try:
        subprocess.run(
            [*install, str(wheel), *pin, *client.packages],
            cwd=folder,
            check=True,
            timeout=MAX_INSTALL,
        )
        ask_versions = [python, "-c", VERSIONS, library, "gymnasium"]
        answer = subprocess.run(ask_versions, check=True, stdout=subprocess.PIPE)
        versions = json.loads(answer.stdout)
        stage = "the recipe"
        recipe = [python, "-m", f"examples.{client.recipe}", *client.words.split()]
        subprocess.run(recipe, cwd=folder, check=True, timeout=MAX_RUN)
    except subprocess.TimeoutExpired as error:
        return versions, f"{stage} took more than {error.timeout:.0f} s"
    except subprocess.CalledProcessError as error:
        return versions, f"{stage} ended with status {error.returncode}"
    return versions, None


def with_row(text: str, library: str, row: str) -> str:
    """Return a Markdown text with a library's row replaced; ValueError unless there is one."""
    replaced, count = re.subn(
        rf"^\| {re.escape(library)} \|.*$", lambda _: row, text, flags=re.MULTILINE
    )
    if count != 1:
        raise ValueError(
            f"there must be one table row that begins with | {library} |, but there are {count}"
        )
    return replaced


@exits(OSError, ValueError, checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Test libraries one after the other; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.clients", **described(__doc__))
    parser.add_argument(
        "libraries",
        nargs="*",
        metavar="LIBRARY",
        help=f"libraries to test: {', '.join(CLIENTS)} (default: all)",
    )
    parser.add_argument(
        "--write", type=Path, metavar="FILE", help="Markdown file whose table to update"
    )
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.libraries if name not in CLIENTS]:
        raise ValueError(f"LIBRARY is {unknown[0]!r}, but must be one of {', '.join(CLIENTS)}")
    failed = False
    with TemporaryDirectory() as wheels:
        wheel = built(Path(wheels))
        for name in options.libraries or CLIENTS:
            with TemporaryDirectory() as folder:
                versions, fault = attempt(name, wheel, Path(folder))
            failed |= fault is not None
            client = CLIENTS[name]
            cells = (
                name,
                *versions,
                client.uses if fault is None else f"fails: {fault}",
                f"`examples.{client.recipe}`",
                datetime.date.today().isoformat(),
            )
            row = f"| {' | '.join(cells)} |"
            print(row, flush=True)
            if options.write is not None:
                text = with_row(options.write.read_text("utf-8"), name, row)
                replace_file(options.write, partial(Path.write_text, data=text, encoding="utf-8"))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
