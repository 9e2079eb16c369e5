"""Tools for a process engineer: calibrate a scenario from measured cuts, predict cuts with its laws, and map them.

``command`` adds its commands to ``python -m turning_env``. Playing and scoring of policies belong in ``turning_env.scoring``.
"""

from turning_env.console import Mistake


class WorkshopError(Mistake):
    """Invalid input of a workshop tool. The message says what is wrong and what is allowed."""
