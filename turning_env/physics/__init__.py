"""The table of quantities, one file per phenomenon of the process, and ``lathe.py``, the transition that calls them.

Files hold equations of one environment; how many environments are driven, and by whom, belongs in ``batch``.
"""

MODEL_VERSION = 1
"""Version of the laws. Raise it when a golden trajectory changes, and write the files of ``tests/golden`` anew."""
