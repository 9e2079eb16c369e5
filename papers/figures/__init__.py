"""The figures of the papers, drawn from what the project's own models and controllers do; ``python -m papers.figures``."""

from turning_env.extras import tell_plainly

tell_plainly()
