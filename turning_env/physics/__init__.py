"""The process of turning: a file per phenomenon, and ``lathe.py``, the transition that calls them.

Files hold equations of one environment, ``quantities.py`` the table of all quantities. The driver
of many environments belongs in ``batch``.
"""

MODEL_VERSION = 1
"""Version of the transition. Raise it when a golden trajectory (``tests/golden``) changes; results
of other versions are void."""
