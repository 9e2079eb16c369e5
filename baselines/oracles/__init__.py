"""A bound on the return of any policy, and an oracle that knows the hidden state. Policies belong in ``baselines``."""
