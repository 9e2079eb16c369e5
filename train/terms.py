"""The terms of a training: an agent's inputs beside the present observation, and its charges for edges.

The same hyperparameters mean the same for every algorithm that has them:

    belief = true            # what the optimisers' filter has estimated from the observations (baselines/belief.py)
    position = true          # readings of the tool's position along the bar (DistanceTracker)
    frames = 4               # number of successive observations, with their positions
    life_price = "marginal"  # "flat": the environment's; "marginal": p(D); "end": the whole edge at its end
    hides_context = true     # the numbers of a family's nominal models are hidden
    asymmetric = true        # PPO's critic sees the hidden state (HiddenObservation), its actor does not

Position and earlier observations are part of the trained agent and of its file. Who plays an agent with a belief computes that
for it, from nominal models and observations (``train.agents.agent_file.informed``).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

import numpy as np
import torch
from gymnasium.spaces import Box
from gymnasium.vector import VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from baselines.belief import VectorBeliefObservation, at_end, with_final
from baselines.optimiser import USED_LIVES, worth
from train.actor import Actor
from train.agents.agent_file import seen_space
from train.analytic_actor import ACTUAL, COMMANDED, TargetCommands, Tensor
from train.model_gain import edge_price
from train.run import TERMS, Run
from turning_env import Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.physics.quantities import OBS, layout
from turning_env.scenario.family import CHUNK
from turning_env.vector_env import info_at_end_of_step

MAX_TIME = 4.0  # time to the end of the bar [s] beyond which the reading is constant


class ShapedVecEnv(RoughTurningVecEnv):
    """Environments whose training rewards charge edge life otherwise than at its flat price.

    They add the difference of a potential of used life D to a step's reward, so the differences add up to the same over every
    whole edge, whatever the agent does (Ng, Harada and Russell 1999, without a discount; a broken edge counts as used up):

        marginal: price D - integral of p from 0 to D; the reward charges D at its marginal price p(D)
        end: price D, and 0 at the edge's end, where the reward charges the whole edge

    A flat price makes an agent with little foresight use up a fresh edge too fast. With the discount in the potential's
    difference, this would not change.
    """

    def __init__(self, life_price: str, scenario: Scenario, *others: Any) -> None:
        """``others``: further arguments of ``RoughTurningVecEnv``."""
        super().__init__(scenario, *others)
        self._price = edge_price(scenario)
        self._used_lives = np.concatenate([[0.0], USED_LIVES])
        self._potentials = self._price * self._used_lives
        self._at_end = 0.0
        if life_price == "marginal":
            prices = worth(scenario).life
            self._potentials -= np.concatenate([[0.0], np.cumsum(prices) / len(prices)])
            self._at_end = float(self._potentials[-1])

    def potential(self, used: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the potential [s] of used life [-] of an edge in use, of any shape."""
        potential: NDArray[np.float64] = np.interp(used, self._used_lives, self._potentials)
        return potential

    def training_rewards(
        self, rewards: NDArray[np.float64], infos: dict[str, Any]
    ) -> NDArray[np.float64]:
        """Return rewards [s] plus the potential's difference."""
        used = np.minimum(info_at_end_of_step(infos, "used_life"), 1.0)
        ended = (used >= 1.0) | info_at_end_of_step(infos, "broken").astype(np.bool_)
        before = used + info_at_end_of_step(infos, "reward_edge") / self._price
        return (
            rewards + np.where(ended, self._at_end, self.potential(used)) - self.potential(before)
        )


class DistanceTracker:
    """A tracker of the tool's position along the bar, which observations determine but do not contain.

    The travelled distance is a sum of cutting speed times feed over sub-steps, and both follow their commands with known lags.
    So two observations and the drawing's geometry give the position exactly, as in ``baselines/models/kalman_steps.py``. If the
    position contradicts the entry ``cutting``, it is corrected.

    The state, shape (num_envs, 3), is 0 before an episode's first observation. Its columns are the position from the start of
    the approach [mm], and cutting speed [m/min] and feed [mm/rev] at the last observation.
    """

    STATES = 3
    READINGS = 2

    def __init__(self, scenario: Scenario) -> None:
        control, machine, work = scenario.control, scenario.machine, scenario.workpiece
        self._commands = TargetCommands(scenario)
        self._pitch, self._approach = work.bar_length + work.approach, work.approach
        self._per_second = 1000.0 / (60.0 * math.pi * work.diameter)  # mm per s, m/min and mm/rev
        step = control.interval / control.sub_steps
        times = [step * (number + 1) for number in range(control.sub_steps)]
        speeds, feeds = (
            [math.exp(-time / lag) if lag > 0.0 else 0.0 for time in times]
            for lag in (machine.spindle_time_constant, machine.feed_time_constant)
        )
        # Sums over a control interval's sub-steps of the remaining deviation in speed, in feed, and in both [s].
        self._speed_left, self._feed_left = step * sum(speeds), step * sum(feeds)
        self._both_left = step * sum(
            speed * feed for speed, feed in zip(speeds, feeds, strict=True)
        )
        self._interval = control.interval

    def __call__(self, observation: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """Return readings of order one, shape (num_envs, READINGS), and the next state.

        The first is the position, from -1 at the start of the approach to 1 at the end of the bar. The second is the time to that
        end at the present speed and feed, from -1 for 0 to 1 for ``MAX_TIME`` or more.
        """
        along, last_speed, last_feed = state.unbind(dim=-1)
        speed, feed = self._commands.speed_and_feed(observation, ACTUAL)
        commanded_speed, commanded_feed = self._commands.speed_and_feed(observation, COMMANDED)
        late, slow = last_speed - commanded_speed, last_feed - commanded_feed
        travel = (
            self._interval * commanded_speed * commanded_feed
            + commanded_feed * late * self._speed_left
        )
        travel = travel + commanded_speed * slow * self._feed_left + late * slow * self._both_left
        along = along + torch.where(last_speed > 0.0, travel * self._per_second, 0.0)
        along = torch.where(along >= self._pitch, along - self._pitch, along)
        cutting = observation[..., OBS.cutting] > 0.5
        # In metal, take the nearer of the bars behind and ahead.
        nearest = torch.where(
            along < 0.5 * self._approach, self._pitch * (1.0 - 1e-6), self._approach
        )
        along = torch.where(cutting & (along < self._approach), nearest, along)
        along = torch.where(~cutting & (along > self._approach), 0.5 * self._approach, along)
        left = (self._pitch - along) / (speed * feed * self._per_second)
        readings = torch.stack(
            [2.0 * along / self._pitch - 1.0, 2.0 * left.clamp(max=MAX_TIME) / MAX_TIME - 1.0],
            dim=-1,
        )
        return readings, torch.stack([along, speed, feed], dim=-1)


class View:
    """A function from observations to the agent's inputs: also its position, and earlier observations, latest last.

    The memory, shape (num_envs, memory_size), holds the tracker's state, then earlier observations. It is 0 before an episode's
    first observation.
    """

    def __init__(
        self, scenario: Scenario, entries: int, position: bool, frames: int, hidden: int = 0
    ) -> None:
        """``entries``: number of entries of one observation; ``hidden``: how many after the scenario's own are hidden."""
        self._tracker = DistanceTracker(scenario) if position else None
        self._states = position * DistanceTracker.STATES
        self._own, self._hidden = len(layout(scenario)), hidden
        self._entries = entries - hidden + position * DistanceTracker.READINGS
        self.entries = frames * self._entries
        """Number of entries that the agent sees."""
        self.memory_size = self._states + (frames - 1) * self._entries

    def __call__(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """Return the agent's inputs, shape (num_envs, entries), and the next memory."""
        state, frames = memory[:, : self._states], memory[:, self._states :]
        if self._hidden:
            observation = torch.cat(
                [observation[:, : self._own], observation[:, self._own + self._hidden :]], dim=1
            )
        if self._tracker:
            readings, state = self._tracker(observation, state)
            observation = torch.cat([observation, readings], dim=1)
        seen = torch.cat([frames, observation], dim=1)
        return seen, torch.cat([state, seen[:, self._entries :]], dim=1)


class ViewObservation(VectorWrapper):  # not subscripted: it is generic only from Gymnasium 1.4 on
    """Vector environments with SAME_STEP that return the agent's inputs."""

    def __init__(self, env: Any, view: View) -> None:
        super().__init__(env)
        self._view, self._memory = view, torch.zeros(env.num_envs, view.memory_size)
        self.single_observation_space = Box(-np.inf, np.inf, (view.entries,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(self, **options: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start episodes in all environments; arguments are the environments'."""
        observations, infos = self.env.reset(**options)
        self._memory[:] = 0.0
        return self._seen(observations), infos

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], Any, Any, Any, dict[str, Any]]:
        """Run one step in every environment."""
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        ended = terminated | truncated
        if ended.any():
            memory = self._memory
            infos = with_final(infos, ended, self._seen(at_end(observations, infos, ended)))
            self._memory = torch.where(torch.from_numpy(ended).unsqueeze(1), 0.0, memory)
        return self._seen(observations), rewards, terminated, truncated, infos

    def _seen(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        seen, self._memory = self._view(torch.from_numpy(observations), self._memory)
        return seen.numpy()


class ViewActor(Actor):
    """An actor that is shown a view; the memory holds the view's, then the actor's own."""

    def __init__(self, actor: Actor, view: View) -> None:
        super().__init__()
        self.actor, self._view = actor, view
        self.memory_size = view.memory_size + actor.memory_size

    def forward(self, observation: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        size = self._view.memory_size
        seen, next_memory = self._view(observation, memory[:, :size])
        action, own = self.actor(seen, memory[:, size:])
        return action, torch.cat([next_memory, own], dim=1)


class HiddenObservation(VectorWrapper):
    """Vector environments with SAME_STEP whose observations end in the hidden state, which a critic may see in training.

    The entries are ``STATES`` of order one and, on a family, the true less the nominal numbers of the job's laws, over their
    standard deviation among training jobs.
    """

    STATES = ("hardness", "depth_of_cut", "wear")

    def __init__(self, env: Any, scenario: Scenario) -> None:
        super().__init__(env)
        self._scale = np.array([1.0, scenario.workpiece.depth_of_cut, scenario.tool.wear_criterion])
        self._errors = np.zeros((0, 0))
        if family := getattr(env.unwrapped, "family", None):
            chunks = [
                family.draw("train", chunk) for chunk in range(math.ceil(family.jobs / CHUNK))
            ]
            errors = []
            for name in chunks[0].true_fields:
                columns = []
                for jobs in chunks:
                    error = 1.0 * jobs.true_fields[name] - jobs.nominal_fields[name]
                    columns.append(np.full(CHUNK, error))
                errors.append(np.hstack(columns))
            self._errors = np.stack(
                [each / each.std() for each in errors if np.ptp(each) > 0.0], axis=1
            )
        (entries,), self.hidden = (
            env.single_observation_space.shape,
            len(self.STATES) + self._errors.shape[1],
        )
        self.single_observation_space = Box(-np.inf, np.inf, (entries + self.hidden,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(self, **options: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start episodes in all environments; arguments are the environments'."""
        observations, infos = self.env.reset(**options)
        return np.hstack([observations, self._state(infos.__getitem__)]), infos

    def step(
        self, actions: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], Any, Any, Any, dict[str, Any]]:
        """Run one step in every environment."""
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        if "final_obs" in infos:
            ended, state = terminated | truncated, self._state(partial(info_at_end_of_step, infos))
            infos = with_final(infos, ended, np.hstack([at_end(observations, infos, ended), state]))
        return (
            np.hstack([observations, self._state(infos.__getitem__)]),
            rewards,
            terminated,
            truncated,
            infos,
        )

    def _state(self, info: Callable[[str], Any]) -> NDArray[np.float32]:
        states = np.stack([info(name) for name in self.STATES], axis=1) / self._scale
        errors = self._errors[info("job").astype(int)] if self._errors.size else states[:, :0]
        return np.hstack([states, errors]).astype(np.float32)


LIFE_PRICES = ("flat", "marginal", "end")  # charges for the edge's life


@dataclass(frozen=True)
class Terms:
    """The terms of one training."""

    scenario: Scenario
    entries: int  # number of entries of an observation, with those of a family's nominal model and of a belief
    context: int  # number of those of a family's nominal model, 0 if there is no family
    belief: bool
    position: bool
    frames: int
    life_price: str
    hides_context: bool
    asymmetric: bool

    def __post_init__(self) -> None:
        if self.life_price not in LIFE_PRICES:
            raise ValueError(
                f"life_price is {self.life_price!r}, but must be one of {', '.join(LIFE_PRICES)}"
            )
        if self.context and (self.position or self.life_price != "flat"):
            raise ValueError(
                "position and life_price other than flat are computed for one scenario, not for a family's jobs"
            )
        if not 1 <= self.frames <= 100:
            raise ValueError(f"frames is {self.frames}, but must be 1 to 100")

    @classmethod
    def of(cls, run: Run) -> Self:
        """Return the terms of a run."""
        (entries,) = seen_space(run.env_id, run.scenario, run.parameters).shape
        context = len(run.parameters["context"]["names"]) if run.family else 0
        return cls(
            run.scenario,
            entries,
            context,
            **{name: run.parameters.get(name, value) for name, value in TERMS.items()},
        )

    def charged(
        self, vec_env: Callable[..., RoughTurningVecEnv]
    ) -> Callable[..., RoughTurningVecEnv]:
        """Return the function that makes training environments; an algorithm with environments of its own charges life itself."""
        plain = self.life_price == "flat" or vec_env is not RoughTurningVecEnv
        return vec_env if plain else partial(ShapedVecEnv, self.life_price)

    @property
    def _view(self) -> View | None:
        """The view of the agent; None: plain observations."""
        hidden = self.context if self.hides_context else 0
        plain = not self.position and self.frames == 1 and not hidden
        return (
            None if plain else View(self.scenario, self.entries, self.position, self.frames, hidden)
        )

    def shown(self, env: Any) -> Any:
        """Return vector environments that return the agent's inputs, followed by those of an asymmetric critic."""
        env = VectorBeliefObservation(env) if self.belief else env
        env = ViewObservation(env, self._view) if self._view else env
        return HiddenObservation(env, self.scenario) if self.asymmetric else env

    def actor(self, actor: Actor) -> Actor:
        """Return the actor on observations for one on the inputs of ``shown``."""
        return ViewActor(actor, self._view) if self._view else actor
