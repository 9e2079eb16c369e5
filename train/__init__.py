"""Agents: one readable file per algorithm, and the adapter that gives Stable-Baselines3 the batched environment."""
