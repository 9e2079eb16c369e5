"""Optional packages that are not installed: one line that says what to do, or no effect."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WITHOUT = """
import importlib.abc, os, sys

class Without(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == os.environ["WITHOUT"]:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Without())
"""


pytestmark = pytest.mark.slow


@pytest.fixture
def without(tmp_path: Path) -> Path:
    """A folder that hides the package that WITHOUT names from who has it on its path."""
    (tmp_path / "sitecustomize.py").write_text(WITHOUT)
    return tmp_path


def python(without: Path, package: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run Python where a package is missing."""
    variables = os.environ | {
        "WITHOUT": package,
        "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "shop"), str(without))),
    }
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        env=variables,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize(
    ("package", "command"),
    [
        ("torch", "train.ppo --steps 1"),
        ("scipy", "turning_env calibrate shop/examples/cuts.csv --out FILE"),
        (
            "asyncua",
            "turning_control opcua --url opc.tcp://127.0.0.1:1 --nodes FILE --policy programmed",
        ),
        ("optuna", "baselines.tune --trials 1"),
        (
            "matplotlib",
            "leaderboard figure --results leaderboard/results --env RoughTurning-Batch-v0",
        ),
        (
            "onnxruntime",
            "leaderboard run --results FILE --policies "
            "--agents agents/RoughTurning-Batch-v0/batch_casting/ppo-seed0.onnx",
        ),
        (
            "PIL",
            "leaderboard.watch --policy programmed_feed --env RoughTurning-Override-v1 "
            "--steps 1 --out FILE.gif",
        ),
        (
            "pygame",
            "leaderboard.watch --policy programmed_feed --env RoughTurning-Override-v1 "
            "--steps 1 --human",
        ),
    ],
)
def test_what_is_missing_is_said_in_one_line(package: str, command: str, without: Path) -> None:
    finished = python(
        without, package, "-m", *command.replace("FILE", str(without / "film")).split()
    )
    assert finished.returncode == 2, finished.stderr
    (line,) = finished.stderr.splitlines()
    assert line.startswith("error: ")
    assert f"{package} is not installed" in line
    assert "pip install" in line


def test_scoring_an_agent_without_onnxruntime_says_how_to_install_it(without: Path) -> None:
    agent = "agents/RoughTurning-Batch-v0/batch_casting/ppo-seed0.onnx"
    code = f"import turning_env; turning_env.score('{agent}')"
    finished = python(without, "onnxruntime", "-c", code)
    last = finished.stderr.splitlines()[-1]
    assert (
        last == "ModuleNotFoundError: onnxruntime is not installed: "
        "pip install 'rough-turning[onnx]'"
    )


def test_without_torch_rules_are_played(without: Path) -> None:
    words = [
        "-m",
        "leaderboard",
        "run",
        "--env",
        "RoughTurning-Override-v1",
        "--seeds",
        "1",
        "--policies",
        "programmed_feed",
    ]
    assert python(without, "torch", *words, "--results", str(without / "results")).returncode == 0
    assert (without / "results" / "index.html").exists()
