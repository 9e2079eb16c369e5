"""Agents of any origin become agent files that act as they do, or are refused with the reason."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from numpy.typing import NDArray
from onnx import helper
from sb3_contrib import TQC, RecurrentPPO
from stable_baselines3 import A2C, PPO, SAC, TD3
from stable_baselines3.common.vec_env import VecNormalize

from baselines.derived_observation import VectorDerivedObservation
from baselines.load_target import VectorLoadTargetAction
from leaderboard.agents import agent_file, onnx_policy
from leaderboard.agents.agent_file import AgentFile
from leaderboard.agents.onnx_session import OnnxPolicy, session_of
from leaderboard.inputs import Inputs
from tests.leaderboard.agents import onnx_agents
from tests.train.small import ALGORITHMS, small_run
from train import export
from train.actor import Actor, ActorPolicy
from train.run import Run
from train.to_onnx import sb3_actor
from train.training import Algorithm, load_agent, new_model
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv

SCENARIO = onnx_agents.SCENARIO
ALGORITHM = ALGORITHMS["ppo"]
NUM_ENVS = 5
# Ten steps.
OBSERVATIONS = np.random.default_rng(1).uniform(-1, 3, (10, NUM_ENVS, 11)).astype(np.float32)


@pytest.fixture
def scenario(tmp_path: Path) -> str:
    path = tmp_path / "short.toml"
    SCENARIO.save(path)
    return str(path)


def exported(out: Path, *arguments: object) -> AgentFile:
    words = [str(argument) for argument in arguments]
    assert export.main([*words, "--out", str(out)]) == 0
    return agent_file.read(out)


def refusal(capsys: pytest.CaptureFixture[str], out: Path, *arguments: object) -> str:
    words = [str(argument) for argument in arguments]
    assert export.main([*words, "--out", str(out)]) == 2
    assert not out.exists()
    return capsys.readouterr().err


def actions(file: AgentFile) -> list[NDArray[np.float32]]:
    """Return the actions of an agent file for all observations."""
    policy = OnnxPolicy(session_of(file.content), file.memory_size, NUM_ENVS)
    policy.reset(np.ones(NUM_ENVS, np.bool_))
    return [policy.act(observations) for observations in OBSERVATIONS]


def layers(actions: int = 2) -> torch.nn.Sequential:
    torch.manual_seed(0)
    return torch.nn.Sequential(
        torch.nn.Linear(11, 16),
        torch.nn.ReLU(),
        torch.nn.Linear(16, actions),
    )


@pytest.mark.slow
def test_any_module_becomes_an_agent_that_acts_as_it_does(tmp_path: Path) -> None:
    path = tmp_path / "me-seed4.onnx"
    module = layers()
    export.export_torch(module, path, scenario=SCENARIO)
    agent = onnx_policy.load(path)
    assert agent.label == "me-seed4"
    assert agent.trained_on == SCENARIO
    observations = OBSERVATIONS[0]
    expected = module(torch.from_numpy(observations)).detach().clamp(-1, 1).numpy()
    np.testing.assert_allclose(agent.make(NUM_ENVS).act(observations), expected, atol=1e-6)


@pytest.mark.slow
def test_a_module_gives_the_same_file_again_and_nothing_of_where_it_was_made(
    tmp_path: Path,
) -> None:
    path = tmp_path / "me-seed4.onnx"
    path_again = tmp_path / "again" / path.name
    module = layers()
    export.export_torch(module, path, scenario=SCENARIO)
    export.export_torch(module, path_again, scenario=SCENARIO)
    content = path.read_bytes()
    assert content == path_again.read_bytes()
    assert sys.prefix.encode() not in content
    assert b".py" not in content


@pytest.mark.slow
def test_a_module_with_a_memory_becomes_an_agent(tmp_path: Path) -> None:
    path = tmp_path / "ppo.onnx"
    recurrent = onnx_agents.actor(memory=True).double()
    export.export_torch(
        recurrent,
        path,
        scenario=SCENARIO,
        trained_steps=7,
    )
    file = agent_file.read(path)
    # An algorithm has the name ppo.
    assert file.metadata.label == "my_ppo-seed0"
    assert file.metadata.trained_steps == 7
    assert file.memory_size == 7
    memory = torch.zeros(NUM_ENVS, 7, dtype=torch.float64)
    for observations, action in zip(OBSERVATIONS, actions(file), strict=True):
        expected, memory = recurrent(torch.from_numpy(observations).double(), memory)
        np.testing.assert_allclose(action, expected.detach().clamp(-1, 1), atol=1e-5)


@pytest.mark.parametrize(
    ("module", "complaint"),
    [
        pytest.param(
            layers(actions=3),
            r"Sequential cannot be exported: .*\(2, 3\).* must give \(\(2, 2\)",
            id="other actions",
        ),
        pytest.param(
            torch.nn.Linear(4, 2),
            r"Linear cannot be exported: .*cannot act",
            id="other observations",
        ),
    ],
)
def test_a_module_of_other_shapes_is_refused(
    module: torch.nn.Module, complaint: str, tmp_path: Path
) -> None:
    path = tmp_path / "mine.onnx"
    with pytest.raises(ValueError, match=complaint):
        export.export_torch(module, path)
    assert not path.exists()


@pytest.mark.slow
def test_a_training_elsewhere_states_its_wrappers(tmp_path: Path) -> None:
    torch.manual_seed(0)
    module = torch.nn.Linear(17, 2)  # 11 entries and six derived ones
    path = tmp_path / "me-seed0.onnx"
    with pytest.raises(ValueError, match=r"cannot act.*state the wrappers of its training"):
        export.export_torch(module, path, scenario=SCENARIO)
    stated = {"load_target": True, "derived": True, "training_information": ["rewards"]}
    export.export_torch(module, path, scenario=SCENARIO, settings=stated)
    inputs = Inputs.of(agent_file.read(path).metadata.parameters)
    assert inputs.run_time == ("derived inputs", "load target")
    assert inputs.agent_class == "model-free agent"


@pytest.mark.parametrize(
    ("setting", "complaint"),
    [
        ("load_targets=true", "no setting 'load_targets'; did you mean load_target?"),
        ("derived=1", "derived is 1, but must be true or false"),
        ("training_information=['reward']", "training_information has 'reward'; did you mean"),
    ],
)
def test_wrong_settings_of_a_training_elsewhere_are_refused(
    setting: str, complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = network(tmp_path / "mine.onnx", *SLICE)
    assert complaint in refusal(capsys, tmp_path / "out", path, "--set", setting)


@pytest.mark.slow
def test_a_model_behind_the_wrappers_of_families_is_exported_with_them(
    tmp_path: Path, scenario: str
) -> None:
    def wrapper(envs: Any) -> Any:
        return VectorDerivedObservation(VectorLoadTargetAction(envs))

    model = PPO("MlpPolicy", RoughTurningVecEnv(SCENARIO, 2, wrapper=wrapper), device="cpu")
    path = tmp_path / "mine.zip"
    model.save(path)
    out = tmp_path / "out"
    words = [path, "--scenario", scenario, "--set", "load_target=true", "--set", "derived=true"]
    parameters = exported(out, *words).metadata.parameters
    assert parameters["load_target"]
    assert parameters["derived"]


class ActionsAndValues(torch.nn.Module):
    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return observations[:, :2], observations[:, 2]


def test_a_module_that_returns_a_tuple_without_a_memory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="ActionsAndValues returns a tuple of 2"):
        export.export_torch(ActionsAndValues(), tmp_path / "mine.onnx")
    assert not (tmp_path / "mine.onnx").exists()


POLICIES = {
    PPO: "MlpPolicy",
    A2C: "MlpPolicy",
    SAC: "MlpPolicy",
    TD3: "MlpPolicy",
    TQC: "MlpPolicy",
    RecurrentPPO: "MlpLstmPolicy",
}


def run_elsewhere() -> Run:
    """Return a training run without a folder of its own."""
    return Run.elsewhere(
        "sb3",
        "RoughTurning-v0",
        scenario=SCENARIO,
        steps=9,
        command="a command",
    )


@pytest.mark.parametrize("kind", POLICIES, ids=lambda kind: kind.__name__)
def test_models_of_stable_baselines_act_as_they_predict(kind: Any, tmp_path: Path) -> None:
    env = RoughTurningVecEnv(SCENARIO, 2)
    model = kind(POLICIES[kind], env, seed=1, device="cpu")
    path = tmp_path / "mine.zip"
    model.save(path)
    run, actor = sb3_actor(path, run_elsewhere())
    assert run.algorithm == kind.__name__.lower()
    assert run.parameters == {"total_timesteps": 0}
    policy = ActorPolicy(actor, NUM_ENVS)
    state = None
    for observations in OBSERVATIONS:
        expected, state = model.predict(observations, state, deterministic=True)
        np.testing.assert_allclose(policy.act(observations), expected, atol=1e-5)


def test_a_model_of_other_observations_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine-seed2.zip"
    env = RoughTurningVecEnv(SCENARIO, 2)
    model = PPO(
        "MlpPolicy",
        env,
        device="cpu",
        policy_kwargs={"net_arch": []},
    )
    model.save(path)
    complaint = refusal(capsys, tmp_path / "out", path, "--scenario", "batch_casting")
    assert "was trained on observations of shape (11,)" in complaint


def test_a_file_that_is_no_model_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "text.zip"
    path.write_text("text")
    complaint = refusal(capsys, tmp_path / "out", path)
    assert "text.zip is no model of Stable-Baselines3" in complaint


SHORT_TRAINING: dict[str, Any] = {
    "n_steps": 8,
    "batch_size": 16,
    "n_epochs": 1,
    "seed": 1,
    "device": "cpu",
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", [PPO, RecurrentPPO], ids=lambda kind: kind.__name__)
def test_a_normalised_model_needs_its_statistics(
    kind: Any, scenario: str, tmp_path: Path, capsys
) -> None:
    env = VecNormalize(RoughTurningVecEnv(SCENARIO, 2))
    path = tmp_path / "mine.zip"
    statistics = tmp_path / "statistics.pkl"
    model = kind(POLICIES[kind], env, **SHORT_TRAINING).learn(32)
    model.save(path)
    env.save(str(statistics))
    _, actor = sb3_actor(path, run_elsewhere(), statistics)
    policy = ActorPolicy(actor, NUM_ENVS)
    state = None
    for observations in OBSERVATIONS:
        normalised = env.normalize_obs(observations)
        expected, state = model.predict(normalised, state, deterministic=True)
        np.testing.assert_allclose(policy.act(observations), expected, atol=1e-5)

    words = [path, "--scenario", scenario]
    out = tmp_path / "out"
    assert "--statistics" in refusal(capsys, out, *words)
    complaint = refusal(capsys, out, *words, "--statistics", path)
    assert "cannot be read as statistics" in complaint


def test_statistics_of_rewards_alone_change_no_observation(tmp_path: Path) -> None:
    env = VecNormalize(RoughTurningVecEnv(SCENARIO, 2), norm_obs=False)
    path = tmp_path / "mine.zip"
    statistics = tmp_path / "statistics.pkl"
    model = PPO("MlpPolicy", env, **SHORT_TRAINING).learn(32)
    model.save(path)
    env.save(str(statistics))
    _, actor = sb3_actor(path, run_elsewhere(), statistics)
    observations = OBSERVATIONS[0]
    expected, _ = model.predict(observations, deterministic=True)
    policy = ActorPolicy(actor, NUM_ENVS)
    np.testing.assert_allclose(policy.act(observations), expected, atol=1e-5)


def float_values(name: str, shape: list[int] | None) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, shape)


def network(path: Path, *nodes: onnx.NodeProto, opset: int = 20) -> Path:
    """Write a network whose nodes compute actions y from an observation x; return the path."""
    graph = helper.make_graph(
        nodes,
        "network",
        inputs=[float_values("x", [1, 11])],
        outputs=[float_values("y", None)],
    )
    operator_sets = [helper.make_opsetid("", opset)]
    model = helper.make_model(graph, opset_imports=operator_sets, ir_version=8)
    onnx.save(model, path)
    return path


# Half of the first two entries.
SLICE = [
    helper.make_node("Constant", [], ["half"], value_floats=[0.5]),
    helper.make_node("Constant", [], ["pair"], value_ints=[0, 1]),
    helper.make_node("Gather", ["x", "pair"], ["first"], axis=1),
    helper.make_node("Mul", ["first", "half"], ["y"]),
]


@pytest.mark.parametrize("opset", [13, 26])
def test_all_operator_sets_that_can_be_run_are_accepted(opset: int, tmp_path: Path) -> None:
    path = network(tmp_path / "mine.onnx", *SLICE, opset=opset)
    first_actions = actions(exported(tmp_path / "out", path))[0]
    expected = np.clip(0.5 * OBSERVATIONS[0, :, :2], -1, 1)
    np.testing.assert_allclose(first_actions, expected)


@pytest.mark.parametrize("opset", [12, 27])
def test_other_operator_sets_are_refused(
    opset: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = network(tmp_path / "mine.onnx", *SLICE, opset=opset)
    complaint = refusal(capsys, tmp_path / "out", path)
    assert f"mine.onnx cannot be exported: uses operator sets [('', {opset})]" in complaint


def test_a_network_of_other_observations_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = network(tmp_path / "mine.onnx", *SLICE)
    complaint = refusal(capsys, tmp_path / "out", path, "--scenario", "surface")
    assert "must have (number of environments, 12)" in complaint


def test_a_network_with_two_outputs_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy_of_action = helper.make_node("Identity", ["y"], ["n"])
    path = network(tmp_path / "mine.onnx", *SLICE, copy_of_action)
    model = onnx.load(path)
    model.graph.output.append(float_values("n", None))
    onnx.save(model, path)
    complaint = refusal(capsys, tmp_path / "out", path)
    assert "has 1 inputs and 2 outputs, but must have an observation and an action" in complaint


def test_an_operator_that_is_not_allowed_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = network(tmp_path / "mine.onnx", *SLICE, helper.make_node("NonZero", ["x"], ["z"]))
    assert "uses the operator 'NonZero'" in refusal(capsys, tmp_path / "out", path)


def test_a_network_for_a_batch_of_one_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    constant = helper.make_node("Constant", [], ["s"], value_ints=[1, 2])
    reshape = helper.make_node("Reshape", ["first", "s"], ["y"])
    path = network(tmp_path / "mine.onnx", *SLICE[:3], constant, reshape)
    complaint = refusal(capsys, tmp_path / "out", path)
    assert "was written for a batch of 1 and cannot act on others" in complaint


def test_an_agents_own_file_and_text_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mine.onnx"
    path.write_bytes(onnx_agents.content())
    assert "is an agent's file already" in refusal(capsys, tmp_path / "out", path)
    path.write_bytes(b"text")
    assert "is no ONNX file" in refusal(capsys, tmp_path / "out", path)


def finished(algorithm: Algorithm, runs: Path, **changes: object) -> Run:
    """Return a run that ends before it has begun: its agent is untrained."""
    run = small_run(algorithm, runs, SCENARIO, **changes)
    run.begin()
    model = new_model(run, algorithm)
    model.env = None
    model.save(run.policy)
    return run


CHANGES: dict[str, dict[str, object]] = {
    "ppo": {"position": True, "frames": 3},
    # The observations here have no derived inputs.
    "simulator_gradient": {"derived": False},
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["ppo", "sac", "recurrent_ppo", "analytic_gradient", "simulator_gradient"]
)
def test_runs_of_every_network_can_be_exported(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = finished(ALGORITHMS[name], tmp_path, **CHANGES.get(name, {}))
    assert export.main([str(run.folder), "--out", str(tmp_path / "out"), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    # The name without the scenario is that of the agent that ships.
    path = tmp_path / "out" / f"{name}_short-seed3.onnx"
    assert report["path"] == str(path)
    assert report["size"] == path.stat().st_size
    assert report["observations"] == 10_000

    original = load_agent(run.folder)
    loaded = onnx_policy.load(path)
    assert loaded.name == original.name
    assert loaded.training_seed == 3
    assert loaded.trained_on == run.scenario
    assert loaded.command == "a command"
    assert loaded.parameters == original.parameters
    assert loaded.sha256 == report["digest"]

    policy = loaded.make(NUM_ENVS)
    original_policy = original.make(NUM_ENVS)
    for observations in OBSERVATIONS:
        expected = original_policy.act(observations)
        np.testing.assert_allclose(
            policy.act(observations),
            expected,
            rtol=0,
            atol=1e-5,
        )


@pytest.mark.slow
def test_a_file_that_acts_otherwise_is_not_written(tmp_path: Path) -> None:
    class Fickle(Actor):
        def forward(
            self, observation: torch.Tensor, memory: torch.Tensor
        ) -> tuple[torch.Tensor, torch.Tensor]:
            action = (0.1 * observation[:, :2]).clamp(-1, 1)
            if not torch.compiler.is_compiling():
                action = action + 2.5e-5
            return action, memory

    path = tmp_path / "out.onnx"
    with pytest.raises(ValueError, match="acts otherwise, by up to 2"):
        export.export_torch(Fickle(), path, scenario=SCENARIO)
    assert not path.exists()


def test_runs_that_cannot_be_exported_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    run = onnx_agents.run(tmp_path / "runs" / "ppo-seed0")
    assert "holds no agent" in refusal(capsys, out, run.folder)
    run.begin()
    assert "not finished" in refusal(capsys, out, run.folder)

    folder = finished(ALGORITHM, tmp_path / "one").folder
    seed = refusal(capsys, out, folder, "--seed", 1)
    assert "--seed is for .zip and .onnx files" in seed
    assert "the name is '../x'" in refusal(capsys, out, folder, "--name", "../x")
    model = finished(ALGORITHM, tmp_path / "other").folder / "policy.zip"
    assert "would both be" in refusal(capsys, out, folder, model)


def test_a_folder_stands_for_its_only_file(tmp_path: Path) -> None:
    onnx_agents.write(tmp_path)
    assert agent_file.read(tmp_path).metadata.label == "ppo-seed0"
    onnx_agents.write(tmp_path, 1)
    with pytest.raises(ValueError, match=r"is a folder with 2 \.onnx files"):
        onnx_policy.load(tmp_path)
    onnx_agents.run(tmp_path).begin()
    with pytest.raises(ValueError, match=r"holds a training run: python -m train\.export"):
        onnx_policy.load(tmp_path)
