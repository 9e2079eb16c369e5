"""Tools for a process engineer: calibrate a scenario from measured cuts, ask what its laws predict, and map them.

Nothing here plays an episode; policies and their scores belong in ``score``. The commands are in ``turning_env.__main__``.
"""


class WorkshopError(ValueError):
    """Input that a workshop tool cannot use. The message says what is wrong and what is allowed."""
