"""Inputs of agents as tables state them, against their files and algorithms."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from baselines.policy_spec import PolicySpec
from leaderboard.agents import agent_file
from leaderboard.agents.agent_file import AgentFile
from leaderboard.inputs import (
    IMITATION,
    MODEL_FREE,
    TRAINING_INPUTS,
    Inputs,
    class_of,
    training_inputs,
)
from leaderboard.policies import AGENTS
from tests.leaderboard.conftest import spec
from tests.train.small import ALGORITHMS
from tests.turning_env.playing import changed
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
    stated = Inputs.of(parameters)
    if "cells" in parameters:
        expected = parameters["cells"]
        if stated.position:
            expected += DistanceTracker.STATES
    else:
        num_entries = len(metadata.observation_space.low)
        earlier_frames = parameters.get("frames", 1) - 1
        # A recurrent network has two states per cell.
        expected = 2 * parameters.get("lstm_hidden_size", 0) + earlier_frames * num_entries
    assert shipped.memory_size == expected
    assert ("memory" in stated.run_time) == (shipped.memory_size > 0)


def test_shipped_agents_were_trained_for_the_stated_environment_steps(shipped: AgentFile) -> None:
    metadata = shipped.metadata
    stated = Inputs.of(metadata.parameters)
    assert stated.steps == metadata.trained_steps


def test_shipped_agents_keep_their_inputs(shipped: AgentFile) -> None:
    given = Inputs.of(shipped.metadata.parameters).training
    assert given is not None
    is_privileged = not set(given) <= MODEL_FREE | IMITATION
    teachers = ("analytic_gradient", "simulator_gradient")
    assert (shipped.metadata.algorithm in teachers) == is_privileged


@pytest.mark.parametrize("name", ALGORITHMS)
def test_algorithms_declare_known_inputs(name: str) -> None:
    declared = ALGORITHMS[name].training_information
    assert declared
    assert set(declared) <= set(TRAINING_INPUTS)


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({}, {"rewards"}),
        ({"life_price": "flat"}, {"rewards"}),
        ({"life_price": "end"}, {"rewards"}),
        ({"life_price": "marginal"}, {"rewards", "life price", "spreads"}),
        ({"asymmetric": True}, {"rewards", "true states"}),
        ({"asymmetric": False}, {"rewards"}),
    ],
)
def test_terms_of_a_training_change_its_inputs(
    parameters: dict[str, object], expected: set[str]
) -> None:
    assert set(training_inputs(["rewards"], parameters)) == expected


def test_a_flat_life_price_takes_the_dynamic_programme_from_a_teacher() -> None:
    teacher = {*GRADIENTS, *LIFE_PRICE}
    assert set(training_inputs(teacher, {"life_price": "flat"})) == set(GRADIENTS)


@pytest.mark.parametrize(
    "parameters",
    [
        {},
        {"training_information": "rewards"},
        {"training_information": ["wishes"]},
        {"training_information": [1]},
        {"training_information": {}},
    ],
)
def test_what_is_not_stated_is_not_guessed(parameters: dict[str, object]) -> None:
    assert Inputs.of(parameters).training is None
    policy = spec("mine", seed=0, parameters=parameters, command="python -m train.ppo --seed 0")
    assert class_of(policy) == "other agent"


def test_a_plain_training_has_no_inputs_but_rewards() -> None:
    stated = Inputs.of(agent(REWARDS, position=False, frames=1).parameters)
    assert stated.training == REWARDS
    assert stated.run_time == ()


def test_inputs_have_the_order_of_tables() -> None:
    stated = Inputs.of(agent([*LIFE_PRICE, *REWARDS], position=True, frames=4).parameters)
    assert stated.training == (*REWARDS, *LIFE_PRICE)
    assert stated.run_time == ("memory", "position")


def test_numbers_of_a_job_are_seen_unless_they_are_hidden() -> None:
    context = {"names": ["life", "removal_rate"]}
    assert Inputs.of({"context": context}).run_time == ("context",)
    assert Inputs.of({"context": context, "hides_context": True}).run_time == ()


def test_a_price_of_life_does_not_count_where_the_job_ends_before_the_edge() -> None:
    stated = Inputs.of(agent([*REWARDS, *LIFE_PRICE]).parameters)
    ends_with_edge = changed(SCENARIO, workpiece={"bars": 0}, control={"edge_changes": "end"})
    ends_with_job = changed(SCENARIO, workpiece={"bars": 3}, control={"edge_changes": "end"})
    assert stated.on(ends_with_edge).training == (*REWARDS, *LIFE_PRICE)
    assert stated.on(ends_with_job).training == REWARDS


@pytest.mark.parametrize(
    ("policy", "expected"),
    [
        pytest.param(agent(REWARDS), "model-free agent", id="rewards"),
        pytest.param(agent([*REWARDS, *LIFE_PRICE]), "privileged agent", id="price p(D)"),
        pytest.param(agent([*REWARDS, "true states"]), "privileged agent", id="asymmetric critic"),
        pytest.param(agent(GRADIENTS), "privileged agent", id="model gradients"),
        pytest.param(agent(REWARDS, belief=True), "agent on a belief", id="belief"),
        pytest.param(agent(["wishes"]), "other agent", id="unknown inputs"),
        pytest.param(agent(["rule's actions"], belief=True), "student of a rule", id="imitation"),
        pytest.param(spec("rule"), "rule", id="rule"),
        pytest.param(spec("oracle", kind="oracle"), "oracle", id="oracle"),
    ],
)
def test_the_class_follows_from_the_inputs_of_training(policy: PolicySpec, expected: str) -> None:
    assert class_of(policy) == expected


@pytest.mark.parametrize("steps", [-1, 10**400, 1.5, "many", True])
def test_a_number_of_steps_that_no_training_has_is_not_stated(steps: object) -> None:
    assert Inputs.of(agent(REWARDS, total_timesteps=steps).parameters).steps is None
