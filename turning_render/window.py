"""The window of ``render_mode="human"``, opened with pygame when there is something to show."""

import os
from typing import Any

import pygame
from gymnasium.error import ClosedEnvironmentError, Error

from turning_render.theme import HEIGHT, WIDTH, Pixels


class Window:
    """Shows at most so many frames per second."""

    def __init__(self, frames_per_second: int) -> None:
        self._pace = frames_per_second
        self._screen: Any = None
        self._clock: Any = None

    def show(self, frame: Pixels, title: str) -> None:
        """Show a frame, and wait until the next is due.

        Raises:
            gymnasium.error.Error: there is no display to open a window on.
            gymnasium.error.ClosedEnvironmentError: the window was closed by hand.
        """
        if self._screen is None:
            self._open(title)
        pygame.surfarray.blit_array(self._screen, frame.swapaxes(0, 1))
        pygame.display.flip()
        self._clock.tick(self._pace)
        for event in pygame.event.get(pygame.QUIT):
            self.close()
            raise ClosedEnvironmentError(
                f"the window of {title} was closed (event {event.type}): make the environment anew to go on"
            )

    def _open(self, title: str) -> None:
        try:
            pygame.display.init()
            # Where it finds no display, SDL draws to where nobody sees it, unless it was told to.
            if pygame.display.get_driver() == "offscreen" and not {"SDL_VIDEODRIVER", "SDL_VIDEO_DRIVER"} & os.environ.keys():
                pygame.display.quit()
                raise pygame.error("there is no display")
            self._screen = pygame.display.set_mode((WIDTH, HEIGHT))
        except pygame.error as error:
            raise Error(
                f'no window can be opened ({error}): render with render_mode="rgb_array", or set SDL_VIDEODRIVER=dummy to go '
                "without a display"
            ) from error
        pygame.display.set_caption(title)
        self._clock = pygame.time.Clock()

    def close(self) -> None:
        """Close it, if it is open."""
        if self._screen is not None:
            self._screen = None
            pygame.display.quit()

    def __getstate__(self) -> dict[str, Any]:
        return {"_pace": self._pace, "_screen": None, "_clock": None}
