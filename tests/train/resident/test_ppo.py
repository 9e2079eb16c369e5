"""PPO on tensors: its parts against plain formulas, and that it learns."""

import math

import pytest
import torch

from tests.turning_env.playing import SHORT_LIVED
from train.resident.lathes import Answer, ProcessorLathes, Tensor
from train.resident.ppo import Learner, Network, Rollout, advantages
from train.run import hyperparameters

PARAMETERS = hyperparameters("ppo", "RoughTurning-v0") | {"lanes": 64, "rollout": 16, "batch_size": 256}


@pytest.fixture(autouse=True)
def _one_thread():
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


class Target:
    """Earns most where the action is 0.5; every fifth step starts an episode anew, and a step before is its end."""

    device = torch.device("cpu")
    lanes, actions = 64, 1

    def __init__(self) -> None:
        self.steps = 0

    def reset(self, seed: int) -> Tensor:
        return torch.ones(self.lanes, 1)

    def step(self, actions: Tensor) -> Answer:
        self.steps += 1
        anew = self.steps % 5 == 0
        # A reward where nothing is decided would mislead who counted it.
        rewards = 100.0 * actions[:, 0] if anew else -((actions[:, 0] - 0.5) ** 2)
        ends = torch.full((self.lanes,), self.steps % 5 == 4)
        return torch.ones(self.lanes, 1), rewards.double(), ends, torch.zeros_like(ends)

    def wait(self) -> None:
        pass


def test_it_learns_from_steps_that_an_action_decides():
    learner = Learner(Target(), PARAMETERS | {"reward_scale": 1.0, "discount": 0.0, "hidden_layers": [8]}, 0)
    assert abs(learner.network.policy(torch.ones(1))) < 0.1
    for _ in learner.learn(64 * 16 * 40):
        pass
    assert learner.network.policy(torch.ones(1)).item() == pytest.approx(0.5, abs=0.05)
    assert learner.network.log_deviation.item() < PARAMETERS["initial_log_deviation"]


def test_probabilities_are_those_of_normal_distributions():
    network = Network(3, 2, PARAMETERS)
    torch.nn.init.normal_(network.policy[-1].weight)
    observations, actions = torch.randn(5, 7, 3), torch.randn(5, 7, 2)
    normal = torch.distributions.Normal(network.policy(observations), network.log_deviation.exp())
    expected = normal.log_prob(actions).sum(-1)
    assert torch.allclose(network.log_probability(observations, actions), expected, atol=1e-5)


def test_advantages_are_sums_of_what_surprises():
    """One lane: terminated after the second of four intervals, then started anew, truncated after the last."""
    rewards, values = torch.tensor([1.0, 2.0, 0.0, 4.0]), torch.tensor([0.5, 1.5, 2.5, 3.5, 4.5])
    terminated, ended = torch.tensor([0.0, 1.0, 0.0, 0.0]), torch.tensor([0.0, 1.0, 0.0, 1.0])
    empty = torch.zeros(0)
    rollout = Rollout(empty, empty, empty, *(t[:, None] for t in (rewards, terminated, ended, 1.0 - ended)))
    discount, share = 0.8, 0.9
    last = 4.0 + discount * 4.5 - 3.5
    third = 0.0 + discount * 3.5 - 2.5 + discount * share * last
    second = 2.0 - 1.5
    first = 1.0 + discount * 1.5 - 0.5 + discount * share * second
    found = advantages(values[:, None], rollout, discount, share)
    assert torch.allclose(found[:, 0], torch.tensor([first, second, third, last]))


def test_a_rollout_holds_what_was_played():
    parameters = PARAMETERS | {"rollout": 40}
    learner = Learner(ProcessorLathes(SHORT_LIVED, 64), parameters, 3)
    first, mean_return = learner.roll_out()
    second, _ = learner.roll_out()
    assert torch.equal(first.observations[-1], second.observations[0])
    ended = torch.cat([first.ended, second.ended])
    counted = torch.cat([first.counted, second.counted])
    assert ended.sum() > 64
    assert torch.equal(counted[1:], 1.0 - ended[:-1])
    assert (torch.cat([first.rewards, second.rewards])[counted == 0.0] == 0.0).all()
    assert (first.terminated <= first.ended).all()
    assert 0 < first.terminated.sum() < first.ended.sum()

    earned, returns = torch.zeros(64), []
    for rewards, ends in zip(first.rewards / parameters["reward_scale"], first.ended, strict=True):
        earned += rewards
        returns += earned[ends > 0].tolist()
        earned[ends > 0] = 0.0
    assert mean_return.item() == pytest.approx(sum(returns) / len(returns), rel=1e-4)

    replayed = ProcessorLathes(SHORT_LIVED, 64)
    present = replayed.reset(3_000_000)
    for t, actions in enumerate(first.actions):
        assert torch.equal(present, first.observations[t])
        present, rewards, *_ = replayed.step(actions.clamp(-1.0, 1.0))
        assert torch.equal((rewards * parameters["reward_scale"]).float(), first.rewards[t])


def test_a_training_comes_out_the_same_again():
    def trained(seed: int) -> list[float]:
        learner = Learner(ProcessorLathes(SHORT_LIVED, 64), PARAMETERS, seed)
        where = [progress.intervals for progress in learner.learn(1500)]
        assert where == [1024, 2048]
        return torch.cat([tensor.flatten() for tensor in learner.network.parameters()]).tolist()

    before = torch.get_rng_state()
    assert trained(1) == trained(1) != trained(2)
    assert torch.equal(torch.get_rng_state(), before)
    assert all(map(math.isfinite, trained(1)))


@pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no GPU")
def test_all_of_it_stays_on_the_gpu():
    pytest.importorskip("numba_cuda")
    from train.resident.lathes import AcceleratorLathes

    learner = Learner(AcceleratorLathes(SHORT_LIVED, 64), PARAMETERS | {"rollout": 40}, 3)
    rollout, _ = learner.roll_out()
    learner.update(rollout)
    learner.lathes.wait()
    assert all(tensor.is_cuda for tensor in (*rollout, *learner.network.parameters()))
    replayed = ProcessorLathes(SHORT_LIVED, 64)
    present = replayed.reset(3_000_000)
    for t, actions in enumerate(rollout.actions.cpu()):
        assert torch.equal(present, rollout.observations[t].cpu())
        present, *_ = replayed.step(actions.clamp(-1.0, 1.0))
