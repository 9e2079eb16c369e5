"""What several controllers share: nominal process models, filters, measured scales, the price of an edge's life.

A controller itself is a file in ``baselines``.
"""
