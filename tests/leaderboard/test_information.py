"""Inputs of agents as tables state them, against their files and algorithms."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from baselines.guided import HOLD
from baselines.policy_spec import PolicySpec
from leaderboard.agents import agent_file
from leaderboard.agents.agent_file import AgentFile
from leaderboard.information import Information, class_of, information
from leaderboard.policies import AGENTS
from tests.leaderboard.conftest import spec
from train.agent_inputs import DistanceTracker
from turning_env import Scenario

SCENARIO = Scenario.load("rough_turning")
REWARDS = ("rewards",)
LIFE_PRICE = ("life price", "spreads")
GRADIENTS = ("model gradients", "true states", "geometry")


def agent(inputs: Sequence[str], **parameters: object) -> PolicySpec:
    """Return an agent whose file states these inputs of its training."""
    stated = {"training_information": list(inputs)}
    return spec("mine", seed=0, parameters=stated | parameters)


def information_of(policy: PolicySpec, scenario: Scenario = SCENARIO) -> Information:
    stated = information(policy, scenario)
    assert stated is not None
    return stated


SHIPPED = sorted(AGENTS.glob("*/*/*-seed0.onnx"))


@pytest.fixture(params=SHIPPED, ids=lambda path: f"{path.parents[1].name}-{path.stem}")
def shipped(request: pytest.FixtureRequest) -> AgentFile:
    path: Path = request.param
    return agent_file.read(path)


def test_agents_ship() -> None:
    assert SHIPPED


def test_shipped_agents_have_the_memory_that_the_table_states(shipped: AgentFile) -> None:
    metadata = shipped.metadata
    parameters = metadata.parameters
    shipped_agent = spec("shipped", seed=0, parameters=parameters)
    stated = information_of(shipped_agent, metadata.scenario)
    assert stated.seen is not None
    if "cells" in parameters:
        expected = parameters["cells"]
        if "position" in stated.seen:
            expected += DistanceTracker.STATES
    else:
        num_entries = len(metadata.observation_space.low)
        earlier_frames = parameters.get("frames", 1) - 1
        # A recurrent network has two states per cell.
        expected = 2 * parameters.get("lstm_hidden_size", 0) + earlier_frames * num_entries
    assert shipped.memory_size == expected
    assert ("memory" in stated.seen) == (shipped.memory_size > 0)


def test_shipped_agents_were_trained_for_the_stated_environment_steps(shipped: AgentFile) -> None:
    metadata = shipped.metadata
    shipped_agent = spec("shipped", seed=0, parameters=metadata.parameters)
    stated = information_of(shipped_agent, metadata.scenario)
    steps = metadata.trained_steps
    if metadata.parameters.get("guide"):
        steps *= HOLD  # a guide's training counts decisions
    assert stated.steps == steps


def test_what_is_not_stated_is_not_guessed() -> None:
    policy = spec("mine", seed=0, command="python -m train.ppo --seed 0")
    assert class_of(policy) == "other agent"
    assert information_of(policy) == Information(given=None, seen=None, steps=None)


def test_a_plain_training_has_no_inputs_but_rewards() -> None:
    stated = information_of(agent(REWARDS, position=False, frames=1))
    assert stated.given == REWARDS
    assert stated.seen == ()


def test_inputs_have_the_order_of_tables() -> None:
    stated = information_of(agent([*LIFE_PRICE, *REWARDS], position=True, frames=4))
    assert stated.given == (*REWARDS, *LIFE_PRICE)
    assert stated.seen == ("memory", "position")


@pytest.mark.parametrize(
    ("policy", "expected"),
    [
        pytest.param(agent(REWARDS), "model-free agent", id="rewards"),
        pytest.param(agent([*REWARDS, *LIFE_PRICE]), "privileged agent", id="price p(D)"),
        pytest.param(agent([*REWARDS, "true states"]), "privileged agent", id="asymmetric critic"),
        pytest.param(agent(GRADIENTS), "privileged agent", id="model gradients"),
        pytest.param(agent(REWARDS, guide=True), "learned guide of a rule", id="guide"),
        pytest.param(agent(REWARDS, belief=True), "agent on a belief", id="belief"),
        pytest.param(agent(["wishes"]), "other agent", id="unknown inputs"),
        pytest.param(agent(["rule's actions"], belief=True), "student of a rule", id="imitation"),
        pytest.param(spec("rule"), "rule", id="rule"),
        pytest.param(spec("oracle", kind="oracle"), "oracle", id="oracle"),
    ],
)
def test_the_class_follows_from_the_inputs_of_training(policy: PolicySpec, expected: str) -> None:
    assert class_of(policy) == expected


def test_a_guide_counts_environment_steps() -> None:
    guide = agent(REWARDS, guide=True, total_timesteps=1_500_000)
    assert information_of(guide).steps == 45_000_000


@pytest.mark.parametrize("steps", [-1, 10**400, 1.5, "many", True])
def test_a_number_of_steps_that_no_training_has_is_not_stated(steps: object) -> None:
    assert information_of(agent(REWARDS, total_timesteps=steps)).steps is None
