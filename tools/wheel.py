"""Build the wheel, install it into an empty virtual environment, and play every task there.

It compares all installed files with the hashes in packaging/constraints.txt. Presets must play as
in the clone, bit for bit. The first Python also tries the oldest and the newest Gymnasium, each
with Stable-Baselines3. Each Python takes a minute or two, mostly for compiling. The exit status is
1 if anything fails.

    python -m tools.wheel
    python -m tools.wheel --python python3.12 python3.13
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

from tools.smoke import DIGEST, digest_of_plays
from turning_env.console import described, exits

ROOT = Path(__file__).resolve().parents[1]
GYMNASIUMS = (
    "gymnasium==1.1.1",
    "gymnasium<2",
)  # the oldest and the newest Gymnasium that pyproject.toml allows
SMOKE = "import runpy, sys; runpy.run_path(sys.argv[1])['main']()"
"""Code that runs a file without adding its folder to the module search path."""
TRAIN = """
import turning_env
from stable_baselines3 import SAC
from stable_baselines3.common.env_util import make_vec_env
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
vector = make_vec_env("RoughTurning-v0", 4)
batch = RoughTurningVecEnv("rough_turning", 4)
for env in ("RoughTurning-v0", vector, batch):
    SAC("MlpPolicy", env, learning_starts=8).learn(16)
"""
SCORE = """
import numpy as np, turning_env
policy = lambda observations: np.zeros((len(observations), 1))
print(turning_env.score(policy, "RoughTurning-Override-v1", seeds=4))
"""


def built(folder: Path) -> Path:
    """Build the wheel into a folder and return its path.

    Raises:
        subprocess.CalledProcessError: it cannot be built.
    """
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder],
        cwd=ROOT,
        check=True,
    )
    (wheel,) = folder.glob("*.whl")
    return wheel


def new_python(folder: Path, python: str = sys.executable) -> str:
    """Make a virtual environment in a folder and return its Python."""
    subprocess.run([python, "-m", "venv", folder / "venv"], check=True)
    return str(folder / "venv" / ("Scripts" if os.name == "nt" else "bin") / "python")


def digests(wheel: Path, constraints: str, python: str, gymnasiums: Sequence[str]) -> set[str]:
    """Install the wheel for a Python, with pinned requirements; return the digests of plays.

    ``gymnasiums``: versions to play with, beside the pinned one.
    """
    with TemporaryDirectory() as name:
        folder, empty = Path(name), Path(name) / "empty"
        empty.mkdir()
        inside, found = new_python(folder, python), set()
        requirements = {
            "pip.txt": _pip(constraints),  # an older pip ignores hashes in constraints
            "wheel.txt": f"{wheel} --hash=sha256:{sha256(wheel.read_bytes()).hexdigest()}\n",
            "constraints.txt": constraints,
            "others.txt": "\n".join(
                re.findall(r"^(?!gymnasium=)[\w.-]+==[^\\\n]+", constraints, re.MULTILINE)
            ),
        }
        for file, text in requirements.items():
            (folder / file).write_text(text, "utf-8")

        def run(*words: str) -> None:
            subprocess.run([inside, *words], cwd=empty, check=True)

        def install(*words: str) -> None:
            run("-m", "pip", "--disable-pip-version-check", "--quiet", "install", *words)

        def play() -> None:
            smoke = [inside, "-I", "-W", "error", "-c", SMOKE, str(ROOT / "tools" / "smoke.py")]
            said = subprocess.run(
                smoke, cwd=empty, check=True, stdout=subprocess.PIPE, text=True
            ).stdout
            print(said, end="", flush=True)
            found.add(said.rpartition(DIGEST)[2].strip())

        install("-r", f"{folder / 'pip.txt'}")
        install(
            "--only-binary",
            ":all:",
            "-c",
            f"{folder / 'constraints.txt'}",
            "-r",
            f"{folder / 'wheel.txt'}",
        )
        for command in ("-m pip list", "-m pip check", "-I -m turning_env presets"):
            run(*command.split())
        run("-I", "-c", SCORE)
        play()
        upgrade = ("--only-binary", ":all:", "-c", f"{folder / 'others.txt'}", "--upgrade")
        for version in gymnasiums:
            print(f"with {version}:", flush=True)
            install(*upgrade, version)
            play()
        for version in reversed(gymnasiums):  # the newest is installed
            install(*upgrade, "--no-compile", version, "stable-baselines3")
            run("-I", "-c", TRAIN)
            print(f"Stable-Baselines3 with {version}: trained", flush=True)
        return found


def _pip(constraints: str) -> str:
    """Return the lines of a constraints file that pin pip."""
    found = re.search(r"^pip==(.*\\\n)*.*\n", constraints, re.MULTILINE)
    if found is None:
        raise ValueError("the constraints do not pin pip")
    return found[0]


@exits(ValueError, checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Build, install and play; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.wheel", **described(__doc__))
    pins = "file of pinned versions (default: that of the clone)"
    parser.add_argument(
        "--constraints", type=Path, default=ROOT / "packaging" / "constraints.txt", help=pins
    )
    parser.add_argument(
        "--python",
        nargs="+",
        default=[sys.executable],
        help="interpreters to test (default: this one)",
    )
    parsed = parser.parse_args(arguments)
    constraints = parsed.constraints.read_text("utf-8")
    _pip(constraints)
    for python in parsed.python:
        if shutil.which(python) is None:
            raise ValueError(f"--python {python}: there is no such program")
    faults = []
    with TemporaryDirectory() as folder:
        expected, wheel = digest_of_plays(), built(Path(folder))
        for number, python in enumerate(parsed.python):
            try:
                if digests(wheel, constraints, python, () if number else GYMNASIUMS) != {expected}:
                    faults.append(
                        f"{python}: the same actions give other numbers than in the clone"
                    )
            except subprocess.CalledProcessError as error:
                faults.append(f"{python}: {error.cmd[0]} ended with status {error.returncode}")
    print(*faults, sep="\n", end="\n" if faults else "", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
