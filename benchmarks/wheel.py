"""Builds the wheel, installs it into an empty environment, with nothing but what it asks for, and tries every task there.

All files that are installed are compared with the hashes of constraints.txt. Takes a minute or two, most of it compiling. The
exit status is 1 if anything fails.

    python -m benchmarks.wheel
    python -m benchmarks.wheel --constraints constraints.txt
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import venv
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

from turning_env.console import described, exits

ROOT = Path(__file__).resolve().parents[1]
SMOKE = Path(__file__).with_name("smoke.py")
TRY = "import runpy, sys; runpy.run_path(sys.argv[1])['main']()"
"""Runs a file without having its folder searched for modules."""


def installer(constraints: str) -> str:
    """The lines of a constraints file that pin pip: an older one would not look for hashes in constraints."""
    found = re.search(r"^pip==(.*\\\n)*.*\n", constraints, re.MULTILINE)
    if found is None:
        raise ValueError("the constraints do not pin pip")
    return found[0]


def tried(folder: Path, constraints: Path) -> bool:
    """Whether the wheel, built, installed and played in an empty folder, passes all."""
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder], cwd=ROOT, check=True)
    (wheel,) = folder.glob("*.whl")
    venv.create(folder / "venv", with_pip=True)
    python = str(folder / "venv" / ("Scripts" if os.name == "nt" else "bin") / "python")
    pip = [python, "-m", "pip", "--disable-pip-version-check", "--quiet"]
    (folder / "pip.txt").write_text(installer(constraints.read_text("utf-8")), "utf-8")
    (folder / "wheel.txt").write_text(f"{wheel} --hash=sha256:{sha256(wheel.read_bytes()).hexdigest()}\n", "utf-8")
    (folder / "empty").mkdir()
    commands = (
        [*pip, "install", "-r", str(folder / "pip.txt")],
        [*pip, "install", "--only-binary", ":all:", "-c", str(constraints.resolve()), "-r", str(folder / "wheel.txt")],
        [python, "-m", "pip", "list"],
        [python, "-m", "pip", "check"],
        [python, "-I", "-W", "error", "-c", TRY, str(SMOKE)],
        [python, "-I", "-m", "turning_env", "presets"],
    )
    return all(subprocess.run(command, cwd=folder / "empty").returncode == 0 for command in commands)


@exits(ValueError, checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Build, install and try; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.wheel", **described(__doc__))
    parser.add_argument("--constraints", type=Path, default=ROOT / "constraints.txt", help="default: that of the clone")
    parsed = parser.parse_args(arguments)
    installer(parsed.constraints.read_text("utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        return 0 if tried(Path(folder), parsed.constraints) else 1


if __name__ == "__main__":
    sys.exit(main())
