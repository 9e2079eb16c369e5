"""The zoo's settings of PPO."""

from examples.zoo import settings

hyperparams = settings("ppo")
