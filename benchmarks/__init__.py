"""Measurements: speed, prices, bounds, what holds under long and violent use, what is installed."""

from baselines.extras import tell_plainly

tell_plainly()
