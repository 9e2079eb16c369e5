"""The driver of any number of environments, and the threads that share its work.

Equations of a step belong in ``physics``; Gymnasium's interface belongs in ``env.py`` and ``vector_env.py``.
"""
