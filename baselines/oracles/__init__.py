"""A bound on what any policy can earn, and an oracle that is told the hidden state.

Neither is a policy. Controllers that act on observations belong in ``baselines``.
"""
