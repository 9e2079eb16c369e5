"""Compilation with Numba, elementary functions and keyed random numbers: what the transition is computed with.

Nothing here knows of a lathe; what has a physical meaning belongs in ``physics``.
"""
