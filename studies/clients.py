"""Test the recipes of other libraries, each in an empty virtual environment with the wheel, its library and PyTorch only.

    python -m studies.clients
    python -m studies.clients skrl tianshou --write docs/ecosystem.md

It needs a package index and 2 GB of disk, and takes some minutes per library. The exit status is 1 if a recipe fails.
"""

import argparse
import datetime
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from studies.wheel import ROOT, built
from turning_env.console import described, exits
from turning_env.files import replace_file

MAX_INSTALL, MAX_RUN = 1800.0, 900.0
"""Time limit of the installation, and of the recipe [s]."""
VERSIONS = "import importlib.metadata as m, json, sys; print(json.dumps([m.version(name) for name in sys.argv[1:]]))"


@dataclass(frozen=True)
class Client:
    """A library and its recipe."""

    library: str
    """Name of the distribution."""
    recipe: str
    """Module in ``examples``."""
    uses: str
    """Description of the recipe for the table."""
    packages: tuple[str, ...]
    arguments: tuple[str, ...] = ("--steps", "5000")


CLIENTS = {
    client.library: client
    for client in (
        Client("tianshou", "tianshou_ppo", "PPO on the batch", ("tianshou",)),
        Client("skrl", "skrl_ppo", "PPO on the batch", ("skrl",)),
        Client("agilerl", "agilerl_ppo", "PPO on the batch", ("agilerl", "peft")),
        Client("ray", "rllib_ppo", "RLlib's PPO on single environments", ("ray[rllib]",)),
        Client("sbx-rl", "sbx_sac", "SAC on the batch", ("sbx-rl",)),
        Client("d3rlpy", "d3rlpy_td3_bc", "TD3+BC on data of Minari", ("d3rlpy", "minari[hdf5]", "pillow"), ("--steps", "500")),
    )
}


def torch_pin() -> str:
    """Return the requirement of torch in constraints.txt, so that libraries are tested with the clone's version."""
    found = re.search(r"^torch==\S+", (ROOT / "constraints.txt").read_text("utf-8"), re.MULTILINE)
    assert found is not None
    return found[0]


def folders_of_wheels() -> list[str]:
    """Return the folders of wheels that pip's settings name, which may hold a build of torch without CUDA."""
    asked = [sys.executable, "-m", "pip", "config", "get", "global.find-links"]
    return subprocess.run(asked, check=False, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True).stdout.split()


def attempt(client: Client, wheel: Path, folder: Path) -> tuple[str, str, str | None]:
    """Install and run a recipe in an empty folder; return the versions of library and Gymnasium, and the failure, if any."""
    python = str(folder / "venv" / ("Scripts" if os.name == "nt" else "bin") / "python")
    install = [str(Path(sys.executable).with_name("uv")), "pip", "install", "--quiet", "--python", python]
    install += [word for wheels in folders_of_wheels() for word in ("--find-links", wheels)]
    shutil.copytree(ROOT / "examples", folder / "examples")
    version, gymnasium, stage = "-", "-", "the installation"
    try:
        subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True)
        subprocess.run([*install, str(wheel), torch_pin(), *client.packages], cwd=folder, check=True, timeout=MAX_INSTALL)
        asked = [python, "-c", VERSIONS, client.library, "gymnasium"]
        version, gymnasium = json.loads(subprocess.run(asked, check=True, stdout=subprocess.PIPE).stdout)
        stage = "the recipe"
        command = [python, "-m", f"examples.{client.recipe}", "--tuning-seeds", "2", *client.arguments]
        subprocess.run(command, cwd=folder, check=True, timeout=MAX_RUN)
    except subprocess.TimeoutExpired as error:
        return version, gymnasium, f"{stage} took more than {error.timeout:.0f} s"
    except subprocess.CalledProcessError as error:
        return version, gymnasium, f"{stage} ended with status {error.returncode}"
    return version, gymnasium, None


def with_row(text: str, library: str, row: str) -> str:
    """Return a Markdown text in which a library's row of the table is replaced.

    Raises:
        ValueError: there is not exactly one such row.
    """
    replaced, count = re.subn(rf"^\| {re.escape(library)} \|.*$", lambda _: row, text, flags=re.MULTILINE)
    if count != 1:
        raise ValueError(f"there must be one table row that begins with | {library} |, but there are {count}")
    return replaced


@exits(OSError, ValueError, checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Test libraries one after the other; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.clients", **described(__doc__))
    parser.add_argument("libraries", nargs="*", metavar="LIBRARY", help=f"libraries to test: {', '.join(CLIENTS)} (default: all)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="Markdown file whose table to update")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.libraries if name not in CLIENTS]:
        raise ValueError(f"LIBRARY is {unknown[0]!r}, but must be one of {', '.join(CLIENTS)}")
    failed = False
    with tempfile.TemporaryDirectory() as wheels:
        wheel = built(Path(wheels))
        for name in options.libraries or CLIENTS:
            client = CLIENTS[name]
            with tempfile.TemporaryDirectory() as folder:
                version, gymnasium, fault = attempt(client, wheel, Path(folder))
            failed |= fault is not None
            what = client.uses if fault is None else f"fails: {fault}"
            cells = (name, version, gymnasium, what, f"`examples.{client.recipe}`", datetime.date.today().isoformat())
            row = f"| {' | '.join(cells)} |"
            print(row, flush=True)
            if options.write is not None:
                text = with_row(options.write.read_text("utf-8"), name, row)
                replace_file(options.write, partial(Path.write_text, data=text, encoding="utf-8"))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
