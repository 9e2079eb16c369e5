"""Actors of agents that were trained elsewhere: any PyTorch module, or a model of Stable-Baselines3.

Load models of your own only: they are pickles, which can run code.
"""

import copy
import importlib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecNormalize

from train.actor import Actor
from train.recurrent_ppo import RecurrentActor
from train.run import warn_of_pickle
from turning_env import Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.batch.driver import action_space, observation_space

_MODELS = {
    "sb3_contrib.common.recurrent.policies": ("sb3_contrib", "RecurrentPPO"),
    "clip_range": ("stable_baselines3", "PPO"),
    "gae_lambda": ("stable_baselines3", "A2C"),
    "policy_delay": ("stable_baselines3", "TD3"),
    "top_quantiles_to_drop_per_net": ("sb3_contrib", "TQC"),
    "target_entropy": ("stable_baselines3", "SAC"),
}
"""Classes of models by a text that their files hold; the first that fits is right."""


class ModuleActor(Actor):
    """A module from observations to actions, which are clipped to -1..1.

    A module with an attribute ``memory_size`` above 0 has the interface of ``Actor``: it also takes and returns a memory.
    """

    def __init__(self, module: torch.nn.Module) -> None:
        super().__init__()
        self.module = copy.deepcopy(module).cpu().float().eval()
        self.memory_size = getattr(module, "memory_size", 0)

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        action, memory = self.module(observation, memory) if self.memory_size else (self.module(observation), memory)
        return action.clamp(-1.0, 1.0), memory


def _network(name: str, policy: Any) -> torch.nn.Module:
    """Return the network from observations to the most likely actions of a policy of Stable-Baselines3."""
    if name == "RecurrentPPO":
        return RecurrentActor(policy)
    if name in ("PPO", "A2C"):
        end = [torch.nn.Tanh()] if policy.squash_output else []
        return torch.nn.Sequential(policy.pi_features_extractor, policy.mlp_extractor.policy_net, policy.action_net, *end)
    actor = policy.actor
    layers = [actor.mu] if name == "TD3" else [actor.latent_pi, actor.mu, torch.nn.Tanh()]
    return torch.nn.Sequential(actor.features_extractor, *layers)


class Normalized(Actor):
    """An actor behind the scaling of observations with which ``VecNormalize`` trained it."""

    def __init__(self, actor: Actor, statistics: Any) -> None:
        super().__init__()
        self.actor, self.memory_size, self.limit = actor, actor.memory_size, float(statistics.clip_obs)
        mean, variance = statistics.obs_rms.mean, statistics.obs_rms.var
        self.register_buffer("mean", torch.tensor(mean, dtype=torch.float32))
        self.register_buffer("scale", torch.tensor(1.0 / np.sqrt(variance + statistics.epsilon), dtype=torch.float32))

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        scaled = ((observation - self.mean) * self.scale).clamp(-self.limit, self.limit)  # type: ignore[operator]
        action: tuple[torch.Tensor, torch.Tensor] = self.actor(scaled, memory)
        return action


def sb3_actor(path: Path, scenario: Scenario, normalization: Path | None = None) -> tuple[str, int, Actor]:
    """Return the algorithm, the trained steps and the actor of a model that Stable-Baselines3 or sb3-contrib has saved.

    Args:
        path: PPO, A2C, SAC, TQC, TD3, or RecurrentPPO of one LSTM layer.
        scenario: on which it was trained, with the observations and actions of ``RoughTurningEnv``.
        normalization: a file of ``VecNormalize.save``, if observations were normalised.

    Raises:
        ValueError: the file holds no such model, or one for other observations or actions; says which.
    """
    warn_of_pickle(path)
    try:
        with zipfile.ZipFile(path) as archive:
            data = archive.read("data").decode()
        package, name = next(model for mark, model in _MODELS.items() if f'"{mark}"' in data)
    except (KeyError, ValueError, StopIteration, zipfile.BadZipFile) as error:
        known = ", ".join(name for _, name in _MODELS.values())
        raise ValueError(f"is no model of Stable-Baselines3; those that can be exported are {known}") from error
    try:
        model: Any = getattr(importlib.import_module(package), name).load(path, device="cpu")
    except Exception as error:  # garbled bytes can raise anything
        raise ValueError(f"cannot be loaded as {name} of {package}: {error}") from error
    for what, mine, its in (
        ("observation", model.observation_space, observation_space(scenario)),
        ("action", model.action_space, action_space(scenario)),
    ):
        if mine != its:
            raise ValueError(f"was trained on the {what} space {mine}, but that of scenario {scenario.name!r} is {its}")
    network = _network(name, model.policy)
    actor: Actor = network if isinstance(network, Actor) else ModuleActor(network)
    if normalization is not None:
        warn_of_pickle(normalization)
        try:
            statistics = VecNormalize.load(str(normalization), RoughTurningVecEnv(scenario, 1))
        except OSError:
            raise
        except Exception as error:  # as above
            raise ValueError(f"is normalised by {normalization}, which cannot be read: {error}") from error
        actor = Normalized(actor, statistics) if statistics.norm_obs else actor
    return name.lower(), int(model.num_timesteps), actor.eval()
