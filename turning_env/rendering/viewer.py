"""The viewer that an environment renders with.

It watches episodes, draws their frames, and has a window for ``render_mode="human"``.
"""

import os
from typing import TYPE_CHECKING, Any

from gymnasium.error import ClosedEnvironmentError, DependencyNotInstalled, Error, ResetNeeded

from turning_env.extras import needed
from turning_env.rendering.history import History

if TYPE_CHECKING:
    from turning_env.batch.driver import Batch
    from turning_env.env import RoughTurningEnv
    from turning_env.rendering.frame import Frame
    from turning_env.rendering.theme import Pixels
    from turning_env.vector_env import RoughTurningVectorEnv


SLOW_INTERVAL = 10.0  # control interval [s] from which on few steps are shown in a second


class Viewer:
    """A viewer of the first environments of a batch, from an episode's first frame to its end.

    Without frames it costs nothing: recording starts with an episode's first frame. That also
    imports Pillow and, for a window, pygame; DependencyNotInstalled if one is missing. With the
    environment's mode "human" a window shows every step. The environment's metadata receive the
    frame rate.

    Raises:
        ValueError: the environment has no such mode of rendering.
    """

    def __init__(
        self, env: "RoughTurningEnv | RoughTurningVectorEnv", batch: "Batch", num_envs: int = 1
    ) -> None:
        allowed = env.metadata["render_modes"]
        if env.render_mode not in allowed:
            modes = ", ".join(repr(mode) for mode in allowed)
            raise ValueError(
                f"render_mode is {env.render_mode!r}, but must be None or one of {modes}"
            )
        control = env.scenario.control
        slow = control.action == "part" or control.interval >= SLOW_INTERVAL
        env.metadata = env.metadata | {"render_fps": 2 if slow else 30}
        self._env = env
        self._batch = batch
        self._histories = [History(batch, index) for index in range(num_envs)]
        self._watched: list[History] = []
        self._frames: dict[int, Frame] = {}
        self._window: Window | None = None

    def note(self) -> None:
        """Record the last step of watched episodes, and show it in a window.

        Call it after step and reset.
        """
        if self._watched:
            self._watched = [history for history in self._watched if history.goes_on()]
        if self._env.render_mode == "human":
            self.render()

    def frames(self) -> "tuple[Pixels, ...]":
        """Return a frame of each environment: uint8, shape (height, width, 3).

        ResetNeeded if there is nothing to see yet.
        """
        if not self._batch.seeded:
            raise ResetNeeded("call reset() before render(): no episode is under way")
        with needed(DependencyNotInstalled):
            from turning_env.rendering.frame import Frame
        pictures = []
        for index, history in enumerate(self._histories):
            history.begin()
            frame = self._frames.get(index)
            # On a family, every episode may have another scenario.
            if frame is None or frame.scenario is not history.scenario:
                frame = Frame(history.scenario, self._title(history))
                self._frames[index] = frame
            pictures.append(frame.draw(history))
        self._watched = list(self._histories)
        return tuple(pictures)

    def _title(self, history: History) -> str:
        name = history.scenario.name
        spec = self._env.spec
        return name if spec is None else f"{spec.id}, {name}"

    def render(self) -> "Pixels | None":
        """Return the first environment's frame; with a window show it there, and return None."""
        frame = self.frames()[0]
        if self._env.render_mode != "human":
            return frame
        if self._window is None:
            with needed(DependencyNotInstalled):
                self._window = Window(self._env.metadata["render_fps"])
        self._window.show(frame, self._title(self._histories[0]))
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()

    def __getstate__(self) -> dict[str, Any]:
        # Frames and a window hold nothing that cannot be drawn again.
        return vars(self) | {"_frames": {}, "_window": None}


class Window:
    """A window with a limited frame rate, opened with pygame for its first frame."""

    def __init__(self, frames_per_second: int) -> None:
        import pygame

        self._pygame: Any = pygame
        self._frames_per_second = frames_per_second
        self._screen: Any = None

    def show(self, frame: "Pixels", title: str) -> None:
        """Show a frame, and wait until the next is due.

        Raise Gymnasium's errors without a display, or if the window was closed by hand.
        """
        if self._screen is None:
            self._open(frame, title)
        pygame = self._pygame
        pygame.surfarray.blit_array(self._screen, frame.swapaxes(0, 1))
        pygame.display.flip()
        self._clock.tick(self._frames_per_second)
        for event in pygame.event.get(pygame.QUIT):
            self.close()
            raise ClosedEnvironmentError(
                f"the window of {title} was closed (event {event.type}): "
                "make the environment again to go on"
            )

    def _open(self, frame: "Pixels", title: str) -> None:
        pygame = self._pygame
        height, width, _ = frame.shape
        try:
            pygame.display.init()
            # Without a display, SDL draws to an invisible driver. Only the user may choose that.
            chosen = {"SDL_VIDEODRIVER", "SDL_VIDEO_DRIVER"} & os.environ.keys()
            if pygame.display.get_driver() == "offscreen" and not chosen:
                pygame.display.quit()
                raise pygame.error("there is no display")
            self._screen = pygame.display.set_mode((width, height))
        except pygame.error as error:
            raise Error(
                f'no window can be opened ({error}): render with render_mode="rgb_array", '
                "or set SDL_VIDEODRIVER=dummy to go without a display"
            ) from error
        pygame.display.set_caption(title)
        self._clock: Any = pygame.time.Clock()

    def close(self) -> None:
        """Close the window."""
        self._screen = None
        self._pygame.display.quit()
