"""Learning from recorded steps: ``bc``, ``iql`` and ``td3_bc``."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

pytest.importorskip("minari")

from leaderboard.agents import agent_file, onnx_policy
from leaderboard.agents.agent_file import informed
from leaderboard.inputs import Inputs
from tests.train.small import Interruption
from train import bc, datasets, export, iql, td3_bc
from train.offline import Batch, OfflineAlgorithm
from train.run import Run
from train.training import load_agent, stating_information, train
from turning_env import FAMILY_ID, Family, FamilyVectorEnv
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv

FAMILY = Family.load({"extends": "shop", "jobs": 16, "planned": {"control.time_limit": 0.1}})
"""Few jobs, of six steps each."""
MODELS = [FAMILY.job(seed).scenario for seed in range(2)]
ALGORITHMS = {module.ALGORITHM.name: module.ALGORITHM for module in (bc, iql, td3_bc)}
POLICIES: dict[str, Any] = {
    "bc": bc.OfflinePolicy,
    "iql": iql.IQLPolicy,
    "td3_bc": td3_bc.TD3BCPolicy,
}


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sets")
    datasets.record(FAMILY, "self_tuning", 8, folder)
    return folder


def small_run(name: str, sets: Path, folder: Path, **changes: Any) -> Run:
    settings = {
        "datasets": str(sets),
        "total_timesteps": 48,
        "n_updates": 120,
        "batch_size": 16,
        "net_arch": [8],
    }
    return Run.plan(name, FAMILY_ID, FAMILY, 1, folder, "a command", settings | changes)


def played_actions(make: Callable[[int], Any]) -> Any:
    """Return the actions of an agent on two jobs, shape (steps, jobs, action size)."""
    agent = make(2)
    env = FamilyVectorEnv(2, FAMILY)
    observations, _ = env.reset(seed=[0, 1])
    actions = []
    for _ in range(4):
        actions.append(agent.act(observations))
        observations, *_ = env.step(actions[-1])
    return np.stack(actions)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bc", "td3_bc"])
def test_a_trained_agent_is_loaded_and_plays_jobs(name: str, sets: Path, tmp_path: Path) -> None:
    run = small_run(name, sets, tmp_path, n_updates=5)
    train(run, ALGORITHMS[name])
    actions = played_actions(informed(load_agent(run.folder), MODELS))
    assert np.abs(actions).max() <= 1.0
    assert np.ptp(actions) > 0.0


@pytest.mark.slow
def test_an_interrupted_training_gives_the_same_agent_whose_file_states_what_it_was_given(
    sets: Path, tmp_path: Path
) -> None:
    algorithm = iql.ALGORITHM
    whole = small_run("iql", sets, tmp_path / "whole")
    cut = small_run("iql", sets, tmp_path / "cut")
    train(whole, algorithm)
    interrupting = replace(algorithm, callbacks=lambda run: [Interruption(30)])
    with pytest.raises(KeyboardInterrupt):
        train(cut, interrupting, checkpoint_every=1)
    assert cut.checkpoint.exists()
    train(cut, algorithm)

    path = Path(export.export(cut.folder, tmp_path / "agents")["path"])
    expected = played_actions(informed(load_agent(whole.folder), MODELS))
    exported = played_actions(informed(onnx_policy.load(path), MODELS))
    np.testing.assert_allclose(exported, expected, atol=1e-5)
    metadata = agent_file.read(path).metadata
    stated = Inputs.of(metadata.parameters)
    assert metadata.trained_steps == 48
    assert stated.training == ("rewards", "rule's actions")
    assert stated.agent_class == "student of a rule"
    assert stated.run_time == ("context", "derived inputs")


@pytest.mark.parametrize(
    ("name", "behaviour", "expected"),
    [
        ("iql", "random", "model-free agent"),
        ("bc", "self_tuning", "student of a rule"),
        ("td3_bc", "mixture", "student of a rule"),
        ("bc", "causal", "privileged agent"),
        ("iql", "causal", "privileged agent"),
    ],
)
def test_an_agent_is_ranked_by_what_the_data_sets_policy_knows(
    name: str, behaviour: str, expected: str, tmp_path: Path
) -> None:
    run = small_run(name, tmp_path, tmp_path, behaviour=behaviour)
    assert Inputs.of(stating_information(run).parameters).agent_class == expected


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"behaviour": "random"}, "holds no data set"),
        ({"total_timesteps": 49}, "at most 48"),
        ({"derived": False}, "derived inputs"),
    ],
)
def test_a_data_set_that_does_not_fit_is_refused(
    changes: dict[str, Any], message: str, sets: Path, tmp_path: Path
) -> None:
    run = small_run("bc", sets, tmp_path, **changes)
    with pytest.raises(ValueError, match=message):
        train(run, bc.ALGORITHM)
    assert not run.policy.exists()


@pytest.mark.slow
def test_a_data_set_of_another_policy_is_refused(sets: Path, tmp_path: Path) -> None:
    (tmp_path / "shop-causal-v0").symlink_to(sets / "shop-self_tuning-v0")
    run = small_run("bc", tmp_path, tmp_path / "runs", behaviour="causal")
    with pytest.raises(ValueError, match="is not of family 'shop' and causal"):
        train(run, bc.ALGORITHM)


def learner(name: str, **changes: Any) -> Any:
    """Return an untrained learner on observations of 11 and actions of 2 entries."""
    algorithm = ALGORITHMS[name]
    model: type[Any] = algorithm.model
    return model(
        POLICIES[name],
        RoughTurningVecEnv("rough_turning", 1),
        3e-3,
        settings=SimpleNamespace(**{**algorithm.defaults, **changes}),
        policy_kwargs={"net_arch": [32]},
        seed=0,
    )


def updated(model: OfflineAlgorithm, draw: Callable[[], Batch], updates: int) -> list[float]:
    """Update a learner; return the first of its losses by update."""
    losses = []
    for _ in range(updates):
        losses.append(next(iter(model.update(draw()).values())))
    return losses


def test_bc_reproduces_a_linear_policy() -> None:
    weights = 0.1 * torch.randn(11, 2, generator=torch.Generator().manual_seed(1))

    def draw() -> Batch:
        observations = torch.randn(128, 11)
        return Batch(
            observations=observations,
            actions=observations @ weights,
            rewards=torch.zeros(128),
            next_observations=observations,
            goes_on=torch.ones(128),
        )

    model = learner("bc")
    losses = updated(model, draw, updates=300)
    assert losses[-1] < 0.02 * losses[0]
    observations = np.random.default_rng(2).normal(size=(50, 11)).astype(np.float32)
    actions, _ = model.predict(observations)
    np.testing.assert_allclose(actions, observations @ weights.numpy(), atol=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["iql", "td3_bc"])
def test_rewards_move_the_agent_from_the_mean_action_to_the_best_one(name: str) -> None:
    best = torch.tensor([0.5, -0.5])

    def draw() -> Batch:
        observations = torch.randn(128, 11)
        actions = 2.0 * torch.rand(128, 2) - 1.0
        return Batch(
            observations=observations,
            actions=actions,
            rewards=-4.0 * (actions - best).square().sum(dim=1),
            next_observations=observations,
            goes_on=torch.zeros(128),
        )

    model = learner(name, tau=0.05)
    updated(model, draw, updates=300)
    actions, _ = model.predict(np.zeros((1, 11), np.float32))
    # Imitation alone would take the mean of the recorded actions, 0.
    assert actions[0, 0] > 0.25
    assert actions[0, 1] < -0.25
