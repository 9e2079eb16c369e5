"""Tuning of the rules: ``python -m baselines.tune``."""

from baselines.extras import tell_plainly

tell_plainly()
