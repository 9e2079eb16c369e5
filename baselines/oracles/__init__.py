"""A bound on the return of any policy, and an oracle that knows the hidden state.

Neither is a policy. Controllers that act on observations belong in ``baselines``.
"""
