"""Models that several controllers share: nominal process, filters, measured scales, price of edge life.

A controller itself is a file in ``baselines``.
"""
