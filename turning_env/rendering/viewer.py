"""What an environment renders with: the lanes that are looked at, their frames, and a window for human eyes."""

from typing import TYPE_CHECKING, Any

from gymnasium.error import ResetNeeded

from turning_env.rendering.fields import Fields
from turning_env.rendering.frame import Frame
from turning_env.rendering.lane import Lane
from turning_env.rendering.theme import Pixels

if TYPE_CHECKING:
    from turning_env.batch.driver import Batch
    from turning_env.env import RoughTurningEnv
    from turning_env.rendering.window import Window
    from turning_env.vector_env import RoughTurningVectorEnv


class Viewer:
    """Looks at the first lanes of lathes, interval by interval.

    Args:
        env: whose lathes they are.
        lathes: what is looked at.
        lanes: how many of them, from the first on.
        window: where each interval is shown by itself, if there is one.
    """

    def __init__(
        self, env: "RoughTurningEnv | RoughTurningVectorEnv", lathes: "Batch", num_envs: int, window: "Window | None"
    ) -> None:
        self._env, self._window = env, window
        scenario = env.scenario
        fields = Fields(scenario)
        self._lanes = [Lane(scenario, lathes, lane, fields) for lane in range(num_envs)]
        self._frames: list[Frame] = []

    @property
    def title(self) -> str:
        """What stands on the frames: the environment's id, if it has one and the scenario's name."""
        spec, name = self._env.spec, self._env.scenario.name
        if spec is None:
            return name
        return f"{spec.id}, {name}"

    def note(self) -> None:
        """Take down what the last interval gave, and show it where there is a window. To be called after it and after a reset."""
        for lane in self._lanes:
            lane.note()
        if self._window is not None:
            self.show()

    def frames(self) -> tuple[Pixels, ...]:
        """A frame of each lane: uint8, shape (height, width, 3).

        Raises:
            gymnasium.error.ResetNeeded: there is nothing to see yet.
        """
        if not all(lane.started for lane in self._lanes):
            raise ResetNeeded("call reset() before render(): no episode is under way")
        if not self._frames:
            self._frames = [Frame(self._env.scenario, self.title) for _ in self._lanes]
        return tuple(frame.draw(lane) for frame, lane in zip(self._frames, self._lanes, strict=True))

    def show(self) -> None:
        """Show the first lane in the window."""
        (frame, *_) = self.frames()
        assert self._window is not None
        self._window.show(frame, self.title)

    def render(self) -> Pixels | None:
        """The first lane's frame; with a window nothing, as it is shown there."""
        if self._window is not None:
            self.show()
            return None
        return self.frames()[0]

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_frames": []}  # they hold nothing that cannot be drawn again
