"""An agent sees and sets the same in training, by wrappers, as in play, by its policy."""

from typing import Any

import numpy as np
import pytest

from baselines.policy_spec import PolicySpec
from leaderboard.agents.agent_file import acting_space, informed, wrapped
from leaderboard.inputs import Inputs
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.policy import Actions, Observations, Policy

NUM_ENVS = 2
SCENARIO = Scenario.model_validate({"name": "short", "control": {"time_limit": 0.2}})


class Linear(Policy):
    """A policy whose actions depend on every entry that it is shown."""

    def __init__(self, num_actions: int) -> None:
        self._num_actions = num_actions

    def reset(self, mask: Any) -> None:
        """Forget nothing: there is no memory."""

    def act(self, observations: Observations) -> Actions:
        entries = np.arange(observations.shape[1])
        weights = np.cos(np.arange(self._num_actions)[:, np.newaxis] + entries)
        return np.tanh(observations @ weights.T).astype(np.float32)


def states(env: Any, policy: Policy) -> np.ndarray[Any, Any]:
    """Return the environment's own observations of an episode; shape (steps, envs, entries)."""
    entries = env.unwrapped.single_observation_space.shape[0]
    shown, _ = env.reset(seed=[3, 4])
    policy.reset(np.ones(NUM_ENVS, np.bool_))
    observed = []
    for _ in range(10):
        shown, *_ = env.step(policy.act(shown))
        observed.append(shown[:, :entries])
    return np.array(observed)


@pytest.mark.parametrize("given", [["derived"], ["load_target"], ["belief", "derived"], ["all"]])
def test_an_agent_is_shown_in_play_what_its_training_showed(given: list[str]) -> None:
    names = ["belief", "derived", "load_target"] if given == ["all"] else given
    parameters = dict.fromkeys(names, True)
    num_actions = acting_space(SCENARIO, parameters).shape[0]
    agent = PolicySpec(
        name="agent",
        kind="agent",
        training_seed=0,
        parameters=parameters,
        make=lambda num_envs: Linear(num_actions),
    )
    envs = wrapped(RoughTurningVectorEnv(NUM_ENVS, SCENARIO), Inputs.of(parameters))
    in_training = states(envs, Linear(num_actions))
    in_play = states(RoughTurningVectorEnv(NUM_ENVS, SCENARIO), informed(agent, SCENARIO)(NUM_ENVS))
    np.testing.assert_array_equal(in_play, in_training)
