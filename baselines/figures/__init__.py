"""The figures of the papers, drawn from what the project's own models and controllers do; ``python -m baselines.figures``."""

from baselines.extras import tell_plainly

tell_plainly()
