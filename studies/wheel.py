"""Build the wheel, install it with its requirements into an empty virtual environment, and play every task there.

It compares all installed files with the hashes in constraints.txt. Presets must play as in the clone, bit for bit. The first
Python also tries the oldest and the newest Gymnasium, each with Stable-Baselines3. Each Python takes a minute or two, mostly for
compiling. The exit status is 1 if anything fails.

    python -m studies.wheel
    python -m studies.wheel --python python3.12 python3.13
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path

from studies.smoke import DIGEST, digest_of_plays
from turning_env.console import described, exits

ROOT = Path(__file__).resolve().parents[1]
SMOKE = Path(__file__).with_name("smoke.py")
TRY = "import runpy, sys; runpy.run_path(sys.argv[1])['main']()"
"""Python code that runs a file without adding its folder to the module search path."""

GYMNASIUMS = ("gymnasium==1.1.1", "gymnasium<2")
"""The oldest and the newest Gymnasium that pyproject.toml allows."""
BASELINES = """
import turning_env
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
for env in ("RoughTurning-v0", make_vec_env("RoughTurning-v0", 4), RoughTurningVecEnv("rough_turning", 4)):
    SAC("MlpPolicy", env, learning_starts=8).learn(16)
"""


SCORE = """
import numpy as np, turning_env
print(turning_env.score(lambda observations: np.zeros((len(observations), 1)), "RoughTurning-Override-v0", seeds=4))
"""


def installer(constraints: str) -> str:
    """Return the lines of a constraints file that pin pip; an older pip ignores hashes in constraints."""
    found = re.search(r"^pip==(.*\\\n)*.*\n", constraints, re.MULTILINE)
    if found is None:
        raise ValueError("the constraints do not pin pip")
    return found[0]


def built(folder: Path) -> Path:
    """Build the wheel into a folder and return its path.

    Raises:
        subprocess.CalledProcessError: it cannot be built.
    """
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder], cwd=ROOT, check=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


def venv_python(folder: Path, python: str) -> str:
    """Make a virtual environment in a folder and return its Python."""
    subprocess.run([python, "-m", "venv", folder / "venv"], check=True)
    (folder / "empty").mkdir()
    return str(folder / "venv" / ("Scripts" if os.name == "nt" else "bin") / "python")


def digest_of(python: str, folder: Path) -> str:
    """Play the installed wheel with a Python in a folder, and return the digest."""
    smoke = [python, "-I", "-W", "error", "-c", TRY, str(SMOKE)]
    said = subprocess.run(smoke, cwd=folder / "empty", check=True, stdout=subprocess.PIPE, text=True).stdout
    print(said, end="")
    return said.rpartition(DIGEST)[2].strip()


def pinned(folder: Path, wheel: Path, constraints: Path, python: str) -> str:
    """Install the wheel with its pinned requirements in an empty folder with any Python; return the new environment's Python.

    Raises:
        subprocess.CalledProcessError: it cannot be installed, or something fails there.
    """
    python = venv_python(folder, python)
    pip = [python, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    (folder / "pip.txt").write_text(installer(constraints.read_text("utf-8")), "utf-8")
    (folder / "wheel.txt").write_text(f"{wheel} --hash=sha256:{sha256(wheel.read_bytes()).hexdigest()}\n", "utf-8")
    commands = (
        [*pip, "install", "-r", str(folder / "pip.txt")],
        [*pip, "install", "--only-binary", ":all:", "-c", str(constraints.resolve()), "-r", str(folder / "wheel.txt")],
        [python, "-m", "pip", "list"],
        [python, "-m", "pip", "check"],
        [python, "-I", "-m", "turning_env", "presets"],
        [python, "-I", "-c", SCORE],
    )
    for command in commands:
        subprocess.run(command, cwd=folder / "empty", check=True)
    return python


def digests_by_gymnasium(folder: Path, constraints: Path, python: str) -> Iterator[str]:
    """Put each of ``GYMNASIUMS`` in place of the pinned one, and train with Stable-Baselines3; yield the digests.

    Raises:
        subprocess.CalledProcessError: it cannot be installed, or something fails there.
    """
    pins = re.findall(r"^(?!gymnasium=)[\w.-]+==[^\\\n]+", constraints.read_text("utf-8"), re.MULTILINE)
    (folder / "pins.txt").write_text("\n".join(pins), "utf-8")
    install = [python, "-m", "pip", "--disable-pip-version-check", "--quiet", "install", "--only-binary", ":all:"]
    install += ["-c", str(folder / "pins.txt"), "--upgrade"]
    for gymnasium in GYMNASIUMS:
        print(f"with {gymnasium}:", flush=True)
        subprocess.run([*install, gymnasium], cwd=folder / "empty", check=True)
        yield digest_of(python, folder)
    # Backwards, because the newest is installed; the library's own warnings are ignored.
    for gymnasium in reversed(GYMNASIUMS):
        subprocess.run([*install, "--no-compile", gymnasium, "stable-baselines3"], cwd=folder / "empty", check=True)
        subprocess.run([python, "-I", "-c", BASELINES], cwd=folder / "empty", check=True)
        print(f"Stable-Baselines3 with {gymnasium}: trained", flush=True)


def fault(wheel: Path, constraints: Path, python: str, by_gymnasium: bool, expected: str) -> str | None:
    """Return why the wheel fails or misses the expected digest with a Python; None if it passes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            inside = pinned(folder, wheel, constraints, python)
            found = {digest_of(inside, folder)}
            if by_gymnasium:
                found |= set(digests_by_gymnasium(folder, constraints, inside))
        except subprocess.CalledProcessError as error:
            return f"{error.cmd[0]} ended with status {error.returncode}"
    return None if found == {expected} else "the same actions give other numbers than in the clone"


@exits(ValueError, checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Build, install and play; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.wheel", **described(__doc__))
    parser.add_argument(
        "--constraints", type=Path, default=ROOT / "constraints.txt", help="file of pinned versions (default: that of the clone)"
    )
    parser.add_argument("--python", nargs="+", default=[sys.executable], help="interpreters to test (default: this one)")
    parsed = parser.parse_args(arguments)
    installer(parsed.constraints.read_text("utf-8"))
    for python in parsed.python:
        if shutil.which(python) is None:
            raise ValueError(f"--python {python}: there is no such program")
    expected = digest_of_plays()
    with tempfile.TemporaryDirectory() as folder:
        try:
            wheel = built(Path(folder))
        except subprocess.CalledProcessError as error:
            print(f"the wheel cannot be built: status {error.returncode}", file=sys.stderr)
            return 1
        found = {
            python: fault(wheel, parsed.constraints, python, number == 0, expected) for number, python in enumerate(parsed.python)
        }
    faults = {python: what for python, what in found.items() if what}
    for python, what in faults.items():
        print(f"{python}: {what}", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
