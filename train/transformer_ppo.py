"""Train a transformer with PPO for one training seed.

    python -m train.transformer_ppo --seed 0

Policy and value function attend to the last ``frames`` observations: one layer of a transformer that normalises before each part
(Xiong et al. 2020, arXiv 2002.04745). Only its output for the present observation is used, so no other is computed. The same
command resumes an interrupted training, and does nothing if training is finished. Files: see ``train/training.py``.
"""

import sys
from functools import partial
from typing import Any

import torch
from gymnasium.spaces import Box
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution
from stable_baselines3 import PPO
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecEnv

from train.actor import Feedforward
from train.ppo import settings
from train.run import Run
from train.training import Algorithm, command_line


class Attention(BaseFeaturesExtractor):
    """The present observation, having attended to the last ones: (num_envs, frames * entries) to (num_envs, cells)."""

    def __init__(self, observation_space: Box, frames: int, cells: int, heads: int) -> None:
        """``cells``: size of the embedding; a multiple of ``heads``."""
        super().__init__(observation_space, cells)
        entries = observation_space.shape[0] // frames
        self.shape = (-1, frames, entries)
        self.embedding = torch.nn.Linear(entries, cells)
        self.places = torch.nn.Parameter(torch.zeros(frames, cells))
        self.norm = torch.nn.LayerNorm(cells)
        self.attention = torch.nn.MultiheadAttention(cells, heads, batch_first=True)
        self.layers = torch.nn.Sequential(
            torch.nn.LayerNorm(cells), torch.nn.Linear(cells, 4 * cells), torch.nn.ReLU(), torch.nn.Linear(4 * cells, cells)
        )

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the features."""
        seen = self.embedding(observations.view(self.shape)) + self.places
        normal = self.norm(seen)
        found, _ = self.attention(normal[:, -1:], normal, normal, need_weights=False)
        present = (seen[:, -1:] + found).squeeze(1)
        features: torch.Tensor = present + self.layers(present)
        return features


def new_model(run: Run, vec_env: VecEnv) -> PPO:
    """Return an untrained model.

    Raises:
        ValueError: ``memory_cells`` is no multiple of ``heads``.
    """
    p, values = run.parameters, settings(run)
    if p["heads"] < 1 or p["memory_cells"] % p["heads"]:
        raise ValueError(f"memory_cells is {p['memory_cells']}, but must be a multiple of heads, which is {p['heads']}")
    attention = {"frames": p["frames"], "cells": p["memory_cells"], "heads": p["heads"]}
    values["policy_kwargs"] |= {"features_extractor_class": Attention, "features_extractor_kwargs": attention}
    return PPO("MlpPolicy", vec_env, **values)


def network(policy: Any) -> Feedforward:
    """Return the agent of a trained policy."""
    return Feedforward(policy.features_extractor, policy.mlp_extractor.policy_net, policy.action_net)


SEARCH = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "discount": FloatDistribution(0.5, 0.95),
    "epochs": IntDistribution(3, 10),
    "memory_cells": CategoricalDistribution([16, 32, 64]),
}

ALGORITHM = Algorithm("transformer_ppo", "a transformer and PPO", PPO, new_model, network, SEARCH)


main = partial(command_line, ALGORITHM)

if __name__ == "__main__":
    sys.exit(main())
