"""Throughput measurements against peers."""

from baselines.extras import tell_plainly

tell_plainly()
