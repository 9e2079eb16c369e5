"""Tools for a process engineer: calibrate a scenario from measured cuts, ask what its laws predict, and map them.

Nothing here plays an episode; policies and their scores belong in ``score``.
"""
