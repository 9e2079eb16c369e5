"""Frames of environments at work, drawn with Pillow and, for ``render_mode="human"``, shown in a window with pygame.

Rendering only looks on: it changes no environment and draws none of its random numbers. What is hidden from the policy, the true
hardness and allowance along the bar, is drawn too, but faintly. Rules that decide what happens do not belong here.
"""

from typing import TYPE_CHECKING

from turning_env.scenario import Scenario

if TYPE_CHECKING:
    from turning_env.batch.driver import Batch
    from turning_env.env import RoughTurningEnv
    from turning_env.rendering.viewer import Viewer
    from turning_env.vector_env import RoughTurningVectorEnv


def make_viewer(env: "RoughTurningEnv | RoughTurningVectorEnv", batch: "Batch", num_envs: int = 1) -> "Viewer":
    """Return a viewer of the first ``num_envs`` environments, and set the frame rate in the environment's metadata.

    Raises:
        ValueError: the environment has no such render mode.
    """
    from turning_env.rendering.viewer import Viewer

    mode, allowed = env.render_mode, env.metadata["render_modes"]
    if mode not in allowed:
        raise ValueError(f"render_mode is {mode!r}, but must be None or one of {', '.join(map(repr, allowed))}")
    env.metadata = env.metadata | {"render_fps": frames_per_second(env.scenario)}
    return Viewer(env, batch, num_envs)


def frames_per_second(scenario: Scenario) -> int:
    """Return how many steps are shown in a second: few where a step is a whole part or a long interval."""
    control = scenario.control
    return 2 if control.action == "part" or control.interval >= 10.0 else 30
