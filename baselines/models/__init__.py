"""Models that several controllers share: processes, filters, prices of edge life.

A controller is a file in ``baselines``.
"""
