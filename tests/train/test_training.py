import io
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from leaderboard import score
from leaderboard.agents import onnx_policy
from leaderboard.agents.agent_file import informed, seen_space
from leaderboard.play import play_family
from leaderboard.seeds import TUNING_START
from tests.train.small import ALGORITHMS, SCENARIO, Interruption, small_run
from tests.turning_env.test_family_env import BRIEF
from train import dagger, export, ppo, training
from train.actor import ActorPolicy
from train.run import Run, hyperparameters
from train.terms import Terms
from train.training import SEED_STRIDE, SEEDS, Algorithm, new_model, train
from turning_env import FAMILY_ID, IDS, Family, RoughTurningVectorEnv, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.batch.driver import action_space

PPO = ALGORITHMS["ppo"]


NUM_ENVS = 6
TERMS = {
    "belief": True,
    "position": True,
    "frames": 3,
    "life_price": "marginal",
    "asymmetric": True,
}


TRAININGS = [pytest.param(algorithm, {}, id=name) for name, algorithm in ALGORITHMS.items()]
TRAININGS.append(pytest.param(PPO, TERMS, id="ppo_with_terms"))


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "terms"), TRAININGS)
def test_an_interrupted_training_gives_the_same_agent(
    algorithm: Algorithm, terms: dict[str, Any], tmp_path: Path
) -> None:
    whole = small_run(algorithm, tmp_path / "whole", **terms)
    cut = small_run(algorithm, tmp_path / "cut", **terms)
    train(whole, algorithm, checkpoint_every=256)
    callbacks = algorithm.callbacks(cut)
    interrupting = replace(algorithm, callbacks=lambda run: [*callbacks, Interruption(550)])
    with pytest.raises(KeyboardInterrupt):
        train(cut, interrupting, checkpoint_every=256)
    assert cut.checkpoint.exists()
    assert not cut.policy.exists()
    train(cut, algorithm, checkpoint_every=256)

    model = algorithm.model.load(whole.policy, device="cpu")
    resumed = algorithm.model.load(cut.policy, device="cpu")
    assert _bytes(model.get_parameters()) == _bytes(resumed.get_parameters())
    _assert_acts_as(cut, algorithm, model)

    rows = whole.read_learning_curve()
    resumed_rows = cut.read_learning_curve()
    assert rows[-1]["steps"] == 1024
    for row, resumed_row in zip(rows, resumed_rows, strict=True):
        assert row | {"wall_time": 0.0} == resumed_row | {"wall_time": 0.0}
    wall_times = [row["wall_time"] for row in resumed_rows]
    assert (np.diff(wall_times) > 0.0).all()


def test_training_seeds_have_their_own_bars(tmp_path: Path) -> None:
    observations = new_model(small_run(PPO, tmp_path), PPO).env.reset()
    expected, _ = RoughTurningVectorEnv(len(observations), SCENARIO).reset(seed=3 * SEED_STRIDE)
    np.testing.assert_array_equal(observations, expected)
    assert SEEDS * SEED_STRIDE <= TUNING_START


def _bytes(parameters: Any) -> bytes:
    """Return weights and optimisers' states as bytes."""
    stream = io.BytesIO()
    torch.save(parameters, stream)
    return stream.getvalue()


def _assert_acts_as(run: Run, algorithm: Algorithm, model: Any) -> None:
    """Assert that the agent of a run acts on plain observations as its model on its inputs."""
    loaded = training.load_agent(run.folder)
    assert loaded.name == f"{run.algorithm}_short"
    assert loaded.training_seed == 3
    assert loaded.command == "a command --runs here"
    policy = informed(loaded, SCENARIO)(NUM_ENVS)
    network = ActorPolicy(algorithm.network(model.policy), NUM_ENVS)
    plain = RoughTurningVecEnv(SCENARIO, NUM_ENVS)
    plain.seed(7)
    shown = RoughTurningVecEnv(SCENARIO, NUM_ENVS, wrapper=Terms.of(run).wrapped)
    shown.seed(7)
    observations = plain.reset()
    seen = shown.reset()
    starts = np.ones(NUM_ENVS, np.bool_)
    state = None
    ends = 0
    # Some agents cut slowly.
    for step in range(1000):
        if step >= 120 and ends > 1:
            break
        ends += starts.any()
        policy.reset(starts)
        actions = policy.act(observations)
        assert not isinstance(seen, dict | tuple)
        network.reset(starts)
        expected = network.act(seen)
        if algorithm.name not in ("analytic_gradient", "simulator_gradient"):
            predicted, state = model.predict(
                seen,
                state,
                starts,
                deterministic=True,
            )
            np.testing.assert_allclose(expected, predicted, atol=1e-6)
        np.testing.assert_allclose(actions, expected, atol=1e-6)
        assert actions.dtype == np.float32
        observations, *_ = plain.step(actions)
        seen, _, starts, _ = shown.step(actions)
    assert ends > 1


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ALGORITHMS.values(), ids=ALGORITHMS)
def test_there_is_an_agent_for_every_id_that_it_plays(algorithm: Algorithm, tmp_path: Path) -> None:
    for preset in IDS.values():
        scenario = Scenario.load(preset)
        run = small_run(algorithm, tmp_path, scenario)
        if not algorithm.plays(scenario):
            with pytest.raises(ValueError, match=f"{algorithm.name} cannot learn on scenario"):
                train(run, algorithm)
            continue
        run.begin()
        new_model(run, algorithm).save(run.policy)
        actor = algorithm.actor(run)
        seen = seen_space(run.env_id, scenario, run.parameters)
        observation = torch.from_numpy(seen.sample()[None])
        action, memory = actor(observation, torch.zeros(1, actor.memory_size))
        assert action.shape == (1, *(action_space(scenario).shape or ()))
        assert memory.shape == (1, actor.memory_size)


def test_an_algorithm_for_families_refuses_a_single_scenario(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"not on scenario 'short': choose --env RoughTurning-Fam"):
        train(small_run(dagger.ALGORITHM, tmp_path), dagger.ALGORITHM)
    assert not any(tmp_path.iterdir())


@pytest.mark.slow
def test_an_agent_learns_on_a_family_and_its_file_is_scored(tmp_path: Path) -> None:
    for algorithm in (PPO, ALGORITHMS["recurrent_ppo"], ALGORITHMS["sac"]):
        terms = {} if algorithm.name == "recurrent_ppo" else {"frames": 2}
        run = small_run(
            algorithm, tmp_path, env_id=FAMILY_ID, scenario=Family.load("shop"), **terms
        )
        assert (
            train(run, algorithm)
            == tmp_path / FAMILY_ID / "shop" / f"{algorithm.name}-seed3" / "policy.zip"
        )
        assert export.main([str(run.folder), "--out", str(tmp_path)]) == 0
        assert score(str(tmp_path / f"{algorithm.name}-seed3.onnx"), FAMILY_ID, seeds=2).ranked > 5
    for algorithm in (ALGORITHMS["analytic_gradient"], ALGORITHMS["lagrangian_ppo"]):
        with pytest.raises(ValueError, match="learns on one scenario, not on the jobs of a family"):
            train(
                small_run(
                    algorithm,
                    tmp_path,
                    env_id=FAMILY_ID,
                    scenario=Family.load("shop"),
                ),
                algorithm,
            )
    with pytest.raises(ValueError, match="position and life_price"):
        train(
            small_run(
                PPO,
                tmp_path / "other",
                env_id=FAMILY_ID,
                scenario=Family.load("shop"),
                position=True,
            ),
            PPO,
        )


@pytest.mark.slow
def test_an_agent_with_a_belief_plays_alike_from_its_run_and_from_its_file(tmp_path: Path) -> None:
    # Of short episodes, because all of them are played twice, step by step.
    family = Family.model_validate(BRIEF | {"held_out_jobs": 3})
    run = small_run(
        PPO,
        tmp_path,
        env_id=FAMILY_ID,
        scenario=family,
        total_timesteps=512,
        belief=True,
        frames=2,
    )
    train(run, PPO)
    assert export.main([str(run.folder), "--out", str(tmp_path)]) == 0
    agent = onnx_policy.load(next(tmp_path.glob("*.onnx")))
    seeds = range(3)
    split = training.VALIDATION
    make = informed(agent, [family.job(seed, split).scenario for seed in seeds])
    expected = training.play_agent(run.folder, 1)["return"]
    np.testing.assert_allclose(
        play_family(family, split, seeds, make)["return"], expected, rtol=1e-3
    )


def test_a_finished_training_is_not_repeated_and_one_with_other_settings_left_alone(
    tmp_path: Path, capsys
) -> None:
    algorithm = ALGORITHMS["sac"]
    few = {"buffer_size": 100_000, "total_timesteps": 64}
    run = small_run(algorithm, tmp_path, **few)
    with pytest.raises(
        ValueError, match="frames is 0"
    ):  # leaves nothing behind that the next training would resume
        train(small_run(algorithm, tmp_path, **few, frames=0), algorithm)
    path = train(run, algorithm)
    before = path.stat()
    assert train(run, algorithm) == path
    assert path.stat().st_mtime_ns == before.st_mtime_ns
    assert before.st_size < 1_000_000  # it holds no environments
    assert not run.checkpoint.exists()
    with pytest.raises(ValueError, match="holds a training with other settings"):
        train(small_run(algorithm, tmp_path, **few, gamma=0.9), algorithm)
    training.load_agent(run.folder)
    assert f"warning: {run.policy} is a pickle, which can run code" in capsys.readouterr().err


def test_the_command_trains_with_the_given_hyperparameters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = [
        "learning_rate=3e-4",
        "activation_fn=tanh",
        "net_arch=[8]",
        "initial_actions=[-0.5]",
        "gamma=0",
    ]
    given = [word for setting in settings for word in ("--set", setting)]
    arguments = [
        "--env",
        "RoughTurning-Paper-v0",
        "--steps",
        "100",
        "--runs",
        str(tmp_path),
        *given,
    ]
    assert ppo.main(arguments) == 0
    path = Path(capsys.readouterr().out.strip())
    assert path == tmp_path / "RoughTurning-Paper-v0" / "paper" / "ppo-seed0" / "policy.zip"
    policy = training.load_agent(path.parent)
    assert policy.command == f"python -m train.ppo {shlex.join(arguments)}"
    changed = {
        "learning_rate": 3e-4,
        "activation_fn": "tanh",
        "net_arch": [8],
        "initial_actions": [-0.5],
    }
    changed |= {"gamma": 0.0, "total_timesteps": 100}
    changed["training_information"] = ["rewards"]
    assert policy.parameters == hyperparameters("ppo", "RoughTurning-Paper-v0") | changed
