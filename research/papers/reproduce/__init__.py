"""Comparison of the papers' numbers and claims with the project's: ``python -m research.papers.reproduce``. One file per paper."""
