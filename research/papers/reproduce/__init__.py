"""Comparison of the papers' numbers and claims with the project's, one file per paper.

Run ``python -m research.papers.reproduce``.
"""
