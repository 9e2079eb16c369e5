"""Tools for a process engineer: calibrate a scenario from measured cuts, predict cuts with its laws, and map them.

Nothing here plays an episode; that belongs in ``scoring``. The commands are in ``turning_env.__main__``.
"""


class WorkshopError(ValueError):
    """Invalid input of a workshop tool. The message says what is wrong and what is allowed."""
