"""The inputs of agents that see more, or less, than the present observation.

The same code runs in training, in the file of a trained agent, and in play. Position and earlier
observations follow from observations alone, so they are part of the agent. The hidden state is for
critics in training only.
"""

import math
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Box
from gymnasium.vector import VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from baselines.belief import at_end, with_final
from baselines.models.kalman_steps import distance_moved
from baselines.models.load_filter import travel_numbers_of
from train.actor import Actor
from train.analytic_actor import ACTUAL, COMMANDED, SpeedAndFeed, TargetCommands, Tensor
from turning_env import Scenario
from turning_env.physics.quantities import OBS, layout
from turning_env.scenario.family import CHUNK, DrawnJobs, Family
from turning_env.vector_env import info_at_end_of_step

MAX_TIME = 4.0
"""Time to the end of the bar [s] beyond which its reading is constant."""


class DistanceTracker:
    """A tracker of the tool's position along the bar.

    Observations determine the position, but do not contain it. The travelled distance is a sum of
    cutting speed times feed over sub-steps, and both follow their commands with known lags. So two
    observations and the drawing's geometry give the position exactly. The load filter follows the
    tool by the same equation (``baselines/models/kalman_steps.py``).

    If the position contradicts the entry ``cutting``, it is corrected. That is not the filter's
    ``on_track``, which branches: a file of a trained agent holds tensor operations only, and
    trained agents know readings of the position as they are corrected here.

    The state, shape (num_envs, STATES), is 0 before an episode's first observation. Its columns are
    the position from the start of the approach [mm], and cutting speed [m/min] and feed [mm/rev] at
    the last observation.
    """

    STATES = 3
    READINGS = 2

    def __init__(self, scenario: Scenario) -> None:
        self._commands = TargetCommands(scenario)
        self._model = SimpleNamespace(**travel_numbers_of(scenario))
        self._approach: float = self._model.approach  # [mm]
        self._pitch: float = self._model.pitch  # from bar to bar [mm]

    def __call__(self, observation: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Return readings of order one, shape (num_envs, READINGS), and the next state.

        The first reading is the position, from -1 at the start of the approach to 1 at the end of
        the bar. The second is the time to that end at the present speed and feed, from -1 for 0 to
        1 for ``MAX_TIME`` or more.
        """
        position, last_speed, last_feed = state.unbind(dim=-1)
        speed, feed = self._commands.speed_and_feed(observation, ACTUAL)

        commanded_speed, commanded_feed = self._commands.speed_and_feed(observation, COMMANDED)
        travel = distance_moved(
            self._model,
            memory=SpeedAndFeed(last_speed, last_feed),
            reading=SimpleNamespace(
                commanded_cutting_speed=commanded_speed, commanded_feed=commanded_feed
            ),
        )
        position = position + torch.where(last_speed > 0.0, travel, 0.0)
        position = torch.where(position >= self._pitch, position - self._pitch, position)
        position = self._corrected(position, observation[..., OBS.cutting] > 0.5)

        time_left = (self._pitch - position) / (speed * feed * self._model.velocity)
        position_reading = 2.0 * position / self._pitch - 1.0
        time_reading = 2.0 * time_left.clamp(max=MAX_TIME) / MAX_TIME - 1.0
        readings = torch.stack([position_reading, time_reading], dim=-1)
        return readings, torch.stack([position, speed, feed], dim=-1)

    def _corrected(self, position: Tensor, cutting: Tensor) -> Tensor:
        """Return positions that agree with whether the tool cuts: the nearest that do."""
        # In metal, take the nearer of the bars behind and ahead.
        end_of_last_bar = self._pitch * (1.0 - 1e-6)
        nearest = torch.where(position < 0.5 * self._approach, end_of_last_bar, self._approach)
        in_air = position < self._approach
        position = torch.where(cutting & in_air, nearest, position)
        # In air, the tool is somewhere in the approach.
        in_metal = position > self._approach
        return torch.where(~cutting & in_metal, 0.5 * self._approach, position)


class AgentInputs:
    """A function from observations to an agent's inputs.

    The inputs are the last observations, the latest last, each with the readings of its position if
    the agent has them, and without the entries that are hidden. The memory, shape (num_envs,
    memory_size), holds the tracker's state, then the earlier observations. It is 0 before an
    episode's first observation.
    """

    def __init__(
        self, scenario: Scenario, entries: int, position: bool, frames: int, hidden: int = 0
    ) -> None:
        """Make the inputs of an agent.

        Args:
            scenario: the scenario.
            entries: number of entries of one observation.
            position: whether the agent has readings of its position.
            frames: number of successive observations that it sees.
            hidden: number of entries, those after the scenario's own, that it does not see.
        """
        self._tracker = DistanceTracker(scenario) if position else None
        self._tracker_states = DistanceTracker.STATES if position else 0
        self._scenario_entries = len(layout(scenario))
        self._hidden = hidden
        readings = DistanceTracker.READINGS if position else 0
        self._frame_entries = entries - hidden + readings
        self.entries = frames * self._frame_entries
        """Number of entries that the agent sees."""
        self.memory_size = self._tracker_states + (frames - 1) * self._frame_entries

    def __call__(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """Return the agent's inputs, shape (num_envs, entries), and the next memory."""
        tracker_state = memory[:, : self._tracker_states]
        earlier_frames = memory[:, self._tracker_states :]
        frame = observation
        if self._hidden:
            first_shown = self._scenario_entries + self._hidden
            shown = [observation[:, : self._scenario_entries], observation[:, first_shown:]]
            frame = torch.cat(shown, dim=1)
        if self._tracker:
            readings, tracker_state = self._tracker(frame, tracker_state)
            frame = torch.cat([frame, readings], dim=1)
        inputs = torch.cat([earlier_frames, frame], dim=1)
        # The oldest frame is forgotten.
        next_memory = torch.cat([tracker_state, inputs[:, self._frame_entries :]], dim=1)
        return inputs, next_memory


class AgentInputsWrapper(VectorWrapper):  # not subscripted: it is generic from Gymnasium 1.4 on
    """Vector environments with SAME_STEP that return the agent's inputs."""

    def __init__(self, env: Any, inputs: AgentInputs) -> None:
        super().__init__(env)
        self._inputs = inputs
        self._memory = torch.zeros(env.num_envs, inputs.memory_size)
        self.single_observation_space = Box(-np.inf, np.inf, (inputs.entries,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(self, **options: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start episodes in all environments; arguments are the environments'."""
        observations, infos = self.env.reset(**options)
        self._memory[:] = 0.0
        return self._next_inputs(observations), infos

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], Any, Any, Any, dict[str, Any]]:
        """Run one step in every environment."""
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        ended = terminated | truncated
        if ended.any():
            # Where an episode has ended, its last observation is seen with its memory, and the
            # first of the next episode without.
            memory = self._memory
            final_inputs = self._next_inputs(at_end(observations, infos, ended))
            infos = with_final(infos, ended, final_inputs)
            self._memory = torch.where(torch.from_numpy(ended).unsqueeze(1), 0.0, memory)
        return self._next_inputs(observations), rewards, terminated, truncated, infos

    def _next_inputs(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        inputs, self._memory = self._inputs(torch.from_numpy(observations), self._memory)
        return inputs.numpy()


class WithInputs(Actor):
    """An actor on observations, made of one on an agent's inputs.

    The memory holds that of the inputs, then the actor's own.
    """

    def __init__(self, actor: Actor, inputs: AgentInputs) -> None:
        super().__init__()
        self.actor = actor
        self._inputs = inputs
        self.memory_size = inputs.memory_size + actor.memory_size

    def forward(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        size = self._inputs.memory_size
        inputs, inputs_memory = self._inputs(observation, memory[:, :size])
        action, actor_memory = self.actor(inputs, memory[:, size:])
        return action, torch.cat([inputs_memory, actor_memory], dim=1)


class HiddenStateWrapper(VectorWrapper):
    """Vector environments with SAME_STEP whose observations end in the hidden state.

    A critic may see it in training. Its entries are ``STATES`` of order one. On a family, errors
    of the job's laws follow: true less nominal, over the standard deviation among training jobs.
    """

    STATES = ("hardness", "depth_of_cut", "wear")

    def __init__(self, env: Any, scenario: Scenario) -> None:
        super().__init__(env)
        self._scale = np.array([1.0, scenario.workpiece.depth_of_cut, scenario.tool.wear_criterion])
        family = getattr(env.unwrapped, "family", None)
        self._errors = scaled_errors(family) if family else np.zeros((0, 0))
        self.hidden = len(self.STATES) + self._errors.shape[1]
        """Number of entries that the agent does not see."""
        (entries,) = env.single_observation_space.shape
        self.single_observation_space = Box(-np.inf, np.inf, (entries + self.hidden,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(self, **options: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start episodes in all environments; arguments are the environments'."""
        observations, infos = self.env.reset(**options)
        return np.hstack([observations, self._hidden_state(infos.__getitem__)]), infos

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], Any, Any, Any, dict[str, Any]]:
        """Run one step in every environment."""
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        if "final_obs" in infos:
            ended = terminated | truncated
            final_state = self._hidden_state(partial(info_at_end_of_step, infos))
            final = np.hstack([at_end(observations, infos, ended), final_state])
            infos = with_final(infos, ended, final)
        shown = np.hstack([observations, self._hidden_state(infos.__getitem__)])
        return shown, rewards, terminated, truncated, infos

    def _hidden_state(self, info: Callable[[str], Any]) -> NDArray[np.float32]:
        """Return the hidden state, shape (num_envs, hidden).

        ``info`` returns the values of a name in the environments' infos.
        """
        states = np.stack([info(name) for name in self.STATES], axis=1) / self._scale
        if self._errors.size:
            errors = self._errors[info("job").astype(int)]
        else:
            errors = np.zeros((len(states), 0))
        return np.hstack([states, errors]).astype(np.float32)


def scaled_errors(family: Family) -> NDArray[np.float64]:
    """Return errors of the laws of all training jobs, shape (jobs, numbers that vary).

    They are true less nominal, over their standard deviation among the jobs.
    """
    chunks = [family.draw("train", number) for number in range(math.ceil(family.jobs / CHUNK))]
    columns = []
    for name in chunks[0].true_fields:
        errors = np.hstack([_errors(jobs, name) for jobs in chunks])
        if np.ptp(errors) > 0.0:
            columns.append(errors / errors.std())
    return np.stack(columns, axis=1)


def _errors(jobs: DrawnJobs, name: str) -> NDArray[np.float64]:
    """Return the true less the nominal values of a field, shape (CHUNK,)."""
    # A field without a truth has one value for all jobs.
    error = 1.0 * jobs.true_fields[name] - jobs.nominal_fields[name]
    return np.full(CHUNK, error)
