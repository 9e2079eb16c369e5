"""Finds rows that miss the law together, which intervals take for independent."""

import numpy as np

from turning_env.workshop.calibration.regression import Fit

SURPRISING = 2.326
"""Normal deviate that chance exceeds in 1 of 100 tables [-]."""
SETTINGS = ("cutting_speed", "feed", "depth_of_cut", "hardness")
"""What is the same for all readings of one edge in one bar."""


def misses_together(fit: Fit) -> bool:
    """Whether rows at the same settings lie off the law to the same side, more than chance would have it.

    Most often these are readings of one edge, and edges differ; or else no power law fits. An F test of the residuals'
    variance between settings over that within them, by Paulson's normal deviate (Annals of Mathematical Statistics 13, 1942).
    """
    residuals = np.log(fit.measured / fit.predicted)
    settings = np.stack([fit.factors[name] for name in SETTINGS], axis=1)
    _, group = np.unique(settings, axis=0, return_inverse=True)
    members = np.bincount(group)
    means = np.bincount(group, residuals) / members
    shared = sum(name in SETTINGS for name in fit.estimates) + 1  # exponents and coefficient that follow the settings
    between, within = len(members) - shared, len(residuals) - len(members) - (len(fit.estimates) - shared)
    if between < 1 or within < 1:
        return False
    rest = float(((residuals - means[group]) ** 2).sum()) / within
    if rest == 0:
        return False
    ratio = float(members @ means**2) / between / rest
    b, w = 2 / (9 * between), 2 / (9 * within)
    deviate = ((1 - w) * ratio ** (1 / 3) - (1 - b)) / np.sqrt(w * ratio ** (2 / 3) + b)
    return bool(deviate > SURPRISING)
