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

from tests.train import onnx_agents
from tests.train.small import ALGORITHMS, small_run
from train import export
from train.actor import Actor, ActorPolicy
from train.agents import agent_file, onnx_policy
from train.agents.agent_file import AgentFile
from train.agents.to_onnx import sb3_actor
from train.run import Run
from train.training import Algorithm, load_agent, new_model
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.scoring.onnx_session import OnnxPolicy, session_of

SCENARIO, ALGORITHM = onnx_agents.SCENARIO, ALGORITHMS["ppo"]
OBSERVATIONS = np.random.default_rng(1).uniform(-1, 3, (10, 5, 11)).astype(np.float32)


@pytest.fixture
def scenario(tmp_path: Path) -> str:
    SCENARIO.save(tmp_path / "short.toml")
    return str(tmp_path / "short.toml")


def exported(out: Path, *arguments: object) -> AgentFile:
    assert export.main([*map(str, arguments), "--out", str(out)]) == 0
    return agent_file.read(out)


def refusal(capsys: pytest.CaptureFixture[str], out: Path, *arguments: object) -> str:
    assert export.main([*map(str, arguments), "--out", str(out)]) == 2
    assert not out.exists()
    return capsys.readouterr().err


def actions(file: AgentFile) -> list[NDArray[np.float32]]:
    policy = OnnxPolicy(session_of(file.content), file.memory_size, 5)
    policy.reset(np.ones(5, np.bool_))
    return [policy.act(each) for each in OBSERVATIONS]


def layers(actions: int = 2) -> torch.nn.Sequential:
    torch.manual_seed(0)
    return torch.nn.Sequential(
        torch.nn.Linear(11, 16), torch.nn.ReLU(), torch.nn.Linear(16, actions)
    )


@pytest.mark.slow
def test_any_module_becomes_an_agent(tmp_path: Path) -> None:
    module = layers()
    export.export_torch(module, tmp_path / "me-seed4.onnx", scenario=SCENARIO)
    agent = onnx_policy.load(tmp_path / "me-seed4.onnx")
    assert (agent.label, agent.trained_on) == ("me-seed4", SCENARIO)
    expected = module(torch.from_numpy(OBSERVATIONS[0])).detach().clamp(-1, 1).numpy()
    np.testing.assert_allclose(agent.make(5).act(OBSERVATIONS[0]), expected, atol=1e-6)

    export.export_torch(module, tmp_path / "again" / "me-seed4.onnx", scenario=SCENARIO)
    content = (tmp_path / "me-seed4.onnx").read_bytes()
    assert content == (tmp_path / "again" / "me-seed4.onnx").read_bytes()
    assert sys.prefix.encode() not in content  # nothing of where it was made
    assert b".py" not in content

    recurrent = onnx_agents.actor(memory=True).double()
    export.export_torch(recurrent, tmp_path / "ppo.onnx", scenario=SCENARIO, trained_steps=7)
    file = agent_file.read(tmp_path / "ppo.onnx")
    assert (file.metadata.label, file.memory_size, file.metadata.trained_steps) == (
        "my_ppo-seed0",
        7,
        7,
    )  # ppo is taken
    memory = torch.zeros(5, 7, dtype=torch.float64)
    for observations, found in zip(OBSERVATIONS, actions(file), strict=True):
        expected, memory = recurrent(torch.from_numpy(observations).double(), memory)
        np.testing.assert_allclose(found, expected.detach().clamp(-1, 1), atol=1e-5)
    with pytest.raises(
        ValueError, match=r"Sequential cannot be exported: .*\(2, 3\).* must give \(\(2, 2\)"
    ):
        export.export_torch(layers(3), tmp_path / "wide.onnx")
    with pytest.raises(ValueError, match=r"Linear cannot be exported: .*cannot act"):
        export.export_torch(torch.nn.Linear(4, 2), tmp_path / "narrow.onnx")
    assert not (tmp_path / "wide.onnx").exists()


class ActionsAndValues(torch.nn.Module):
    def forward(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return observations[:, :2], observations[:, 2]


def test_a_module_that_returns_a_tuple_without_a_memory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="ActionsAndValues returns a tuple of 2"):
        export.export_torch(ActionsAndValues(), tmp_path / "mine.onnx")
    assert not (tmp_path / "mine.onnx").exists()


@pytest.mark.parametrize(
    "kind", [PPO, A2C, SAC, TD3, TQC, RecurrentPPO], ids=lambda kind: kind.__name__
)
def test_models_of_stable_baselines_act_as_they_predict(kind: Any, tmp_path: Path) -> None:
    env = RoughTurningVecEnv(SCENARIO, 2)
    model = kind(
        "MlpLstmPolicy" if kind is RecurrentPPO else "MlpPolicy", env, seed=1, device="cpu"
    )
    model.save(tmp_path / "mine.zip")
    run, actor = sb3_actor(
        tmp_path / "mine.zip", Run.elsewhere("sb3", "RoughTurning-v0", SCENARIO, 9, "a command")
    )
    assert (run.algorithm, run.parameters) == (kind.__name__.lower(), {"total_timesteps": 0})
    policy, state = ActorPolicy(actor, 5), None
    for observations in OBSERVATIONS:
        expected, state = model.predict(observations, state, deterministic=True)
        np.testing.assert_allclose(policy.act(observations), expected, atol=1e-5)


def test_models_of_other_observations_and_other_files_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, other = tmp_path / "mine-seed2.zip", tmp_path / "other"
    PPO(
        "MlpPolicy", RoughTurningVecEnv(SCENARIO, 2), device="cpu", policy_kwargs={"net_arch": []}
    ).save(model)
    assert "was trained on observations of shape (11,)" in refusal(
        capsys, other, model, "--scenario", "batch_casting"
    )
    (tmp_path / "text.zip").write_text("text")
    assert "text.zip is no model of Stable-Baselines3" in refusal(
        capsys, other, tmp_path / "text.zip"
    )


@pytest.mark.parametrize("kind", [PPO, RecurrentPPO], ids=lambda kind: kind.__name__)
def test_a_normalised_model_needs_its_statistics(
    kind: Any, scenario: str, tmp_path: Path, capsys
) -> None:
    env = VecNormalize(RoughTurningVecEnv(SCENARIO, 2))
    policy = "MlpLstmPolicy" if kind is RecurrentPPO else "MlpPolicy"
    model = kind(policy, env, n_steps=8, batch_size=16, n_epochs=1, seed=1, device="cpu").learn(32)
    path, statistics = tmp_path / "mine.zip", tmp_path / "statistics.pkl"
    model.save(path)
    env.save(str(statistics))
    run = Run.elsewhere("sb3", "RoughTurning-v0", SCENARIO, 9, "a command")
    _, actor = sb3_actor(path, run, statistics)
    acting, state = ActorPolicy(actor, 5), None
    for observations in OBSERVATIONS:
        expected, state = model.predict(env.normalize_obs(observations), state, deterministic=True)
        np.testing.assert_allclose(acting.act(observations), expected, atol=1e-5)
    assert "--statistics" in refusal(capsys, tmp_path / "out", path, "--scenario", scenario)
    wrong = refusal(capsys, tmp_path / "out", path, "--scenario", scenario, "--statistics", path)
    assert "cannot be read as statistics" in wrong


def test_statistics_of_rewards_alone_change_no_observation(tmp_path: Path) -> None:
    env = VecNormalize(RoughTurningVecEnv(SCENARIO, 2), norm_obs=False)
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=16, n_epochs=1, seed=1, device="cpu").learn(
        32
    )
    model.save(tmp_path / "mine.zip")
    env.save(str(tmp_path / "statistics.pkl"))
    run = Run.elsewhere("sb3", "RoughTurning-v0", SCENARIO, 9, "a command")
    _, actor = sb3_actor(tmp_path / "mine.zip", run, tmp_path / "statistics.pkl")
    expected, _ = model.predict(OBSERVATIONS[0], deterministic=True)
    np.testing.assert_allclose(ActorPolicy(actor, 5).act(OBSERVATIONS[0]), expected, atol=1e-5)


def network(path: Path, *nodes: onnx.NodeProto, opset: int = 20) -> Path:
    value = helper.make_tensor_value_info
    graph = helper.make_graph(nodes, "network", [value("x", 1, [1, 11])], [value("y", 1, None)])
    onnx.save(
        helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8), path
    )
    return path


SLICE = [
    helper.make_node("Constant", [], ["half"], value_floats=[0.5]),
    helper.make_node("Constant", [], ["pair"], value_ints=[0, 1]),
    helper.make_node("Gather", ["x", "pair"], ["first"], axis=1),
    helper.make_node("Mul", ["first", "half"], ["y"]),
]


@pytest.mark.parametrize("opset", [12, 13, 26, 27])
def test_all_operator_sets_that_can_be_run_are_accepted(
    opset: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = network(tmp_path / "mine.onnx", *SLICE, opset=opset), tmp_path / "out"
    if 13 <= opset <= 26:
        found = actions(exported(out, path))[0]
        np.testing.assert_allclose(found, np.clip(0.5 * OBSERVATIONS[0, :, :2], -1, 1))
    else:
        assert f"mine.onnx cannot be exported: uses operator sets [('', {opset})]" in refusal(
            capsys, out, path
        )


def test_what_an_onnx_file_lacks_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "mine.onnx", tmp_path / "out"
    network(path, *SLICE)
    assert "must have (number of environments, 12)" in refusal(
        capsys, out, path, "--scenario", "surface"
    )
    network(path, *SLICE, helper.make_node("Identity", ["y"], ["n"]))
    model = onnx.load(path)
    model.graph.output.append(helper.make_tensor_value_info("n", 1, None))
    onnx.save(model, path)
    assert "has 1 inputs and 2 outputs, but must have an observation and an action" in refusal(
        capsys, out, path
    )
    network(path, *SLICE, helper.make_node("NonZero", ["x"], ["z"]))
    assert "uses the operator 'NonZero'" in refusal(capsys, out, path)
    fixed = (
        helper.make_node("Constant", [], ["s"], value_ints=[1, 2]),
        helper.make_node("Reshape", ["first", "s"], ["y"]),
    )
    network(path, *SLICE[:3], *fixed)
    assert "was written for a batch of 1 and cannot act on others" in refusal(capsys, out, path)
    path.write_bytes(onnx_agents.content())
    assert "is an agent's file already" in refusal(capsys, out, path)
    path.write_bytes(b"text")
    assert "is no ONNX file" in refusal(capsys, out, path)


def finished(algorithm: Algorithm, runs: Path, **changes: object) -> Run:
    """A run that ends before it has begun: its agent is untrained."""
    run = small_run(algorithm, runs, SCENARIO, **changes)
    run.begin()
    model = new_model(run, algorithm)
    model.env = None
    model.save(run.policy)
    return run


CHANGES: dict[str, dict[str, object]] = {"ppo": {"position": True, "frames": 3}}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ppo", "sac", "recurrent_ppo", "analytic_gradient"])
def test_runs_of_every_network_can_be_exported(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = finished(ALGORITHMS[name], tmp_path, **CHANGES.get(name, {}))
    assert export.main([str(run.folder), "--out", str(tmp_path / "out"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    path = (
        tmp_path / "out" / f"{name}_short-seed3.onnx"
    )  # the name without the scenario is that of the agent that ships
    assert (told["path"], told["size"], told["observations"]) == (
        str(path),
        path.stat().st_size,
        10_000,
    )
    original, loaded = load_agent(run.folder), onnx_policy.load(path)
    assert (loaded.name, loaded.training_seed, loaded.trained_on) == (
        original.name,
        3,
        run.scenario,
    )
    assert (loaded.command, loaded.parameters, loaded.sha256) == (
        "a command",
        original.parameters,
        told["digest"],
    )
    mine, its = original.make(5), loaded.make(5)
    for observation in OBSERVATIONS:
        np.testing.assert_allclose(its.act(observation), mine.act(observation), rtol=0, atol=1e-5)


@pytest.mark.slow
def test_a_file_that_acts_otherwise_is_not_written(tmp_path: Path) -> None:
    class Fickle(Actor):
        def forward(
            self, observation: torch.Tensor, memory: torch.Tensor
        ) -> tuple[torch.Tensor, torch.Tensor]:
            action = (0.1 * observation[:, :2]).clamp(-1, 1)
            return action if torch.compiler.is_compiling() else action + 2.5e-5, memory

    with pytest.raises(ValueError, match="acts otherwise, by up to 2"):
        export.export_torch(Fickle(), tmp_path / "out.onnx", scenario=SCENARIO)
    assert not (tmp_path / "out.onnx").exists()


def test_runs_that_cannot_be_exported_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, run = tmp_path / "out", onnx_agents.run(tmp_path / "runs" / "ppo-seed0")
    assert "holds no agent" in refusal(capsys, out, run.folder)
    run.begin()
    assert "not finished" in refusal(capsys, out, run.folder)
    assert "--seed is for .zip and .onnx files" in refusal(
        capsys, out, finished(ALGORITHM, tmp_path).folder, "--seed", 1
    )
    runs = (
        finished(ALGORITHM, tmp_path / "one").folder,
        finished(ALGORITHM, tmp_path / "other").folder / "policy.zip",
    )
    assert "would both be" in refusal(capsys, out, *runs)
    assert "the name is '../x'" in refusal(capsys, out, runs[0], "--name", "../x")


def test_a_folder_stands_for_its_only_file(tmp_path: Path) -> None:
    onnx_agents.write(tmp_path)
    assert agent_file.read(tmp_path).metadata.label == "ppo-seed0"
    onnx_agents.write(tmp_path, 1)
    with pytest.raises(ValueError, match=r"is a folder with 2 \.onnx files"):
        onnx_policy.load(tmp_path)
    onnx_agents.run(tmp_path).begin()
    with pytest.raises(ValueError, match=r"holds a training run: python -m train\.export"):
        onnx_policy.load(tmp_path)
