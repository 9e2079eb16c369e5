"""An agent's file acts as the agent, says what it is, and no other file is loaded."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import helper, numpy_helper

from leaderboard.agents import agent_file, onnx_policy
from leaderboard.agents.network import session_after_trial
from leaderboard.agents.onnx_session import OnnxPolicy, session_of
from leaderboard.agents.sandbox import AgentFileError
from tests.leaderboard.agents import onnx_agents
from train.actor import ActorPolicy
from turning_env import Scenario

NUM_ENVS = 5


def observations(steps: int) -> NDArray[np.float32]:
    random = np.random.default_rng(1)
    return random.uniform(-1, 3, (steps, NUM_ENVS, 11)).astype(np.float32)


@pytest.mark.parametrize("memory", [False, True])
def test_a_file_acts_as_the_agent_and_forgets_each_environment_by_itself(memory: bool) -> None:
    file = agent_file.checked(onnx_agents.content(memory))
    original = ActorPolicy(onnx_agents.actor(memory), NUM_ENVS)
    exported = OnnxPolicy(session_of(file.content), file.memory_size, NUM_ENVS)
    for step, observation in enumerate(observations(20)):
        # In turns, one environment starts an episode, or none.
        started = np.arange(NUM_ENVS) == step % 7
        original.reset(started)
        exported.reset(started)
        actions = exported.act(observation)
        assert actions.shape == (NUM_ENVS, 2)
        assert actions.dtype == np.float32
        np.testing.assert_allclose(
            actions,
            original.act(observation),
            rtol=0,
            atol=1e-6,
        )


Change = Callable[[onnx.ModelProto], object]


def retold(name: str, value: str | None) -> Change:
    def change(model: onnx.ModelProto) -> None:
        properties = {entry.key: entry.value for entry in model.metadata_props}
        if value is None:
            del properties[name]
        else:
            properties[name] = value
        del model.metadata_props[:]
        helper.set_model_props(model, properties)

    return change


def elsewhere(model: onnx.ModelProto) -> None:
    tensor = model.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = onnx.TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="../../etc/passwd")


def insert(*nodes: onnx.NodeProto) -> Change:
    return lambda model: model.graph.node.extend(nodes)


def resized(axis: int, size: int) -> Change:
    return lambda model: setattr(
        model.graph.input[0].type.tensor_type.shape.dim[axis], "dim_value", size
    )


def bomb(model: onnx.ModelProto) -> None:
    model.graph.initializer.append(numpy_helper.from_array(np.array([1, 10**9, 11]), "shape"))
    model.graph.node.append(helper.make_node("Expand", ["observation", "shape"], ["huge"]))


def unclipped(model: onnx.ModelProto) -> None:
    for tensor in model.graph.initializer:
        if list(tensor.dims) == [2]:
            tensor.raw_data = np.array([np.nan, 0], np.float32).tobytes()


BRANCH = helper.make_graph([], "branch", [], [])
REFUSED: dict[str, tuple[Change, str]] = {
    "metadata missing": (retold("scenario", None), "metadata scenario: Field required"),
    "metadata unknown": (retold("mood", "good"), "metadata mood: Extra inputs"),
    "metadata twice": (
        lambda model: model.metadata_props.add(key="seed", value="1"),
        "names something twice",
    ),
    "metadata no JSON": (retold("seed", "one"), "metadata seed is not JSON"),
    "metadata deep": (retold("parameters", "[" * 100_000), "metadata parameters is not JSON"),
    "metadata that cannot be written": (
        retold("parameters", '{"a": "\\ud800"}'),
        "metadata parameters is not JSON",
    ),
    "metadata of no number": (
        retold("parameters", '{"a": NaN}'),
        "metadata parameters.a.* finite number",
    ),
    "metadata of another type": (
        retold("seed", '"1"'),
        "metadata seed: Input should be a valid integer",
    ),
    "a seed of 301 digits": (
        retold("seed", "1" + "0" * 300),
        "metadata seed: Input should be less than or equal to 9223372036854775807",
    ),
    "another format": (
        retold("format", "rough-turning/agent/9"),
        "metadata format: .*rough-turning/agent/2",
    ),
    "a path for a name": (retold("algorithm", "../ppo"), "metadata algorithm: "),
    "an unknown id": (
        retold("env_id", "Pendulum-v1"),
        "env_id is 'Pendulum-v1', but must be one of RoughTurning-v0",
    ),
    "an impossible scenario": (
        retold("scenario", '{"limits": {"power": -1.0}}'),
        "metadata scenario.limits.power: ",
    ),
    "another space": (
        retold("action_space", '{"low": [0.0], "high": [1.0]}'),
        "action_space is not that of",
    ),
    "another width": (
        resized(1, 12),
        "has inputs {'observation': 12}, but must have {'observation': 11}",
    ),
    "a fixed number of environments": (
        resized(0, 4),
        "'observation' must be float32 of shape .*: export it with a dynamic batch axis",
    ),
    "numbers of 64 bits": (
        lambda model: setattr(
            model.graph.input[0].type.tensor_type, "elem_type", onnx.TensorProto.DOUBLE
        ),
        "'observation' must be float32 of shape .*: export it with a dynamic batch axis",
    ),
    "another output": (
        lambda model: setattr(model.graph.output[0], "name", "deed"),
        "has outputs {'deed': 2}, but must have {'action': 2}",
    ),
    "weights elsewhere": (elsewhere, "keeps its weights .* in another file"),
    "a loop": (
        insert(helper.make_node("Loop", ["", ""], ["x"], body=BRANCH)),
        "uses the operator 'Loop'",
    ),
    "a foreign operator": (
        insert(helper.make_node("Relu", ["x"], ["y"], domain="evil")),
        "uses the operator 'Relu'",
    ),
    "a hidden graph": (
        insert(helper.make_node("Relu", ["x"], ["y"], body=BRANCH)),
        "holds a graph of its own",
    ),
    "a foreign operator set": (
        lambda model: model.opset_import.add(domain="evil", version=1),
        "uses operator sets",
    ),
    "an old operator set": (
        lambda model: setattr(model.opset_import[0], "version", 7),
        "uses operator sets",
    ),
    "functions": (lambda model: model.functions.add(name="f"), "holds functions"),
    "many nodes": (
        insert(*[helper.make_node("Relu", ["observation"], ["y"])] * 4_001),
        "has 4.* nodes, but may have 4000",
    ),
    "a value too large": (bomb, "value 'huge' has more than 1000000 entries per environment"),
    "a value from nowhere": (
        insert(helper.make_node("Relu", ["nowhere"], ["y"])),
        "is not valid ONNX",
    ),
    "actions that are no numbers": (unclipped, "which are not 2 actions"),
}


def here(path: Path) -> None:
    file = agent_file.read(path)
    session_after_trial(file.content, 11, 2, file.memory_size)


SANDBOXED = (
    "metadata deep",
    "a seed of 301 digits",
    "a loop",
    "weights elsewhere",
    "a value too large",
    "actions that are no numbers",
)


@pytest.mark.parametrize(
    ("load", "case"),
    [(here, case) for case in REFUSED]
    + [pytest.param(onnx_policy.load, case, marks=pytest.mark.slow) for case in SANDBOXED],
)
def test_other_files_are_refused_with_the_reason(
    load: Callable[[Path], object], case: str, tmp_path: Path
) -> None:
    change, message = REFUSED[case]
    model = onnx.load_model_from_string(onnx_agents.content())
    change(model)
    (tmp_path / "agent.onnx").write_bytes(model.SerializeToString())
    error = AgentFileError if load is onnx_policy.load else ValueError
    with pytest.raises(error, match=message):
        load(tmp_path / "agent.onnx")


@pytest.mark.parametrize("name", ["garbage.onnx", "missing.onnx", "locked.onnx", "folder.onnx"])
def test_loading_raises_one_kind_of_error(name: str, tmp_path: Path) -> None:
    (tmp_path / "garbage.onnx").write_bytes(b"\x08\x07garbage" * 50)
    (tmp_path / "folder.onnx").mkdir()
    (tmp_path / "locked.onnx").symlink_to("/etc/shadow")
    with pytest.raises(AgentFileError, match=name):
        onnx_policy.load(tmp_path / name)


@pytest.mark.slow
def test_an_agent_plays_other_scenarios_that_mean_the_same(tmp_path: Path) -> None:
    agent = onnx_policy.load(onnx_agents.write(tmp_path))
    agent_file.check_fits(agent, Scenario.load("forging"))
    with pytest.raises(
        ValueError,
        match=r"trained on scenario 'short' with control.action = 'incremental', cannot play",
    ):
        agent_file.check_fits(agent, Scenario.load("override"))
    with pytest.raises(ValueError, match=r"control\.edge_changes"):
        agent_file.check_fits(agent, Scenario.load("shift"))


@pytest.mark.parametrize("text", [b"rough-turning/agent", b"algorithm", b"observation\x12"])
def test_a_damaged_text_is_refused(text: bytes) -> None:
    content = onnx_agents.content()
    damaged = content.replace(text, b"\xff" + text[1:])
    assert damaged != content
    with pytest.raises(ValueError, match=r"is damaged: b'.xff.*' in it is not UTF-8"):
        agent_file.checked(damaged)
