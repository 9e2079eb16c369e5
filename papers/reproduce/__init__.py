"""Sets the figures and claims of the papers beside the project's. Run: ``python -m papers.reproduce``."""
