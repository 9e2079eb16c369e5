"""Measurements: speed, prices, bounds, what holds under long and violent use, what is installed."""

from turning_env.extras import tell_plainly

tell_plainly()
