"""A stranger's network runs in a process of its own, within limits; its answers are checked."""

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from leaderboard.agents import agent_file, onnx_policy, sandbox
from leaderboard.agents.network import StrictNetwork, act_checked
from leaderboard.agents.onnx_session import OnnxPolicy, session_of
from leaderboard.agents.sandbox import (
    LIMITS,
    AgentFileError,
    AgentTimeoutError,
    GuardedPolicy,
    ProcessLimits,
    Sandbox,
)
from tests.leaderboard.agents import onnx_agents

NUM_ENVS = 6
linux = pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")


def observations(steps: int, num_envs: int = NUM_ENVS) -> NDArray[np.float32]:
    return np.random.default_rng(1).uniform(-1, 1, (steps, num_envs, 11)).astype(np.float32)


def guarded(
    content: bytes, num_envs: int = NUM_ENVS, limits: ProcessLimits = LIMITS
) -> GuardedPolicy:
    return GuardedPolicy(Sandbox(content, limits, strict=True), num_envs)


@pytest.mark.slow
@pytest.mark.parametrize("memory", [False, True])
def test_it_acts_there_bit_for_bit_as_here(memory: bool) -> None:
    content = onnx_agents.content(memory)
    memory_size = agent_file.checked(content).memory_size
    policy = OnnxPolicy(session_of(content), memory_size, NUM_ENVS)
    guarded_policy = guarded(content)
    for step, seen in enumerate(observations(80)):
        if step % 7 == 0:
            mask = np.arange(NUM_ENVS) == step % NUM_ENVS
            policy.reset(mask)
            guarded_policy.reset(mask)
        actions = guarded_policy.act(seen)
        assert actions.tobytes() == policy.act(seen).tobytes()
        actions[:] = 0.0  # they are the caller's own


@pytest.mark.slow
def test_a_file_is_looked_at_and_tried_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*arguments: object) -> None:
        raise AssertionError("a stranger's file was looked into by this process")

    path = onnx_agents.write(tmp_path, memory=True)
    expected = agent_file.read(path)
    for name in (
        "onnx.load_model_from_string",
        "onnx.checker.check_model",
        "onnxruntime.InferenceSession",
    ):
        monkeypatch.setattr(name, never)
    agent = onnx_policy.load(path)
    assert agent.sha256 == expected.digest
    assert agent.trained_on == expected.metadata.scenario
    assert agent.make(2).act(np.zeros((2, 11), np.float32)).shape == (2, 2)


@pytest.mark.slow
@linux
def test_its_process_holds_no_variables_and_no_files_of_this_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("SECRET", "private seeds")
    policy = guarded(onnx_agents.named("plain"))
    place = Path(f"/proc/{policy.sandbox.process.pid}")
    assert b"SECRET" not in (place / "environ").read_bytes()
    assert sorted(int(path.name) for path in (place / "fd").iterdir()) == [0, 1, 2]
    # ONNX Runtime could note down how it is used, and tell: a file and a thread more.
    assert len(list((place / "task").iterdir())) == 1
    limits = {
        line[:20].strip(): line[26:].split()[0]
        for line in (place / "limits").read_text().splitlines()
    }
    for none in ("Max open files", "Max file size", "Max core file size", "Max processes"):
        assert limits[none] == "0"
    # Ten minutes, and 3 GiB.
    assert limits["Max cpu time"] == "600"
    assert limits["Max address space"] == str(3 * 2**30)


@linux
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "num_envs", "limits", "message"),
    [
        ("toiling", 2, ProcessLimits(answer=1.0), "gives no answer within 1 s"),
        (
            "toiling",
            2,
            ProcessLimits(computing=1),
            "needs more than the 1 s of processor time that it may have",
        ),
        ("swelling", 100, ProcessLimits(memory=400), r"lloc|memory"),
    ],
    ids=["time", "processor time", "memory"],
)
def test_limits_are_enforced(name: str, num_envs: int, limits: ProcessLimits, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        guarded(onnx_agents.named(name), num_envs, limits).act(observations(1, num_envs)[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("sociable", "an environment's actions or memory depend on the other environments"),
        ("counting", "an environment's actions or memory depend on the other environments"),
        ("few", "gives 1 actions and . memories for . environments"),
    ],
)
def test_what_looks_at_other_environments_is_refused(
    name: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "agent.onnx").write_bytes(onnx_agents.named(name))
    with pytest.raises(ValueError, match=message):
        onnx_policy.load(tmp_path / "agent.onnx")


@pytest.mark.slow
def test_actions_out_of_bounds_are_refused_while_playing() -> None:
    policy = guarded(onnx_agents.named("unbounded"), 2)
    given = observations(1, 2)[0]
    policy.act(given)
    with pytest.raises(
        ValueError, match=r"acts \[\[.*2.97.*\]\], which are not 2 actions of 2 numbers in -1 to 1"
    ):
        policy.act(3.0 * np.ones_like(given))


class Fickle:
    """A session that acts at random, which the allowed operators cannot."""

    def __init__(self) -> None:
        self._generator = np.random.default_rng(0)

    def run(self, names: None, fed: dict[str, NDArray[np.float32]]) -> list[NDArray[np.float32]]:
        shape = len(fed["observation"]), 2
        return [self._generator.uniform(-1, 1, shape).astype(np.float32)]

    def get_outputs(self) -> list[object]:
        return [type("Output", (), {"name": "action"})]


def test_the_first_actions_and_one_in_32_of_the_others_are_checked() -> None:
    network = StrictNetwork()
    network.read(onnx_agents.content(False))
    network.session()
    policy = OnnxPolicy(Fickle(), 0, 1)
    given = observations(1, 1)[0]
    checked = []
    for call in range(3_202):
        try:
            network.act(policy, given, call)
        except ValueError:
            checked.append(call)
    assert checked[:2] == [0, 1]
    # 100 of 3,200 are expected, with a standard deviation of 10.
    assert 50 < len(checked[2:]) < 150


def test_actions_that_differ_for_the_same_observations_are_refused() -> None:
    with pytest.raises(ValueError, match="gives other actions for the same observations"):
        act_checked(OnnxPolicy(Fickle(), 0, 2), observations(1, 2)[0], np.random.default_rng())


@pytest.mark.slow
def test_wrong_observations_do_not_even_travel() -> None:
    policy = guarded(onnx_agents.named("plain"))
    for wrong in (
        np.zeros((NUM_ENVS, 12), np.float32),
        np.zeros((NUM_ENVS, 11)),
        np.zeros((1, 11), np.float32),
    ):
        with pytest.raises(ValueError, match=r"must be float32 of shape \(6, 11\)"):
            policy.act(wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="the mask must be bool"):
        policy.reset(np.ones(NUM_ENVS - 1, np.bool_))
    assert policy.act(observations(1)[0]).shape == (NUM_ENVS, 2)


@pytest.mark.slow
def test_a_process_that_dies_is_an_error() -> None:
    policy = guarded(onnx_agents.named("plain"))
    os.kill(policy.sandbox.process.pid, signal.SIGKILL)
    with pytest.raises(ValueError, match=r"its process has ended \(status -9\)"):
        policy.act(observations(1)[0])


@pytest.mark.slow
def test_a_process_ends_with_its_policy() -> None:
    policy = guarded(onnx_agents.named("plain"))
    process = policy.sandbox.process
    assert process.poll() is None
    del policy
    assert process.poll() is not None


LIES = {
    "silence": ("", "its process has ended"),
    # A description may have 7,000,000 bytes. More of them are not read.
    "too much": (
        "send(b'K', 7_000_001); wire.settimeout(0.3); wire.sendall(bytes(7_000_001))",
        "its process has ended",
    ),
    "another kind": ("send(b'Z', 0)", "sends an answer of the wrong kind or length"),
    "no outline": (
        "send(b'K', 3); wire.sendall(b'{}x')",
        "describes itself in a form that cannot be read",
    ),
    "another outline": (
        'send(b\'K\', 47); wire.sendall(b\'{"properties": {}, "inputs": {}, "outputs": {}}  \')',
        "must have the input observation and the output action",
    ),
    "a terminal's commands": ("send(b'E', 9); wire.sendall(b'\\x1b[2Jgone\\n')", r"^\?\[2Jgone\?$"),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_process_that_lies_is_not_believed(lie: str) -> None:
    answer, message = LIES[lie]
    program = "import socket, struct; wire = socket.socket(fileno=0); wire.recv(5)\n"
    program += "send = lambda kind, length: wire.sendall(struct.pack('<cQ', kind, length))\n"
    program += answer
    with pytest.raises(ValueError, match=message):
        Sandbox(b"content", strict=True, program=program)


def test_a_process_that_does_not_answer_is_ended() -> None:
    program = "import time; time.sleep(100.0)"
    with pytest.raises(AgentTimeoutError, match=r"gives no answer within 0\.2 s"):
        Sandbox(b"content", ProcessLimits(start=0.2), program=program)


def test_links_pipes_devices_and_folders_are_no_files(tmp_path: Path) -> None:
    path = onnx_agents.write(tmp_path)
    (tmp_path / "link.onnx").symlink_to(path)
    os.mkfifo(tmp_path / "pipe.onnx")
    (tmp_path / "folder.onnx").mkdir()
    with pytest.raises(ValueError, match=r"link\.onnx: is a link: give the file itself"):
        onnx_policy.load(tmp_path / "link.onnx")
    for name in (tmp_path / "pipe.onnx", tmp_path / "folder.onnx", Path("/dev/zero")):
        with pytest.raises(
            ValueError, match=r"must be a regular file|is a folder with 0 .onnx files"
        ):
            onnx_policy.load(name)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("load", "max_bytes"), [(onnx_policy.load, 20_000_000), (sandbox.load, 200_000_000)]
)
def test_files_that_are_too_large_are_refused(
    load: Callable[[Path], object], max_bytes: int, tmp_path: Path
) -> None:
    path = tmp_path / "agent.onnx"
    path.touch()
    os.truncate(path, max_bytes + 1)
    message = rf"agent\.onnx: is larger than {max_bytes} bytes"
    with pytest.raises(AgentFileError, match=message):
        load(path)
