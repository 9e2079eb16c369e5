"""Agents: one readable file per algorithm, and the adapter that gives Stable-Baselines3 the batched environment."""

from baselines.extras import tell_plainly

tell_plainly()
