"""Tune the rules with Optuna: ``python -m baselines.tune``. The tuned values are data in ``baselines/tuned``."""

from turning_env.extras import tell_plainly

tell_plainly()
