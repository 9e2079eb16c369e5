"""The figures of the papers, drawn from what the project's own models and controllers do; ``python -m baselines.figures``."""
