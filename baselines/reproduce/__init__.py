"""Sets the figures and claims of the papers beside the project's. Run: ``python -m baselines.reproduce``."""

from baselines.reproduce.alaskari_oraby import PaperRun

__all__ = ["PaperRun"]
