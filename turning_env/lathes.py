"""Many lathes side by side, and the compiled loops over them. One lathe or thousands, the transition is the same."""

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from turning_env import observation
from turning_env.compilation import compiled_entry, source_digest
from turning_env.lathe import run_interval, start_episode
from turning_env.observation import write_observation
from turning_env.records import LANE, REPORT, REPORT_FIELDS, action_size, new_records, parameter_records
from turning_env.scenario import Scenario

MOST_SEED = 2**64 - 1


def observation_space(scenario: Scenario) -> spaces.Space[NDArray[np.float32]]:
    """The observations of one lane: a new space for every environment, since a space carries its own sampling state."""
    low, high = observation.bounds(scenario)
    return spaces.Box(low, high, dtype=np.float32)


def action_space(scenario: Scenario) -> spaces.Space[NDArray[np.float32]]:
    """The actions of one lane, likewise."""
    return spaces.Box(-1.0, 1.0, (action_size(scenario),), np.float32)


def checked_seed(seed: Any, lane: int) -> int:
    """The seed as an integer.

    Raises:
        ValueError: it is not a whole number of 0 to 2**64 - 1.
    """
    if not isinstance(seed, int | np.integer) or not 0 <= seed <= MOST_SEED:
        raise ValueError(f"seed {seed!r} of lane {lane} must be a whole number, 0 to {MOST_SEED}")
    return int(seed)


def _entries(digest: str) -> tuple[Any, Any]:
    @compiled_entry
    def start_lanes(lanes, parameters, chosen, observations, reports):
        """Start an episode in every chosen lane (``chosen``: bool per lane)."""
        digest  # noqa: B018 - see compiled_entry
        for i in range(lanes.shape[0]):
            if chosen[i]:
                start_episode(lanes[i], parameters[0], reports[i])
                write_observation(lanes[i], parameters[0], observations[i])

    @compiled_entry
    def step_lanes(lanes, parameters, actions, observations, rewards, terminated, truncated, reports):
        """Run one interval in every lane that has not ended; an ended lane starts its next episode instead.

        Returns -1, or the first lane whose action is not finite; then no lane has moved.
        """
        digest  # noqa: B018 - see compiled_entry
        for i in range(lanes.shape[0]):
            for k in range(actions.shape[1]):
                if not np.isfinite(actions[i, k]):
                    return i
        for i in range(lanes.shape[0]):
            lane = lanes[i]
            if lane.ended:
                lane.episode += np.uint64(1)
                start_episode(lane, parameters[0], reports[i])
                rewards[i] = 0.0
                terminated[i] = False
                truncated[i] = False
            else:
                rewards[i], terminated[i], truncated[i] = run_interval(lane, parameters[0], actions[i], reports[i])
            write_observation(lane, parameters[0], observations[i])
        return -1

    return start_lanes, step_lanes


_start_lanes, _step_lanes = _entries(source_digest())


class Lathes:
    """The lanes of one scenario and what their last interval gave; both environments drive this.

    Attributes:
        observations: float32, shape (count, 11), or 12 entries where there is one more.
        rewards: float64, shape (count,), in s of machine time.
        terminated, truncated: bool, shape (count,).
        report_values: float64, shape (count, len(REPORT_FIELDS)); see ``records.py`` for the fields and units.
    """

    def __init__(self, scenario: Scenario, count: int) -> None:
        self.parameters = parameter_records(scenario)
        self.lanes = new_records(LANE, count)
        self.seeded = False
        self.action_size = action_size(scenario)
        self.observations = np.zeros((count, len(observation.bounds(scenario)[0])), np.float32)
        self.rewards = np.zeros(count, np.float64)
        self.terminated = np.zeros(count, np.bool_)
        self.truncated = np.zeros(count, np.bool_)
        self._reports = new_records(REPORT, count)
        self._view_reports()

    def _view_reports(self) -> None:
        self.report_values: NDArray[np.float64] = self._reports.view(np.float64).reshape(-1, len(REPORT_FIELDS))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a copy or a pickle, in which the view of the reports came out as an array of its own."""
        self.__dict__.update(state)
        self._view_reports()

    def seed(self, lane: int, seed: int) -> None:
        """Key a lane's episodes: the next to start is the first of this seed (see ``checked_seed``)."""
        self.lanes[lane].seed = seed
        self.lanes[lane].episode = 0

    def start(self, chosen: NDArray[np.bool_]) -> None:
        """Start the keyed episode in every chosen lane."""
        _start_lanes(self.lanes, self.parameters, chosen, self.observations, self._reports)
        self.terminated[chosen] = False
        self.truncated[chosen] = False

    def next_episode(self, chosen: NDArray[np.bool_]) -> None:
        """Move every chosen lane on to the next episode of its seed, and start it."""
        self.lanes.episode[chosen] += np.uint64(1)
        self.start(chosen)

    def step(self, actions: Any) -> None:
        """Run one interval in every lane, or start the next episode where one has ended.

        Raises:
            ValueError: the actions are not numbers of shape (count, action_size), or not finite; no lane has moved then.
        """
        shape = (len(self.lanes), self.action_size)
        try:
            given = np.asarray(actions)
        except ValueError as error:  # ragged
            raise ValueError(f"actions must be numbers of shape {shape}, got {actions!r}") from error
        if given.dtype.kind not in "fiu":
            raise ValueError(f"actions must be numbers of shape {shape}, got {actions!r}")
        batch = np.ascontiguousarray(given, np.float64)
        if batch.shape != shape:
            raise ValueError(f"actions must have shape {shape}, got {batch.shape}")
        refused = _step_lanes(
            self.lanes,
            self.parameters,
            batch,
            self.observations,
            self.rewards,
            self.terminated,
            self.truncated,
            self._reports,
        )
        if refused >= 0:
            raise ValueError(f"the action of lane {refused} must be finite, got {batch[refused].tolist()}")
