"""Words, new fields and new controllers change no identity.

They are tried on a copy of the repository.
"""

import sys
from pathlib import Path

import pytest

from tests.walking import Smaller, blocks, copy_to, run, walk, write_or_change

pytestmark = pytest.mark.slow

CHECK = """
from pathlib import Path
from baselines import tuned
from leaderboard.agents import agent_file
from turning_env import Family, Scenario

for path in sorted(tuned.FOLDER.glob("*.json")):
    assert tuned.contents(Scenario.load(path.stem)) == tuned.read(path), path
for path in sorted(Path("agents").glob("*/*/*.onnx")):
    metadata = agent_file.read(path).metadata
    family = metadata.parameters.get("family")
    if family:
        assert metadata.scenario == Family.load(family).job(0).scenario, path
    else:
        assert metadata.scenario == Scenario.load(metadata.scenario.name), path
"""
"""Program that finds every tuning and agent of the scenarios that ship."""

SOME_TESTS = Smaller("-k 'vibration or RoughTurning-v0 or worn_batch'")
PLAYED_ELSEWHERE = (
    # tests/test_pages.py runs these.
    "python -m train.tune rules",
    "python -m leaderboard run",
    # The test runs it itself, after the changes of all pages.
    "python -m leaderboard verify --check",
)


@pytest.fixture
def copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a copy of the repository, which is run interpreted.

    Compiling takes longer than playing a change once.
    """
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    copy_to(tmp_path)
    return tmp_path


def edit(path: Path, old: str, new: str) -> None:
    """Replace the first place of a text in a file."""
    text = path.read_text("utf-8")
    assert old in text, f"{path} holds no {old!r}"
    path.write_text(text.replace(old, new, 1), "utf-8")


def printed_by(copy: Path, *arguments: str) -> str:
    """Run Python in the copy; return what it printed."""
    finished = run([sys.executable, *arguments], copy)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    return finished.stdout


def test_words_and_additions_by_the_recipes_invalidate_nothing(copy: Path) -> None:
    """Follow the recipes word for word.

    Each tutorial runs its own test and the golden trajectories, and the algorithm of CONTRIBUTING
    trains for some steps. ``verify --check`` follows at the end.
    """
    edit(copy / "turning_env" / "physics" / "wear.py", '"""', '"""Edited. ')
    edit(copy / "baselines" / "fixed.py", '"""', '"""Edited. ')
    for page in ("change_the_lathe", "add_a_controller"):
        text = (copy / "docs" / "tutorials" / f"{page}.md").read_text("utf-8")
        walk(text, copy, {"python -m pytest": SOME_TESTS}, PLAYED_ELSEWHERE)

    for block in blocks((copy / "CONTRIBUTING.md").read_text("utf-8")):
        if block.title is not None:
            write_or_change(copy / block.title, block)

    printed_by(copy, "-c", CHECK)
    verified = printed_by(copy, "-m", "leaderboard", "verify", "--check")
    assert "every result is valid" in verified

    rules = printed_by(copy, "-c", "from baselines.catalogue import RULES; print(*RULES)")
    assert "steady_load" in rules.split()
    trained = printed_by(copy, "-m", "train.a2c", "--total-timesteps", "64", "--set", "num_envs=4")
    assert "a2c-seed0" in trained
    scenario = printed_by(copy, "-m", "turning_env", "show", "rough_turning")
    assert "vibration_gain" in scenario
    assert "torque = false" in scenario
