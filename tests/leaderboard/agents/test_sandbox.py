"""A stranger's network can reach nothing, also after a fault in the library that runs it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from leaderboard.__main__ import main
from leaderboard.agents import sandbox
from leaderboard.agents.sandbox import AgentFileError, AgentTimeoutError, ProcessLimits, Sandbox
from tests.leaderboard.agents import hostile_child
from tests.walking import ROOT

linux = pytest.mark.skipif(sys.platform != "linux", reason="Landlock and seccomp are Linux's")


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Return the outcome of each attempt; all in one process, as each is held back."""
    folder = tmp_path_factory.mktemp("attacked")
    (folder / "sibling").write_text("a rival's file")
    (folder / "folder").mkdir()
    before = (folder / "sibling").stat()
    program = sandbox.program_of(hostile_child.__name__)
    attacked = Sandbox(str(folder).encode(), program=program)
    outcomes: dict[str, str] = json.loads(attacked.outline.properties["outcomes"])
    assert sorted(path.name for path in folder.iterdir()) == ["folder", "sibling"]
    after = (folder / "sibling").stat()
    assert after.st_mode == before.st_mode
    assert after.st_size == before.st_size
    assert after.st_mtime == before.st_mtime
    return outcomes


@linux
@pytest.mark.parametrize("attempt", hostile_child.ATTEMPTS)
def test_an_attack_is_held_back(attempt: str, outcomes: dict[str, str]) -> None:
    assert outcomes[attempt].startswith("held back: "), outcomes[attempt]


@linux
def test_descriptors_that_were_left_open_are_closed(tmp_path: Path) -> None:
    program = "import os\nfrom leaderboard.agents.confinement import limit\nlimit(512, 10)\n"
    program += "try: os.write({0}, b'leaked')\nexcept OSError as error: print(error)"
    with (tmp_path / "open").open("wb") as left:
        command = [sys.executable, "-c", program.format(left.fileno())]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        ended = subprocess.run(
            command,
            pass_fds=[left.fileno()],
            capture_output=True,
            text=True,
            env=environment,
            check=True,
        )
    assert "Bad file descriptor" in ended.stdout
    assert (tmp_path / "open").read_bytes() == b""


def test_a_process_is_confined_to_3_gibibytes_and_ten_minutes() -> None:
    program = """
import socket, struct, sys
wire = socket.socket(fileno=0)
limits = " ".join(sys.argv[1:]).encode()
wire.sendall(struct.pack("<cQ", b"M", 0))
wire.sendall(struct.pack("<cQ", b"E", len(limits)) + limits)
wire.recv(100)
"""
    # Memory is in MiB, processor time in seconds.
    with pytest.raises(AgentFileError, match=r"^3072 600 "):
        Sandbox(b"content", program=program)


@pytest.mark.slow
@linux
def test_the_limit_of_memory_is_in_mebibytes() -> None:
    program = """
from leaderboard.agents.confinement import limit
limit(256, 10)
print(len(bytearray(64 * 2**20)))
try:
    bytearray(300 * 2**20)
except MemoryError:
    print("no more")
"""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", program]
    ended = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    assert ended.stdout.split("\n") == [str(64 * 2**20), "no more", ""]


def test_missing_protection_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    program = """
import socket, struct
wire = socket.socket(fileno=0)
wire.sendall(struct.pack("<cQ", b"M", 15) + b"limits,Landlock")
wire.sendall(struct.pack("<cQ", b"E", 7) + b"refused")
wire.recv(100)
"""
    with pytest.raises(AgentFileError, match="refused"):
        Sandbox(b"content", program=program)
    said = capsys.readouterr().err
    assert "limits, Landlock active" in said
    assert "seccomp missing" in said


def written(
    folder: Path, body: str, graphs: dict[str, onnx.GraphProto] | None = None, **weights: object
) -> Path:
    """Write a file of nodes from ``observation`` to ``action``, and return its path.

    ``graphs`` are the bodies of its loops, by their outputs.
    """
    text = f"g (float[n, 11] observation) => (float[n, 2] action) {{ {body} }}"
    nodes = onnx.parser.parse_graph(text).node
    for node in nodes:
        if graphs and node.op_type == "Loop":
            node.attribute.append(helper.make_attribute("body", graphs[node.output[0]]))
    observation = helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["n", 11])
    action = helper.make_tensor_value_info("action", TensorProto.FLOAT, ["n", 2])
    tensors = [numpy_helper.from_array(np.asarray(array), name) for name, array in weights.items()]
    graph = helper.make_graph(nodes, "network", [observation], [action], tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    path = folder / "agent.onnx"
    path.write_bytes(model.SerializeToString())
    return path


FIRST = "first = Slice(observation, start, stop, axis) "
PLACES = {"start": np.array([0]), "stop": np.array([2]), "axis": np.array([1])}


def acted(path: Path, limits: ProcessLimits = sandbox.LIMITS) -> np.ndarray:
    """Return the actions of a file in two environments."""
    return sandbox.load(path, limits)(2).act(np.full((2, 11), 0.5, np.float32))


def test_a_plain_network_plays(tmp_path: Path) -> None:
    path = written(tmp_path, FIRST + "action = Identity(first)", **PLACES)
    np.testing.assert_array_equal(acted(path), np.full((2, 2), 0.5, np.float32))


def endless(folder: Path) -> Path:
    """Write a network with a loop that never ends, and return its path."""
    inputs = [
        helper.make_tensor_value_info("count", TensorProto.INT64, []),
        helper.make_tensor_value_info("going", TensorProto.BOOL, []),
        helper.make_tensor_value_info("value", TensorProto.FLOAT, ["n", 2]),
    ]
    outputs = [
        helper.make_tensor_value_info("on", TensorProto.BOOL, []),
        helper.make_tensor_value_info("after", TensorProto.FLOAT, ["n", 2]),
    ]
    nodes = [
        helper.make_node("Identity", ["going"], ["on"]),
        helper.make_node("Identity", ["value"], ["after"]),
    ]
    body = helper.make_graph(nodes, "body", inputs, outputs)
    return written(
        folder,
        FIRST + "action = Loop(, yes, first)",
        {"action": body},
        yes=np.array(True),
        **PLACES,
    )


@pytest.mark.slow
def test_a_loop_without_end_is_stopped(tmp_path: Path) -> None:
    path = endless(tmp_path)
    with pytest.raises(AgentTimeoutError, match="gives no answer within 1 s"):
        acted(path, ProcessLimits(answer=1.0))
    with pytest.raises(AgentTimeoutError, match="needs more than the 1 s of processor time"):
        acted(path, ProcessLimits(computing=1))


@pytest.mark.slow
@linux
def test_the_command_stops_a_loop_without_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = endless(tmp_path)
    assert main(["score", str(path), "--seeds", "2", "--agent-time", "1"]) == 2
    assert "needs more than the 1 s of processor time that it may have" in capsys.readouterr().err


@linux
@pytest.mark.slow
def test_a_network_that_takes_too_much_memory_is_stopped(tmp_path: Path) -> None:
    body = (
        FIRST
        + "huge = Expand(half, shape) sum = ReduceSum <keepdims = 0> (huge) "
        + "action = Mul(first, sum)"
    )
    path = written(
        tmp_path, body, half=np.float32([0.5]), shape=np.array([1_250_000_000]), **PLACES
    )
    with pytest.raises(AgentFileError, match=r"lloc|memory"):
        acted(path)


@pytest.mark.slow
@pytest.mark.parametrize("size_threshold", [0, 100], ids=["all", "large ones"])
def test_a_network_cannot_read_a_sibling(
    size_threshold: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    factors = np.full((1, 64), 1.0, np.float32)
    body = (
        FIRST
        + "product = Mul(first, one) sum = ReduceMax <keepdims = 0> (factors) "
        + "action = Mul(product, sum)"
    )
    path = written(
        tmp_path,
        body,
        one=np.float32([1.0]),
        factors=factors,
        **PLACES,
    )
    location = "weights"
    onnx.save(
        onnx.load(path),
        path,
        save_as_external_data=True,
        location=location,
        size_threshold=size_threshold,
    )
    assert (tmp_path / location).is_file()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(AgentFileError, match="inside the file"):
        sandbox.load(path)


@pytest.mark.slow
@pytest.mark.parametrize(
    "content",
    [b"", b"\x08\x07garbage" * 50, b"PK\x03\x04"],
    ids=["empty", "garbage", "zip"],
)
def test_a_file_that_is_no_network_is_refused_by_its_name(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "agent.onnx").write_bytes(content)
    with pytest.raises(AgentFileError, match=r"agent\.onnx: cannot be run"):
        sandbox.load(tmp_path / "agent.onnx")


@pytest.mark.slow
@pytest.mark.parametrize("value", [2.0, np.nan, -np.inf])
def test_actions_out_of_bounds_are_refused(value: float, tmp_path: Path) -> None:
    path = written(
        tmp_path, FIRST + "action = Mul(first, factor)", factor=np.float32([2.0 * value]), **PLACES
    )
    with pytest.raises(AgentFileError, match="numbers in -1 to 1"):
        acted(path)


def test_actions_of_more_numbers_than_any_task_has_are_refused(tmp_path: Path) -> None:
    observation = helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["n", 11])
    action = helper.make_tensor_value_info("action", TensorProto.FLOAT, ["n", 22])
    node = helper.make_node("Concat", ["observation", "observation"], ["action"], axis=1)
    graph = helper.make_graph([node], "network", [observation], [action])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    path = tmp_path / "agent.onnx"
    path.write_bytes(model.SerializeToString())
    with pytest.raises(AgentFileError, match="has actions of 22 numbers, but may have 16"):
        sandbox.load(path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("element", "axes"),
    [(TensorProto.FLOAT, [1, 11]), (TensorProto.DOUBLE, ["n", 11]), (TensorProto.FLOAT, [11])],
    ids=["a batch of 1", "64 bits", "one axis"],
)
def test_a_network_of_another_type_or_batch_is_told_how_to_be_exported(
    element: int, axes: list[int | str], tmp_path: Path
) -> None:
    observation = helper.make_tensor_value_info("observation", element, axes)
    action = helper.make_tensor_value_info("action", element, axes)
    node = helper.make_node("Identity", ["observation"], ["action"])
    graph = helper.make_graph([node], "network", [observation], [action])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    path = tmp_path / "agent.onnx"
    path.write_bytes(model.SerializeToString())
    with pytest.raises(
        AgentFileError, match=r"agent\.onnx: .*export it with a dynamic batch axis and float32"
    ):
        sandbox.load(path)
