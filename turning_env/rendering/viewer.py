"""The viewer that an environment renders with: watched episodes, their frames, and a window for ``render_mode="human"``."""

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


class Viewer:
    """A viewer of the first environments of a batch, from an episode's first frame to its end.

    Without frames it costs nothing: recording starts with an episode's first frame, which also imports Pillow, and pygame for a
    window, where one is missing DependencyNotInstalled. With the environment's mode "human" a window shows every step; its
    metadata receive the frame rate.
    """

    def __init__(
        self, env: "RoughTurningEnv | RoughTurningVectorEnv", batch: "Batch", num_envs: int = 1
    ) -> None:
        mode, allowed, control = env.render_mode, env.metadata["render_modes"], env.scenario.control
        if mode not in allowed:
            raise ValueError(
                f"render_mode is {mode!r}, but must be None or one of {', '.join(map(repr, allowed))}"
            )
        # Few steps are shown in a second where a step is a whole part or a long interval.
        env.metadata = env.metadata | {
            "render_fps": 2 if control.action == "part" or control.interval >= 10.0 else 30
        }
        self._env = env
        self._batch = batch
        self._histories = [History(batch, index) for index in range(num_envs)]
        self._watched: list[History] = []
        self._frames: dict[int, Frame] = {}
        self._window: Window | None = None

    def note(self) -> None:
        """Record the last step of watched episodes, and show it in a window; call it after step and reset."""
        if self._watched:
            self._watched = [history for history in self._watched if history.goes_on()]
        if self._env.render_mode == "human":
            self.render()

    def frames(self) -> "tuple[Pixels, ...]":
        """Return a frame of each environment: uint8, shape (height, width, 3); ResetNeeded if there is nothing to see yet."""
        if not self._batch.seeded:
            raise ResetNeeded("call reset() before render(): no episode is under way")
        with needed(DependencyNotInstalled):
            from turning_env.rendering.frame import Frame
        for index, history in enumerate(self._histories):
            history.begin()
            if index not in self._frames or self._frames[index].scenario is not history.scenario:
                self._frames[index] = Frame(history.scenario, self._title(history))
        self._watched = list(self._histories)
        return tuple(
            self._frames[index].draw(history) for index, history in enumerate(self._histories)
        )

    def _title(self, history: History) -> str:
        spec, name = self._env.spec, history.scenario.name
        return name if spec is None else f"{spec.id}, {name}"

    def render(self) -> "Pixels | None":
        """Return the first environment's frame; with a window show it there, and return None."""
        (frame, *_) = self.frames()
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
        return self.__dict__ | {
            "_frames": {},
            "_window": None,
        }  # they hold nothing that cannot be drawn again


class Window:
    """A window with a limited frame rate, opened with pygame for its first frame."""

    def __init__(self, frames_per_second: int) -> None:
        import pygame

        self._pygame: Any = pygame
        self._pace = frames_per_second
        self._screen: Any = None

    def show(self, frame: "Pixels", title: str) -> None:
        """Show a frame, and wait until the next is due. Raise Gymnasium's errors without a display, or if a hand closed it."""
        if self._screen is None:
            self._open(frame, title)
        pygame = self._pygame
        pygame.surfarray.blit_array(self._screen, frame.swapaxes(0, 1))
        pygame.display.flip()
        self._clock.tick(self._pace)
        for event in pygame.event.get(pygame.QUIT):
            self.close()
            closed = f"the window of {title} was closed (event {event.type}): make the environment anew to go on"
            raise ClosedEnvironmentError(closed)

    def _open(self, frame: "Pixels", title: str) -> None:
        pygame = self._pygame
        try:
            pygame.display.init()
            # Without a display, SDL would draw to an invisible driver, unless the user has chosen it.
            if (
                pygame.display.get_driver() == "offscreen"
                and not {"SDL_VIDEODRIVER", "SDL_VIDEO_DRIVER"} & os.environ.keys()
            ):
                pygame.display.quit()
                raise pygame.error("there is no display")
            self._screen = pygame.display.set_mode(frame.shape[1::-1])
        except pygame.error as error:
            instead = 'render with render_mode="rgb_array", or set SDL_VIDEODRIVER=dummy to go without a display'
            raise Error(f"no window can be opened ({error}): {instead}") from error
        pygame.display.set_caption(title)
        self._clock: Any = pygame.time.Clock()

    def close(self) -> None:
        """Close it."""
        self._screen = None
        self._pygame.display.quit()
