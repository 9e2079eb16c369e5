"""The figures of the papers, drawn with the project's own models and controllers: ``python -m papers.figures``."""

from turning_env.extras import tell_plainly

tell_plainly()
