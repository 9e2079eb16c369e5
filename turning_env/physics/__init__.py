"""The table of quantities, one file per phenomenon of the process, and ``lathe.py``, the transition that calls them.

Files hold equations of one environment; the driver of many environments belongs in ``batch``.
"""

MODEL_VERSION = 1
"""Version of the transition: raised when a golden trajectory (``tests/golden``) changes. Results of other versions are void."""
