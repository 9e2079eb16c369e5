"""Compilation with Numba, mathematical functions and keyed random numbers.

Nothing here refers to a lathe; quantities with a physical meaning belong in ``physics``.
"""
