"""Agents: one readable file per algorithm, and the adapter that gives Stable-Baselines3 the batched environment."""

from turning_env.extras import tell_plainly

tell_plainly()
