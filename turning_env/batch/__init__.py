"""The one driver of any number of environments, and the threads that share its work.

What an environment does in a step belongs in ``physics``; what Gymnasium asks for belongs in ``env.py`` and ``vector_env.py``.
"""
