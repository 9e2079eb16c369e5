"""A policy in a process of its own, which cannot harm the control's process."""

import contextlib
import os
import resource
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from turning_control.policy_process import PolicyEndedError, in_own_process
from turning_control.shield import PATIENCE, Shield

from turning_env import Scenario
from turning_env.policy import Observations, Policy
from turning_env.vector_env import RoughTurningVectorEnv

POLICIES = """
import os, sys, time
import numpy as np

print('{"number": 1, "actions": [[1.0, 1.0]]}', flush=True)

def steady(observations):
    print('{"number": 2, "actions": [[1.0, 1.0]]}', flush=True)
    return np.full((len(observations), 2), -0.25, np.float32)

calls = 0

def hangs_after_one(observations):
    global calls
    calls += 1
    if calls > 1:
        time.sleep(600)
    return steady(observations)

class Remembers:
    steps = 0  # since the last reset

    def reset(self, mask):
        self.steps = 0

    def act(self, observations):
        self.steps += 1
        if self.steps == 2:
            time.sleep(0.9)
        return np.full((len(observations), 2), -0.125 * self.steps, np.float32)

class Varies:
    def __init__(self):
        self.acts = iter([self.reads, self.fails, self.not_numbers, self.fails])

    def act(self, observations):
        return next(self.acts)(observations)

    def reads(self, observations):
        assert sys.stdin.read() == ""
        return np.full((len(observations), 2), 0.1)

    def fails(self, observations):
        raise OSError("no more")

    def not_numbers(self, observations):
        return [["a", "b"]]

def ends(observations):
    os._exit(3)
"""


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Return the name of a module of policies that another process can import."""
    (tmp_path / "misbehaves.py").write_text(POLICIES)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), *filter(None, sys.path)]))
    return "misbehaves"


def observed() -> Observations:
    observations, _ = RoughTurningVectorEnv(1, Scenario.load("rough_turning")).reset(seed=0)
    return observations


def start(name: str, deadline: float = 20.0) -> Policy:
    """Return a policy of one environment in a process of its own."""
    return in_own_process(name, deadline)(1)


@pytest.mark.slow
def test_a_policy_answers_whatever_it_prints(module: str) -> None:
    policy = start(f"{module}:steady")
    for _ in range(3):
        policy.reset(np.ones(1, np.bool_))
        np.testing.assert_array_equal(policy.act(observed()), [[-0.25, -0.25]])


@pytest.mark.slow
def test_a_policy_that_hangs_is_late_and_the_shield_commands_the_safe_feed(module: str) -> None:
    scenario = Scenario.load("rough_turning")
    policy = start(f"{module}:hangs_after_one", deadline=0.1)
    shield = Shield(policy, scenario, 1)
    shield.act(observed())
    assert shield.reasons == ["passed"]
    asked_at = time.monotonic()
    actions = shield.act(observed())
    assert shield.reasons == ["error"]
    assert np.isfinite(actions).all()
    assert time.monotonic() - asked_at < 10.0
    for _ in range(PATIENCE):
        shield.act(observed())
    assert shield.takeover.tolist() == [True]


@pytest.mark.slow
def test_a_late_answer_is_skipped_and_a_reset_meanwhile_is_not_lost(module: str) -> None:
    policy = start(f"{module}:Remembers", deadline=0.3)
    np.testing.assert_array_equal(policy.act(observed()), [[-0.125, -0.125]])
    with pytest.raises(TimeoutError):
        policy.act(observed())
    time.sleep(0.8)
    np.testing.assert_array_equal(policy.act(observed()), [[-0.375, -0.375]])
    policy.reset(np.ones(1, np.bool_))
    np.testing.assert_array_equal(policy.act(observed()), [[-0.125, -0.125]])
    with pytest.raises(TimeoutError):
        policy.act(observed())
    policy.reset(np.ones(1, np.bool_))
    time.sleep(0.8)
    np.testing.assert_array_equal(policy.act(observed()), [[-0.125, -0.125]])


@pytest.mark.slow
def test_a_policy_may_answer_in_double_and_errors_are_those_of_its_answer(module: str) -> None:
    policy = start(f"{module}:Varies")
    np.testing.assert_array_equal(policy.act(observed()), np.full((1, 2), np.float32(0.1)))
    with pytest.raises(RuntimeError, match="no more"):
        policy.act(observed())
    shield = Shield(policy, Scenario.load("rough_turning"), 1)
    shield.act(observed())
    assert shield.reasons == ["error"]
    with pytest.raises(RuntimeError, match="no more"):
        policy.act(observed())


@pytest.mark.slow
def test_a_policy_that_ends_raises_in_act(module: str) -> None:
    policy = start(f"{module}:ends")
    for _ in range(2):
        with pytest.raises(PolicyEndedError):
            policy.act(observed())
        policy.reset(np.ones(1, np.bool_))


@pytest.mark.slow
def test_an_unknown_object_of_a_module_is_a_mistake(module: str) -> None:
    with pytest.raises(ValueError, match="nothing"):
        start(f"{module}:nothing")


def test_a_missing_file_is_a_mistake(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        start(str(tmp_path / "missing.onnx"))


@pytest.mark.slow
def test_a_file_without_a_network_is_a_mistake(tmp_path: Path) -> None:
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"no network")
    with pytest.raises(ValueError, match="broken"):
        start(str(broken))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are Linux's")
def test_a_file_that_takes_memory_without_end_is_ended(tmp_path: Path) -> None:
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    path = tmp_path / "greedy.onnx"
    onnx.save(greedy_network(onnx, entries=observed().shape[1]), path)
    policy = start(str(path))
    with pytest.raises(RuntimeError, match="memory"):
        policy.act(observed())
    with pytest.raises(PolicyEndedError):
        policy.act(observed())


def network_with_memory(folder: Path) -> Path:
    """Write a network that adds a quarter of two observed numbers to its actions before."""
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    path = folder / "network.onnx"
    text = """
    <ir_version: 9, opset_import: ["": 17]>
    network (float[n, entries] observation, float[n, 2] memory)
        => (float[n, 2] action, float[n, 2] next_memory)
    <int64[1] begin = {0}, int64[1] end = {2}, int64[1] axes = {1}, float[1] rate = {0.25}>
    {
        first = Slice(observation, begin, end, axes)
        step = Mul(first, rate)
        action = Add(step, memory)
        next_memory = Identity(action)
    }
    """
    onnx.save(onnx.parser.parse_model(text), path)
    return path


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
def test_the_processor_time_of_a_file_is_not_limited_and_its_memory_is(tmp_path: Path) -> None:
    """A control runs for weeks."""
    before = processes_started_here()
    policy = start(str(network_with_memory(tmp_path)))
    policy.act(observed())
    (number,) = processes_started_here() - before
    unlimited = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
    assert resource.prlimit(number, resource.RLIMIT_CPU) == unlimited
    assert resource.prlimit(number, resource.RLIMIT_AS) == (3 * 2**30, 3 * 2**30)


def processes_started_here() -> set[int]:
    """Return the numbers of the processes whose parent is this one."""
    numbers = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it has ended meanwhile
            _, parent = path.read_text().rpartition(")")[2].split()[:2]
            if int(parent) == os.getpid():
                numbers.add(int(path.parent.name))
    return numbers


@pytest.mark.slow
def test_a_file_acts(tmp_path: Path) -> None:
    policy = start(str(network_with_memory(tmp_path)))
    observations = observed()
    step = 0.25 * observations[:, :2]
    np.testing.assert_array_equal(policy.act(observations), step)
    np.testing.assert_array_equal(policy.act(observations), 2.0 * step)
    policy.reset(np.ones(1, np.bool_))
    np.testing.assert_array_equal(policy.act(observations), step)


def greedy_network(onnx, entries: int):  # type: ignore[no-untyped-def]
    """Return a network that fills 8 GiB with zeros to get two of them."""
    make = onnx.helper
    floats = onnx.TensorProto.FLOAT
    size = make.make_tensor("size", onnx.TensorProto.INT64, [1], [2**31])
    axes = make.make_tensor("axes", onnx.TensorProto.INT64, [1], [0])
    nodes = [
        make.make_node("ConstantOfShape", ["size"], ["zeros"]),
        make.make_node("ReduceSum", ["zeros", "axes"], ["zero"], keepdims=1),
        make.make_node(
            "ReduceSum",
            ["observation", "one"],
            ["sum"],
            keepdims=1,
        ),
        make.make_node("Mul", ["sum", "zero"], ["product"]),
        make.make_node("Concat", ["product", "product"], ["action"], axis=1),
    ]
    one = make.make_tensor("one", onnx.TensorProto.INT64, [1], [1])
    observation = make.make_tensor_value_info("observation", floats, ["n", entries])
    action = make.make_tensor_value_info("action", floats, ["n", 2])
    graph = make.make_graph(nodes, "greedy", [observation], [action], [size, axes, one])
    return make.make_model(graph, opset_imports=[make.make_opsetid("", 17)], ir_version=9)
