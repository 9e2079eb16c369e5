"""Part programs for a lathe's control: read, play, adapt and write them.

``dialects`` (data), ``words``, ``modal`` and ``moves`` read every program. ``stock``, ``removal``,
``cutting``, ``report`` and ``adapt`` play and adapt them.

Importing this package registers ``PROGRAM_ID``. Make the environment by
``gymnasium.make("turning_nc:RoughTurning-Program-v1", program="part.mpf")``.
"""

from gymnasium.envs.registration import register, registry

PROGRAM_ID = "RoughTurning-Program-v1"
"""The registered id of a part program as an environment; see ``environment.ProgramEnv``."""


def register_envs() -> None:
    """Register ``PROGRAM_ID`` with Gymnasium, unless it is registered already."""
    if PROGRAM_ID not in registry:
        register(PROGRAM_ID, entry_point="turning_nc.environment:ProgramEnv")


# Gymnasium 1.x loads no plug-ins, but imports the module that stands before an id's colon.
register_envs()
