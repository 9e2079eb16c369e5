"""PPO on tensors of one device: rollouts, advantages and updates, without a copy to another.

The settings are those of ``train/hyperparameters/ppo.toml``. (Schulman et al. 2017, arXiv 1707.06347; generalised advantages:
Schulman et al. 2015, arXiv 1506.02438.)
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import torch

from train.feedforward import Feedforward
from train.resident.lathes import Tensor, TensorLathes
from train.training import ACTIVATIONS, SEED_STRIDE

_LOG_ROOT_2_PI = 0.9189385332046727


class Network(torch.nn.Module):
    """Policy and value function: two networks of the same form, and the logarithms of the actions' standard deviations."""

    def __init__(self, entries: int, actions: int, parameters: dict[str, Any]) -> None:
        super().__init__()
        hidden, activation = parameters["hidden_layers"], ACTIVATIONS[parameters["activation"]]
        self.policy = _layers([entries, *hidden, actions], activation, 0.01)
        self.value = _layers([entries, *hidden, 1], activation, 1.0)
        self.log_deviation = torch.nn.Parameter(torch.full((actions,), float(parameters["initial_log_deviation"])))
        means = parameters.get("initial_actions", [])
        last: Any = self.policy[-1]
        with torch.no_grad():
            last.bias[: len(means)] = torch.tensor(means)

    def log_probability(self, observations: Tensor, actions: Tensor) -> Tensor:
        """Of actions drawn by the policy, shape (...)."""
        scaled: Tensor = (actions - self.policy(observations)) * torch.exp(-self.log_deviation)
        return (-0.5 * scaled * scaled - self.log_deviation - _LOG_ROOT_2_PI).sum(-1)

    def actor(self) -> Feedforward:
        """The agent as it plays: its most likely action."""
        return Feedforward(*self.policy)


def _layers(sizes: Sequence[int], activation: type[torch.nn.Module], last_gain: float) -> torch.nn.Sequential:
    layers: list[torch.nn.Module] = []
    for place, (inputs, outputs) in enumerate(pairwise(sizes)):
        layer = torch.nn.Linear(inputs, outputs)
        is_last = place == len(sizes) - 2
        torch.nn.init.orthogonal_(layer.weight, last_gain if is_last else 2.0**0.5)
        torch.nn.init.zeros_(layer.bias)
        layers += [layer] if is_last else [layer, activation()]
    return torch.nn.Sequential(*layers)


class Rollout(NamedTuple):
    """What was seen and done in some intervals of all lanes: first axis intervals, second lanes."""

    observations: Tensor
    """Shape (intervals + 1, lanes, entries)."""
    actions: Tensor
    log_probabilities: Tensor
    rewards: Tensor
    """Scaled."""
    terminated: Tensor
    """Float, 0 or 1."""
    ended: Tensor
    """Likewise: terminated or truncated."""
    counted: Tensor
    """Likewise: 0 where an episode was started anew, which no action decides."""


def advantages(values: Tensor, rollout: Rollout, discount: float, gae_lambda: float) -> Tensor:
    """Generalised advantages, shape (intervals, lanes), for values of shape (intervals + 1, lanes).

    The observation after an episode's last interval is that episode's own: where it was truncated, its value stands for the rest.
    """
    result = torch.zeros_like(rollout.rewards)
    following = torch.zeros_like(values[0])
    for t in reversed(range(len(result))):
        surprise = rollout.rewards[t] + discount * values[t + 1] * (1.0 - rollout.terminated[t]) - values[t]
        following = surprise + discount * gae_lambda * (1.0 - rollout.ended[t]) * following
        result[t] = following
    return result


@dataclass
class Progress:
    """Where a training stands."""

    intervals: int
    """So far, of all lanes."""
    mean_return: float
    """Of the episodes that ended in the last rollout [s]; NaN if none did."""


class Learner:
    """PPO for a network on lathes of the same device.

    Args:
        lathes: what to learn from.
        parameters: the values of ``train/hyperparameters/ppo.toml``; ``lanes`` is what the lathes have.
        seed: of the training: of network, actions and bars.
    """

    def __init__(self, lathes: TensorLathes, parameters: dict[str, Any], seed: int) -> None:
        self.lathes, self.parameters = lathes, parameters
        self._generator = torch.Generator(lathes.device).manual_seed(seed)
        self._present = lathes.reset(seed * SEED_STRIDE)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.network = Network(self._present.shape[1], lathes.actions, parameters).to(lathes.device)
        self._optimizer = torch.optim.Adam(self.network.parameters(), lr=parameters["learning_rate"], eps=1e-5)
        self._ended = torch.zeros(lathes.lanes, device=lathes.device)
        self._returns = torch.zeros(lathes.lanes, device=lathes.device, dtype=torch.float64)

    def learn(self, intervals: int) -> Iterator[Progress]:
        """Learn for at least so many intervals; say after each update where it stands."""
        p, done = self.parameters, 0
        while done < intervals:
            share = done / intervals
            rate = p["learning_rate"] + share * (p["final_learning_rate"] - p["learning_rate"])
            for group in self._optimizer.param_groups:
                group["lr"] = rate
            rollout, mean_return = self.roll_out()
            self.update(rollout)
            done += rollout.rewards.numel()
            yield Progress(done, float(mean_return))

    @torch.no_grad()
    def roll_out(self) -> tuple[Rollout, Tensor]:
        """Play ``rollout`` intervals in every lane; return them, and the mean return [s] of the episodes that ended."""
        lathes, count = self.lathes, self.parameters["rollout"]

        def room(*shape: int) -> Tensor:
            return torch.empty(count, lathes.lanes, *shape, device=lathes.device)

        observations = torch.empty(count + 1, *self._present.shape, device=lathes.device)
        rollout = Rollout(observations, room(lathes.actions), room(), room(), room(), room(), room())
        deviation = torch.exp(self.network.log_deviation)
        earned, episodes = torch.zeros(2, device=lathes.device, dtype=torch.float64)
        for t in range(count):
            rollout.observations[t] = self._present
            mean = self.network.policy(rollout.observations[t])
            noise = torch.randn(mean.shape, generator=self._generator, device=lathes.device)
            rollout.actions[t] = mean + deviation * noise
            rollout.counted[t] = 1.0 - self._ended
            self._present, rewards, terminated, truncated = lathes.step(rollout.actions[t].clamp(-1.0, 1.0))
            rollout.rewards[t] = rewards * self.parameters["reward_scale"]
            rollout.terminated[t] = terminated
            rollout.ended[t] = terminated | truncated
            self._ended = rollout.ended[t]
            self._returns += rewards
            earned += (self._returns * self._ended).sum()
            episodes += self._ended.sum()
            self._returns *= 1.0 - self._ended
        rollout.observations[count] = self._present
        flat = rollout.observations[:-1].flatten(0, 1), rollout.actions.flatten(0, 1)
        rollout.log_probabilities.copy_(self.network.log_probability(*flat).view(count, lathes.lanes))
        return rollout, earned / episodes

    def update(self, rollout: Rollout) -> None:
        """Improve policy and value function by what was seen, several times over, in batches drawn at random."""
        p = self.parameters
        with torch.no_grad():
            values = self.network.value(rollout.observations).squeeze(-1)
            advantage = advantages(values, rollout, p["discount"], p["gae_lambda"])
        data = [
            tensor.flatten(0, 1)
            for tensor in (
                rollout.observations[:-1],
                rollout.actions,
                rollout.log_probabilities,
                advantage,
                advantage + values[:-1],
                rollout.counted,
            )
        ]
        for _ in range(p["epochs"]):
            order = torch.randperm(len(data[0]), generator=self._generator, device=self.lathes.device)
            for chosen in torch.split(order, p["batch_size"]):
                loss = self._loss(*(tensor[chosen] for tensor in data))
                self._optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(self.network.parameters(), p["max_gradient_norm"])
                self._optimizer.step()

    def _loss(
        self, observations: Tensor, actions: Tensor, before: Tensor, advantage: Tensor, returns: Tensor, counted: Tensor
    ) -> Tensor:
        p = self.parameters
        mean = _mean_over(counted)
        centred = advantage - mean(advantage)
        advantage = centred / (mean(centred**2).sqrt() + 1e-8)
        ratio = torch.exp(self.network.log_probability(observations, actions) - before)
        limited = ratio.clamp(1.0 - p["clip_range"], 1.0 + p["clip_range"])
        policy_loss = -mean(torch.minimum(ratio * advantage, limited * advantage))
        value_loss = mean((self.network.value(observations).squeeze(-1) - returns) ** 2)
        entropy = self.network.log_deviation.sum()  # but for a constant
        loss: Tensor = policy_loss + p["value_coefficient"] * value_loss - p["entropy_coefficient"] * entropy
        return loss


def _mean_over(counted: Tensor) -> Callable[[Tensor], Tensor]:
    total = counted.sum().clamp(min=1.0)
    return lambda values: (values * counted).sum() / total
