"""Tuning of the rules: ``python -m baselines.tune``."""
