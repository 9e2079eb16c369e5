"""Terms of a training charge what they should, and agents see in play what training showed."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.vector import AutoresetMode

from leaderboard.agents import agent_file, onnx_policy
from tests.train.small import SCENARIO, small_run
from tests.turning_env.playing import changed
from train import analytic_gradient, export, ppo
from train.agent_inputs import HiddenStateWrapper
from train.life_price import LifePriceVecEnv
from train.training import Algorithm, train
from turning_env import FAMILY_ID, Family, FamilyVectorEnv, RoughTurningVectorEnv

# Of its edges some wear out, some break, and some last till the end.
MIXED = changed(
    SCENARIO,
    tool={"edge_strength": 1500.0, "edge_strength_spread": 0.3},
    control={"time_limit": 0.3},
)
NUM_ENVS = 8
FAMILY = Family.model_validate(Family.load("shop").model_dump() | {"jobs": 16})
FEW_STEPS = 256
"""One update: what an agent sees does not depend on the length of its training."""


@pytest.mark.parametrize("life_price", ["end", "marginal"])
def test_training_rewards_charge_whole_edges_alike(life_price: str) -> None:
    env = LifePriceVecEnv(life_price, MIXED, NUM_ENVS, 0.5)
    env.seed(5)
    env.reset()
    # Its infos hold the states at the ends of episodes.
    vector_env = RoughTurningVectorEnv(NUM_ENVS, MIXED, "SameStep")
    vector_env.reset(seed=5)
    generator = np.random.default_rng(1)
    training_returns = np.zeros(NUM_ENVS)
    ends = set()
    potential_at_end = env.potential(np.array(1.0)) if life_price == "marginal" else 0.0
    for _ in range(400):
        actions = generator.uniform(-0.5, 1.0, (NUM_ENVS, 2)).astype(np.float32)
        _, rewards, ended, infos = env.step(actions)
        *_, truncated, vector_infos = vector_env.step(actions)
        training_returns += rewards / 0.5
        for index in np.flatnonzero(ended):
            potential = potential_at_end
            if truncated[index]:
                ends.add("unfinished")
                potential = env.potential(vector_infos["final_info"]["used_life"][index])
            elif vector_infos["final_info"]["broken"][index]:
                ends.add("broken")
            else:
                ends.add("worn")
            expected = infos[index]["episode"]["r"] + potential
            assert training_returns[index] == pytest.approx(expected, rel=1e-4, abs=1e-2)
            training_returns[index] = 0.0
    assert ends == {"unfinished", "broken", "worn"}


@pytest.mark.parametrize(
    ("algorithm", "wrong", "message"),
    [
        (ppo.ALGORITHM, {"life_price": "margin"}, "must be one of flat, marginal, end"),
        (ppo.ALGORITHM, {"frames": 0}, "frames is 0, but must be 1 to 100"),
        (ppo.ALGORITHM, {"num_envs": 0}, "num_envs is 0"),
        (ppo.ALGORITHM, {"hides_context": True}, "is no family"),
        (analytic_gradient.ALGORITHM, {"life_price": "end"}, "must be marginal or flat"),
    ],
    ids=["life_price", "frames", "num_envs", "no context", "life_price of a teacher"],
)
def test_hyperparameters_that_no_model_can_have_are_named(
    algorithm: Algorithm, wrong: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message):
        train(small_run(algorithm, tmp_path, **wrong), algorithm)


def test_the_hidden_state_is_that_of_the_step_and_of_the_job() -> None:
    env = HiddenStateWrapper(RoughTurningVectorEnv(NUM_ENVS, MIXED, "SameStep"), MIXED)
    env.reset(seed=5)
    ended = 0
    for _ in range(300):
        observations, _, terminated, truncated, infos = env.step(
            np.full((NUM_ENVS, 2), 0.5, np.float32)
        )
        np.testing.assert_allclose(observations[:, -env.hidden], infos["hardness"], rtol=1e-6)
        for i in np.flatnonzero(terminated | truncated):
            ended += 1
            assert infos["final_obs"][i][-1] == pytest.approx(
                infos["final_info"]["wear"][i] / MIXED.tool.wear_criterion
            )
    assert ended >= NUM_ENVS
    jobs = FamilyVectorEnv(2, FAMILY, autoreset_mode=AutoresetMode.SAME_STEP)
    first, second = HiddenStateWrapper(jobs, MIXED).reset(seed=[3, 4])[0][:, -10:]
    assert (first != second).all()


@pytest.mark.slow
def test_an_agent_does_not_see_a_hidden_context(tmp_path: Path) -> None:
    run = small_run(
        ppo.ALGORITHM,
        tmp_path,
        env_id=FAMILY_ID,
        scenario=FAMILY,
        total_timesteps=FEW_STEPS,
        frames=2,
        hides_context=True,
    )
    train(run, ppo.ALGORITHM)
    agent = onnx_policy.load(Path(export.export(run.folder, tmp_path)["path"]))
    random = np.random.default_rng(0)
    entries = 12 + len(FAMILY.context_names)
    seen = random.uniform(0.0, 1.0, (5, entries)).astype(np.float32)
    of_another_context = seen.copy()
    of_another_context[:, 12:] = 0.0
    of_another_state = seen.copy()
    of_another_state[:, 0] = 0.0
    expected = agent.make(5).act(seen)
    np.testing.assert_array_equal(agent.make(5).act(of_another_context), expected)
    assert (agent.make(5).act(of_another_state) != expected).any()


@pytest.mark.slow
def test_only_the_critic_sees_the_hidden_state(tmp_path: Path) -> None:
    run = small_run(
        ppo.ALGORITHM,
        tmp_path,
        env_id=FAMILY_ID,
        scenario=FAMILY,
        total_timesteps=FEW_STEPS,
        belief=True,
        asymmetric=True,
    )
    model = ppo.LeanPPO.load(train(run, ppo.ALGORITHM), device="cpu")
    agent = onnx_policy.load(Path(export.export(run.folder, tmp_path)["path"]))
    policy = agent.make(5)
    shape = model.observation_space.shape
    assert shape is not None
    seen = torch.rand(5, *shape)
    # The actor sees the first entries, the critic all.
    entries = len(agent_file.read(tmp_path).metadata.observation_space.low)
    with_other_state = torch.cat([seen[:, :entries], -seen[:, entries:]], dim=1)
    for observations in (seen, with_other_state):
        expected, _ = model.predict(observations.numpy(), deterministic=True)
        actions = policy.act(observations[:, :entries].numpy())
        np.testing.assert_allclose(actions, expected, atol=1e-5)
    values = model.policy.predict_values(seen)
    other_values = model.policy.predict_values(with_other_state)
    assert (values != other_values).all()
