"""The terms of a training: what the agent sees, and how rewards charge edge life.

The same hyperparameters mean the same for every algorithm that has them:

    belief = true            # the estimates of the optimisers' filter (baselines/belief.py)
    derived = true           # the inputs of baselines/derived_observation.py
    load_target = true       # actions are those of baselines/load_target.py
    position = true          # readings of the tool's position along the bar (DistanceTracker)
    frames = 4               # number of successive observations, with their positions
    life_price = "marginal"  # "flat": the environment's; "marginal": p(D); "end": at the edge's end
    hides_context = true     # the numbers of a family's nominal models are hidden
    asymmetric = true        # PPO's critic sees the hidden state, its actor does not

Position and earlier observations are part of the trained agent and of its file
(``train/agent_inputs.py``). Belief, derived inputs and feed loop are not: in play,
``leaderboard.agents.agent_file.informed`` computes them from nominal models and observations.
``train/life_price.py`` changes the rewards.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

from leaderboard.agents import agent_file
from leaderboard.inputs import Inputs
from train.actor import Actor
from train.agent_inputs import AgentInputs, AgentInputsWrapper, HiddenStateWrapper, WithInputs
from train.life_price import LIFE_PRICES, LifePriceVecEnv
from train.run import Run
from turning_env import Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv

MAX_FRAMES = 100


@dataclass(frozen=True)
class Terms:
    """The terms of one training."""

    scenario: Scenario
    entries: int
    """Number of entries of an observation, with those of a nominal model and of a belief."""
    inputs: Inputs
    life_price: str
    asymmetric: bool

    def __post_init__(self) -> None:
        if self.life_price not in LIFE_PRICES:
            raise ValueError(
                f"life_price is {self.life_price!r}, but must be one of {', '.join(LIFE_PRICES)}"
            )
        # Tracker and prices are of one geometry and one set of laws, and each job has its own.
        inputs = self.inputs
        if inputs.context_entries and (inputs.position or self.life_price != "flat"):
            raise ValueError(
                "position and life_price other than flat are computed for one scenario, "
                "not for a family's jobs"
            )
        if inputs.hides_context and not inputs.context_entries:
            raise ValueError(
                "hides_context hides the numbers of a family's nominal models, but "
                f"{self.scenario.name} is no family"
            )
        if inputs.hides_context and (inputs.derived or inputs.load_target):
            raise ValueError(
                "hides_context hides the numbers of nominal models, but derived and load_target "
                "use them"
            )

    @classmethod
    def of(cls, run: Run) -> Self:
        """Return the terms of a run; an algorithm need not have all among its hyperparameters.

        Raises:
            ValueError: a term is not one of its values, or does not go with the environment.
        """
        frames = run.parameters.get("frames", 1)
        if not 1 <= frames <= MAX_FRAMES:
            raise ValueError(f"frames is {frames}, but must be 1 to {MAX_FRAMES}")
        (entries,) = agent_file.seen_space(run.env_id, run.scenario, run.parameters).shape
        return cls(
            scenario=run.scenario,
            entries=entries,
            inputs=Inputs.of(run.parameters),
            life_price=run.parameters.get("life_price", "flat"),
            asymmetric=run.parameters.get("asymmetric", False),
        )

    def with_life_price(
        self, vec_env: Callable[..., RoughTurningVecEnv]
    ) -> Callable[..., RoughTurningVecEnv]:
        """Return the function that makes training environments with the price of edge life.

        ``vec_env`` is the algorithm's. If it is no plain ``RoughTurningVecEnv``, it charges edge
        life itself and is returned as it is.
        """
        if self.life_price == "flat" or vec_env is not RoughTurningVecEnv:
            return vec_env
        return partial(LifePriceVecEnv, self.life_price)

    @property
    def _agent_inputs(self) -> AgentInputs | None:
        """What makes the agent's inputs of observations; None: it sees plain observations."""
        inputs = self.inputs
        hidden = inputs.context_entries if inputs.hides_context else 0
        if not inputs.position and inputs.frames == 1 and not hidden:
            return None
        return AgentInputs(
            self.scenario,
            self.entries,
            position=inputs.position,
            frames=inputs.frames,
            hidden=hidden,
        )

    def wrapped(self, envs: Any) -> Any:
        """Return vector environments whose observations are the inputs of training.

        The inputs of the agent come first, those that an asymmetric critic alone sees follow.
        """
        # What is made of whole observations comes first; the hidden state is not the agent's, so it
        # comes last.
        envs = agent_file.wrapped(envs, self.inputs)
        inputs = self._agent_inputs
        if inputs is not None:
            envs = AgentInputsWrapper(envs, inputs)
        if self.asymmetric:
            envs = HiddenStateWrapper(envs, self.scenario)
        return envs

    def actor(self, actor: Actor) -> Actor:
        """Return the actor on observations for one on the inputs of ``wrapped``."""
        inputs = self._agent_inputs
        return actor if inputs is None else WithInputs(actor, inputs)
