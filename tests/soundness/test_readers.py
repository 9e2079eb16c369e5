"""A reader gives what a file may hold, or an error of its own, whatever the file holds."""

import json
import lzma
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from baselines import tuned
from leaderboard.agents import agent_file, onnx_policy, sandbox
from tests.soundness.acting import tried
from tests.soundness.readers import READERS, attempt, damages, small_result
from train.curves import Trainings
from train.tune_rules import TrialLog
from turning_env import Family, Scenario, ScenarioError


def tampered() -> bytes:
    """Return a result with another return, so that its checksum no longer matches."""
    values = json.loads(small_result())
    values["results"][0]["episodes"]["return"][0] += 1.0
    return json.dumps(values).encode()


BEYOND = (
    "x = " + "[" * 5_000,
    "x = " + "9" * 5_000,
    "name" + ".a" * 5_000 + " = 1",
    "base = 0x" + "9" * 5_000,
)


@pytest.mark.parametrize("text", BEYOND, ids=range(len(BEYOND)))
def test_a_scenario_file_beyond_python_s_limits_is_a_scenario_error(
    text: str, tmp_path: Path
) -> None:
    (tmp_path / "deep.toml").write_text(text)
    with pytest.raises(ScenarioError, match="deep"):
        Scenario.load(tmp_path / "deep.toml")


@pytest.mark.parametrize("name", READERS)
def test_what_is_valid_is_read(name: str, tmp_path: Path) -> None:
    for content in READERS[name].valid():
        assert READERS[name].check(tmp_path, content) is not None


@pytest.mark.parametrize("name", sorted(READERS.keys() - {"agent"}))  # which also has to act
@tried(short=50, soak=15_000)
@given(st.data())
def test_a_damaged_file_is_read_or_refused(name: str, tmp_path: Path, data: st.DataObject) -> None:
    READERS[name].check(tmp_path, data.draw(damages(READERS[name].valid, READERS[name].suffix)))


@tried(short=40, soak=5_000)
@given(damages(lambda: (tampered(),)), st.booleans())
def test_results_that_were_tampered_with_are_refused(
    tmp_path: Path, content: bytes, compressed: bool
) -> None:
    assert (
        READERS["result"].check(
            tmp_path, lzma.compress(content, preset=0) if compressed else content
        )
        is None
    )


@pytest.mark.slow
@tried(short=20, soak=2_000)
@given(damages(READERS["agent"].valid, ".onnx"))
def test_an_agent_is_read_and_acts_or_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "damaged.onnx"
    path.write_bytes(content)
    agent = attempt(onnx_policy.load, path, ValueError)
    if agent is not None:
        spaces = agent_file.read(path).metadata
        actions = agent.make(2).act(np.zeros((2, len(spaces.observation_space.low)), np.float32))
        assert actions.shape == (2, len(spaces.action_space.low))
        assert np.abs(actions).max() <= 1.0


def to_zero(path: Path) -> None:
    path.symlink_to("/dev/zero")


def to_pipe(path: Path) -> None:
    os.mkfifo(path.with_name("elsewhere"))
    path.symlink_to("elsewhere")


@pytest.mark.parametrize("place", [os.mkfifo, to_zero, to_pipe, Path.mkdir])
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("tuned.json", tuned.read),
        ("learning_curves.json", Trainings.read),
        ("trials.jsonl", lambda path: TrialLog(path, []).read()),
        ("agent.onnx", sandbox.load),
        ("scenario.toml", Scenario.load),
        ("family.toml", Family.load),
    ],
)
def test_no_reader_waits_for_what_is_no_regular_file(
    name: str,
    read: Callable[[Path], object],
    place: Callable[[Path], object],
    tmp_path: Path,
) -> None:
    place(tmp_path / name)
    reason = "must be a regular file|no file is called"
    with pytest.raises((ValueError, OSError), match=reason) as refusal:
        read(tmp_path / name)
    assert str(tmp_path / name) in str(refusal.value)
