"""Build the wheels, install them into an empty virtual environment, and play every task there.

It compares all installed files with the hashes in packaging/constraints.txt. Presets must play as
in the clone, bit for bit. The first Python also tries the oldest and the newest Gymnasium, each
with Stable-Baselines3, and the commands of the shop. Each Python takes a minute or two, mostly for
compiling. The exit status is 1 if anything fails.

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
import leaderboard
import numpy as np
policy = lambda observations: np.zeros((len(observations), 1))
print(leaderboard.score(policy, "RoughTurning-Override-v1", seeds=4))
"""
SHOP_FILES = ("cuts.csv", "programs/flange.nc")
"""Examples of the shop that its commands read."""
SHOP_COMMANDS = (
    "advise --material 42CrMo4 --tool CNMG120408-PM --grade P25 --stock 80x200 --depth 2 "
    "--out start.toml",
    "map start.toml --wear 0.2 --out map.png",
    "program flange.nc --scenario start.toml --stock tube:120x20x32+5 --tool T0303=inside",
    "calibrate cuts.csv --base start.toml --out my_tool.toml",
    "advise my_tool.toml --seeds 0",
)
"""Commands of the shop (``shop/README.md``), in order."""


def built(folder: Path, project: Path = ROOT) -> Path:
    """Build the wheel of a distribution into a folder without others and return its path.

    Raises:
        subprocess.CalledProcessError: it cannot be built.
    """
    subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder],
        cwd=project,
        check=True,
    )
    (wheel,) = folder.glob("*.whl")
    return wheel


def new_python(folder: Path, python: str = sys.executable) -> str:
    """Make a virtual environment in a folder and return its Python."""
    subprocess.run([python, "-m", "venv", folder / "venv"], check=True)
    return str(folder / "venv" / ("Scripts" if os.name == "nt" else "bin") / "python")


class Environment:
    """A virtual environment, whose Python runs in an empty folder.

    Args:
        folder: folder for both, and for files of requirements.
        python: interpreter of which it is made.
    """

    def __init__(self, folder: Path, python: str) -> None:
        self.folder = folder
        self.empty = folder / "empty"
        self.empty.mkdir()
        self.python = new_python(folder, python)

    def run(self, *words: str) -> None:
        """Run Python with arguments."""
        subprocess.run([self.python, *words], cwd=self.empty, check=True)

    def install(self, *words: str) -> None:
        """Run ``pip install`` with arguments."""
        self.run("-m", "pip", "--disable-pip-version-check", "--quiet", "install", *words)

    def install_pinned(self, wheel: Path, constraints: str) -> None:
        """Install a wheel; compare all files with the hashes of the constraints."""
        digest = sha256(wheel.read_bytes()).hexdigest()
        texts = {
            "pip.txt": _pip(constraints),  # an older pip ignores hashes in constraints
            "wheel.txt": f"{wheel} --hash=sha256:{digest}\n",
            "constraints.txt": constraints,
        }
        for name, text in texts.items():
            (self.folder / name).write_text(text, "utf-8")
        self.install("-r", str(self.folder / "pip.txt"))
        constrained = ("--only-binary", ":all:", "-c", str(self.folder / "constraints.txt"))
        self.install(*constrained, "-r", str(self.folder / "wheel.txt"))

    def play(self) -> str:
        """Play every task and return the digest of the trajectories."""
        smoke = [self.python, "-I", "-W", "error", "-c", SMOKE, str(ROOT / "tools" / "smoke.py")]
        finished = subprocess.run(
            smoke, cwd=self.empty, check=True, stdout=subprocess.PIPE, text=True
        )
        print(finished.stdout, end="", flush=True)
        return finished.stdout.rpartition(DIGEST)[2].strip()


def digests(wheel: Path, constraints: str, python: str) -> set[str]:
    """Install the wheel for a Python, with pinned requirements; return the digest of plays."""
    with TemporaryDirectory() as name:
        environment = Environment(Path(name), python)
        return {_installed(environment, wheel, constraints)}


def digests_with_others(
    wheel: Path, shop: Path, constraints: str, python: str, gymnasiums: Sequence[str]
) -> set[str]:
    """Do as ``digests``, then try what is installed beside the wheel; return all digests.

    Args:
        wheel: of the benchmark.
        shop: wheel of the shop.
        constraints: pinned versions, with hashes.
        python: interpreter.
        gymnasiums: versions of Gymnasium to play with, beside the pinned one.
    """
    with TemporaryDirectory() as name:
        environment = Environment(Path(name), python)
        plays = {_installed(environment, wheel, constraints)}
        others = re.findall(r"^(?!gymnasium=)[\w.-]+==[^\\\n]+", constraints, re.MULTILINE)
        pins = environment.folder / "others.txt"
        pins.write_text("\n".join(others), "utf-8")
        upgrade = ("--only-binary", ":all:", "-c", str(pins), "--upgrade")
        for version in gymnasiums:
            print(f"with {version}:", flush=True)
            environment.install(*upgrade, version)
            plays.add(environment.play())
        for version in reversed(gymnasiums):  # the newest is installed
            environment.install(*upgrade, "--no-compile", version, "stable-baselines3")
            environment.run("-I", "-c", TRAIN)
            print(f"Stable-Baselines3 with {version}: trained", flush=True)
        # Its requirement, the benchmark's wheel, is installed.
        environment.install("--only-binary", ":all:", "-c", str(pins), f"{shop}[programs]")
        environment.run("-m", "pip", "check")
        for path in SHOP_FILES:
            shutil.copy(ROOT / "shop" / "examples" / path, environment.empty)
        for command in SHOP_COMMANDS:
            environment.run("-I", "-m", "turning_shop", *command.split())
        return plays


def _installed(environment: Environment, wheel: Path, constraints: str) -> str:
    """Install the wheel into an environment, try it there, and return the digest of plays."""
    environment.install_pinned(wheel, constraints)
    for command in ("-m pip list", "-m pip check", "-I -m turning_env show"):
        environment.run(*command.split())
    environment.run("-I", "-c", SCORE)
    return environment.play()


def _pip(constraints: str) -> str:
    """Return the lines of a constraints file that pin pip."""
    pin = re.search(r"^pip==(.*\\\n)*.*\n", constraints, re.MULTILINE)
    if pin is None:
        raise ValueError("the constraints do not pin pip")
    return pin[0]


@exits(ValueError, checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Build, install and play; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.wheel", **described(__doc__))
    parser.add_argument(
        "--python",
        nargs="+",
        default=[sys.executable],
        help="interpreters to test (default: this one)",
    )
    parsed = parser.parse_args(arguments)
    constraints = (ROOT / "packaging" / "constraints.txt").read_text("utf-8")
    _pip(constraints)
    for python in parsed.python:
        if shutil.which(python) is None:
            raise ValueError(f"--python {python}: there is no such program")
    faults = []
    with TemporaryDirectory() as name:
        expected = digest_of_plays()
        folder = Path(name)
        wheel = built(folder / "benchmark")
        shop = built(folder / "shop", ROOT / "shop")
        for number, python in enumerate(parsed.python):
            try:
                # The first interpreter also tries what is installed beside the wheel.
                if number == 0:
                    plays = digests_with_others(wheel, shop, constraints, python, GYMNASIUMS)
                else:
                    plays = digests(wheel, constraints, python)
            except subprocess.CalledProcessError as error:
                faults.append(f"{python}: {error.cmd[0]} ended with status {error.returncode}")
                continue
            if plays != {expected}:
                faults.append(f"{python}: the same actions give other numbers than in the clone")
    print(*faults, sep="\n", end="\n" if faults else "", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
