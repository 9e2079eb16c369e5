"""Pictures of a lathe at work: for ``render_mode``, drawn with Pillow and, in a window, shown with pygame.

Whoever draws looks on: nothing here changes a lathe or draws a random number of it. What is hidden from the controller, the
true hardness and allowance along the bar, is drawn too, but faintly.
"""

from typing import TYPE_CHECKING

from gymnasium.error import DependencyNotInstalled

if TYPE_CHECKING:
    from turning_env.batch.driver import Batch
    from turning_env.env import RoughTurningEnv
    from turning_env.rendering.viewer import Viewer
    from turning_env.scenario import Scenario
    from turning_env.vector_env import RoughTurningVectorEnv

_LIBRARIES = ("PIL", "pygame")


def make_viewer(env: "RoughTurningEnv | RoughTurningVectorEnv", lathes: "Batch", num_envs: int = 1) -> "Viewer":
    """What draws the first ``num_envs`` of an environment's lathes, by its render mode; sets the pace in its metadata.

    Raises:
        ValueError: the environment has no such mode.
        gymnasium.error.DependencyNotInstalled: Pillow, or for a window pygame-ce, is missing.
    """
    mode, allowed = env.render_mode, env.metadata["render_modes"]
    if mode not in allowed:
        raise ValueError(f"render_mode is {mode!r}, but must be None or one of {', '.join(map(repr, allowed))}")
    pace = frames_per_second(env.scenario)
    env.metadata = env.metadata | {"render_fps": pace}
    try:
        from turning_env.rendering.viewer import Viewer

        if mode != "human":
            return Viewer(env, lathes, num_envs, None)
        from turning_env.rendering.window import Window

        return Viewer(env, lathes, num_envs, Window(pace))
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] not in _LIBRARIES:
            raise
        needed = f'{error.name} is not installed, which draws the environment: pip install "rough-turning[render]"'
        raise DependencyNotInstalled(needed) from error


def frames_per_second(scenario: "Scenario") -> int:
    """How fast intervals are shown one after another: whole parts and minutes slowly enough to be looked at."""
    control = scenario.control
    return 2 if control.action == "part" or control.interval >= 10.0 else 30
