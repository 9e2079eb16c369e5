"""Inputs of agents as tables state them, against their files and algorithms."""

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
PPO = "python -m train.ppo --seed 0"
ANALYTIC_GRADIENT = "python -m train.analytic_gradient --seed 0"


def agent(command: str | None, **parameters: object) -> PolicySpec:
    return spec("mine", seed=0, command=command, parameters=parameters)


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
    stated = information_of(agent(metadata.command, **parameters), metadata.scenario)
    assert stated.seen is not None
    if "cells" in parameters:
        expected = parameters["cells"]
        if "position" in stated.seen:
            expected += DistanceTracker.STATES
    else:
        num_entries = len(metadata.observation_space.low)
        earlier_frames = parameters.get("frames", 1) - 1
        # A recurrent network has two states per cell.
        expected = 2 * parameters.get("memory_cells", 0) + earlier_frames * num_entries
    assert shipped.memory_size == expected
    assert ("memory" in stated.seen) == (shipped.memory_size > 0)


def test_shipped_agents_were_trained_for_the_stated_environment_steps(shipped: AgentFile) -> None:
    metadata = shipped.metadata
    stated = information_of(agent(metadata.command, **metadata.parameters), metadata.scenario)
    steps = metadata.trained_steps
    if metadata.parameters.get("guide"):
        steps *= HOLD  # a guide's training counts decisions
    assert stated.steps == steps


@pytest.mark.parametrize(
    "command",
    [None, "train it", "python -m train.export mine.zip", "python -m train.ppo_of_mine --seed 0"],
)
def test_what_is_not_stated_is_not_guessed(command: str | None) -> None:
    policy = agent(command)
    assert class_of(policy) == "other agent"
    assert information_of(policy) == Information(given=None, seen=None, steps=None)


def test_a_plain_training_has_no_inputs_but_rewards() -> None:
    stated = information_of(
        agent(
            PPO,
            position=False,
            frames=1,
            life_price="flat",
        )
    )
    assert stated.given == ("rewards",)
    assert stated.seen == ()


def test_terms_of_training_are_stated() -> None:
    stated = information_of(
        agent(
            PPO,
            position=True,
            frames=4,
            life_price="marginal",
        )
    )
    assert stated.given == ("rewards", "life price", "spreads")
    assert stated.seen == ("memory", "position")
    asymmetric = information_of(agent(PPO, asymmetric=True))
    assert asymmetric.given == ("rewards", "true states")


def test_terms_that_a_training_leaves_out_are_not_stated() -> None:
    stated = information_of(
        agent(
            ANALYTIC_GRADIENT,
            position=False,
            memory=False,
            life_price="flat",
        )
    )
    assert stated.given == ("model gradients", "true states", "geometry")
    assert stated.seen == ()


@pytest.mark.parametrize(
    ("policy", "expected"),
    [
        pytest.param(agent(PPO, life_price="end"), "model-free agent", id="flat price of life"),
        pytest.param(agent(PPO, life_price="marginal"), "privileged agent", id="price p(D)"),
        pytest.param(agent(PPO, asymmetric=True), "privileged agent", id="asymmetric critic"),
        pytest.param(agent(ANALYTIC_GRADIENT), "privileged agent", id="model gradients"),
        pytest.param(
            agent("python -m train.guided_ppo --seed 0", guide=True),
            "learned guide of a rule",
            id="guide",
        ),
        pytest.param(agent(PPO, belief=True), "agent on a belief", id="belief"),
        pytest.param(
            agent(None, training_information=["rewards"]), "model-free agent", id="stated inputs"
        ),
        pytest.param(agent(PPO, training_information="all"), "other agent", id="no statement"),
        pytest.param(
            agent(None, training_information=["rule's actions"], belief=True),
            "student of a rule",
            id="imitation",
        ),
        pytest.param(spec("rule"), "rule", id="rule"),
        pytest.param(spec("oracle", kind="oracle"), "oracle", id="oracle"),
    ],
)
def test_the_class_follows_from_the_inputs_of_training(policy: PolicySpec, expected: str) -> None:
    assert class_of(policy) == expected


def test_a_guide_counts_environment_steps() -> None:
    guide = agent("python -m train.guided_ppo --seed 0", guide=True, total_timesteps=1_500_000)
    assert information_of(guide).steps == 45_000_000


@pytest.mark.parametrize("steps", [-1, 10**400, 1.5, "many", True])
def test_a_number_of_steps_that_no_training_has_is_not_stated(steps: object) -> None:
    assert information_of(agent(PPO, total_timesteps=steps)).steps is None
