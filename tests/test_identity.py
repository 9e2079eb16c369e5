"""Words, new fields and new controllers change no identity; tried on a copy of the repository."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.walking import copy_to, run, walk

pytestmark = pytest.mark.slow

CHECK = """
from pathlib import Path
from baselines import tuned
from train.agents import agent_file
from turning_env import Family, Scenario

for path in sorted(tuned.FOLDER.glob("*.json")):
    assert tuned.contents(Scenario.load(path.stem)) == tuned.read(path), path
for path in sorted(Path("agents").glob("*/*/*.onnx")):
    metadata = agent_file.read(path).metadata
    family = metadata.parameters.get("family")
    assert metadata.scenario == (Family.load(family).job(0).scenario if family else Scenario.load(metadata.scenario.name)), path
"""


@pytest.fixture
def copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the repository, run interpreted: nothing has to be compiled for a change that is tried once."""
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    copy_to(tmp_path)
    return tmp_path


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text("utf-8")
    assert old in text, f"{path} holds no {old!r}"
    path.write_text(text.replace(old, new, 1), "utf-8")


def python(copy: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    return run([sys.executable, *arguments], copy)


def test_words_fields_controllers_disturbances_and_entries_invalidate_nothing(copy: Path) -> None:
    """The recipes, followed word for word: each page runs its own test, the golden trajectories and ``verify --check``."""
    edit(copy / "turning_env" / "physics" / "wear.py", '"""', '"""Edited. ')
    edit(copy / "baselines" / "fixed.py", '"""', '"""Edited. ')
    for page in ("change_the_lathe", "add_a_controller"):
        text = (copy / "docs" / "tutorials" / f"{page}.md").read_text("utf-8")
        plays = (
            "python -m baselines.tune",
            "python -m leaderboard run",
        )  # tests/test_pages.py runs these
        walk(
            text,
            copy,
            {"python -m pytest": ("-k 'vibration or RoughTurning-v0 or worn_batch'", {})},
            plays,
        )
    checked = python(copy, "-c", CHECK)
    assert checked.returncode == 0, checked.stderr
    verified = python(copy, "-m", "leaderboard", "verify", "--check")
    assert verified.returncode == 0, verified.stdout + verified.stderr
    assert "every result is valid" in verified.stdout
    assert (
        "steady_load"
        in python(copy, "-c", "from baselines.catalogue import RULES; print(*RULES)").stdout
    )
    changed = python(copy, "-m", "turning_env", "show", "rough_turning").stdout
    assert "vibration_gain" in changed
    assert "torque = false" in changed
