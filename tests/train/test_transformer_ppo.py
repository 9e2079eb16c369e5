"""The transformer remembers as far back as it says, and in which order."""

from pathlib import Path

import pytest
import torch
from gymnasium.spaces import Box

from tests.train.small import small_run
from train import transformer_ppo
from train.training import train
from train.transformer_ppo import Attention


def test_features_depend_on_every_observation_and_on_their_order() -> None:
    torch.manual_seed(1)
    attention = Attention(Box(-1.0, 1.0, (4 * 11,)), frames=4, cells=8, heads=2)
    torch.nn.init.normal_(attention.places)
    observations = torch.rand(5, 4, 11)
    features = attention(observations.flatten(1))
    assert features.shape == (5, 8)
    for frame in range(4):
        other = observations.clone()
        other[:, frame] += 0.5
        assert not torch.allclose(attention(other.flatten(1)), features, atol=1e-4)
    swapped = observations[:, [1, 0, 2, 3]]
    assert not torch.allclose(attention(swapped.flatten(1)), features, atol=1e-4)


def test_heads_must_divide_the_embedding(tmp_path: Path) -> None:
    run = small_run(transformer_ppo.ALGORITHM, tmp_path, heads=3)
    with pytest.raises(ValueError, match="memory_cells is 4, but must be a multiple of heads, which is 3"):
        train(run, transformer_ppo.ALGORITHM)
