"""Measurements: speed, prices, bounds, soak tests, installed packages."""

from turning_env.extras import tell_plainly

tell_plainly()
