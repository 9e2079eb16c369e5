"""The driver of any number of environments.

Equations of a step belong in ``physics``, Gymnasium's interface in ``env.py`` and
``vector_env.py``.
"""
