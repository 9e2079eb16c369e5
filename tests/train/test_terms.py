"""Terms of training charge what they should, and actors are shown in play what their training showed."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.train.small import SCENARIO, small_run
from tests.turning_env.playing import changed
from train import analytic_gradient, ppo
from train.terms import ShapedVecEnv
from train.training import Algorithm, train
from turning_env import RoughTurningVectorEnv

# Of its edges some wear out, some break, and some last till the end.
MIXED = changed(SCENARIO, tool={"edge_strength": 1500.0, "edge_strength_spread": 0.3}, control={"time_limit": 0.3})
NUM_ENVS = 8


@pytest.mark.parametrize("life_price", ["end", "marginal"])
def test_training_rewards_charge_whole_edges_alike(life_price: str) -> None:
    ours, single = ShapedVecEnv(life_price, MIXED, NUM_ENVS, 0.5), RoughTurningVectorEnv(NUM_ENVS, MIXED, "SameStep")
    ours.seed(5)
    ours.reset()
    single.reset(seed=5)
    generator = np.random.default_rng(1)
    learned, kinds = np.zeros(NUM_ENVS), set()
    at_end = ours.potential(np.array(1.0)) if life_price == "marginal" else 0.0
    for _ in range(400):
        actions = generator.uniform(-0.5, 1.0, (NUM_ENVS, 2)).astype(np.float32)
        _, rewards, dones, infos = ours.step(actions)
        *_, terminated, truncated, terms = single.step(actions)
        learned += rewards / 0.5
        for index in np.flatnonzero(dones):
            used, broken = (terms["final_info"][name][index] for name in ("used_life", "broken"))
            kinds.add("unfinished" if truncated[index] else "broken" if broken else "worn")
            more = at_end if terminated[index] else ours.potential(used)
            assert learned[index] == pytest.approx(infos[index]["episode"]["r"] + more, rel=1e-4, abs=1e-2)
            learned[index] = 0.0
    assert kinds == {"unfinished", "broken", "worn"}


def test_an_analytic_gradient_agent_has_its_own_terms(tmp_path: Path) -> None:
    run = small_run(analytic_gradient.ALGORITHM, tmp_path, position=False, life_price="flat", memory=False)
    actor = analytic_gradient.ALGORITHM.actor(train(run, analytic_gradient.ALGORITHM))
    observation, other = torch.rand(3, 11), torch.rand(3, actor.memory_size)
    with torch.no_grad():
        first, _ = actor(observation, torch.zeros(3, actor.memory_size))
        assert torch.equal(first, actor(observation, other)[0])


@pytest.mark.parametrize(
    ("algorithm", "parameters", "message"),
    [
        (ppo.ALGORITHM, {"life_price": "margin"}, "must be one of flat, marginal, end"),
        (ppo.ALGORITHM, {"frames": 0}, "frames is 0, but must be 1 to 100"),
        (ppo.ALGORITHM, {"activation": "gelu"}, r"KeyError\('gelu'\)"),
        (ppo.ALGORITHM, {"num_envs": 0}, "num_envs is 0"),
        (analytic_gradient.ALGORITHM, {"life_price": "end"}, "must be marginal or flat"),
    ],
)
def test_hyperparameters_that_no_model_can_have_are_named(
    algorithm: Algorithm, parameters: dict[str, object], message: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message):
        train(small_run(algorithm, tmp_path, **parameters), algorithm)
