"""Bounds on what any policy can earn, and oracles that are told what no policy sees.

Nothing here is a policy; controllers that act on observations belong in ``baselines``.
"""
