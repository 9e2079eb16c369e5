"""Tuning of the rules: ``python -m baselines.tune``."""

from turning_env.extras import tell_plainly

tell_plainly()
