"""Inputs of agents as tables state them, against their files and algorithms."""

from pathlib import Path

import pytest

from baselines.guided import HOLD
from leaderboard.information import Information, class_of, information
from leaderboard.policies import AGENTS
from tests.leaderboard.conftest import spec
from train.agents import agent_file
from train.agent_inputs import DistanceTracker
from turning_env import Scenario

SCENARIO = Scenario.load("rough_turning")


def told(command: str | None, scenario: Scenario = SCENARIO, **parameters: object) -> Information:
    found = information(spec("mine", seed=0, command=command, parameters=parameters), scenario)
    assert found is not None
    return found


@pytest.mark.parametrize(
    "path",
    sorted(AGENTS.glob("*/*/*-seed0.onnx")),
    ids=lambda path: f"{path.parents[1].name}-{path.stem}",
)
def test_shipped_agents_have_the_memory_that_the_table_states(path: Path) -> None:
    file = agent_file.read(path)
    policy = spec(
        file.metadata.name,
        seed=0,
        command=file.metadata.command,
        parameters=file.metadata.parameters,
    )
    found = information(policy, file.metadata.scenario)
    assert found is not None
    assert found.seen is not None
    p, entries = file.metadata.parameters, len(file.metadata.observation_space.low)
    tracker = DistanceTracker.STATES * ("position" in found.seen)
    remembered = 2 * p.get("memory_cells", 0) + (p.get("frames", 1) - 1) * entries
    assert file.memory_size == (p["cells"] + tracker if "cells" in p else remembered)
    assert ("memory" in found.seen) == (file.memory_size > 0)
    steps = HOLD if p.get("guide") else 1  # a guide's training counts decisions
    assert found.steps == steps * file.metadata.trained_steps


@pytest.mark.parametrize(
    "command",
    [None, "train it", "python -m train.export mine.zip", "python -m train.ppo_of_mine --seed 0"],
)
def test_what_is_not_stated_is_not_guessed(command: str | None) -> None:
    assert class_of(spec("mine", seed=0, command=command)) == "other agent"
    assert told(command) == Information(None, None, None)


def test_terms_of_training_are_stated_and_count() -> None:
    """Position, frames and life price appear in the table; a price of life p(D) makes an agent privileged."""
    command = "python -m train.ppo --seed 0"
    plain = told(command, position=False, frames=1, life_price="flat")
    assert (plain.given, plain.seen) == (("rewards",), ())
    every = told(command, position=True, frames=4, life_price="marginal")
    assert (every.given, every.seen) == (
        ("rewards", "life price", "spreads"),
        ("memory", "position"),
    )
    classes = [
        class_of(spec("any", seed=0, command=command, parameters={"life_price": each}))
        for each in ("end", "marginal")
    ]
    assert classes == ["model-free agent", "privileged agent"]

    assert told(command, asymmetric=True).given == ("rewards", "true states")
    fewer = told(
        "python -m train.analytic_gradient", position=False, memory=False, life_price="flat"
    )
    assert fewer.seen == ()
    assert "life price" not in (fewer.given or ())


def test_an_agent_that_guides_a_rule_is_no_model_free_agent_and_counts_steps_of_the_environment() -> (
    None
):
    parameters = {"guide": True, "steps": 1_500_000}
    guide = spec(
        "mine", seed=0, command="python -m train.guided_ppo --seed 0", parameters=parameters
    )
    assert class_of(guide) == "guiding agent"
    assert told(guide.command, guide=True, steps=1_500_000).steps == 45_000_000


@pytest.mark.parametrize("steps", [-1, 10**400, 1.5, "many", True])
def test_a_number_of_steps_that_no_training_has_is_not_stated(steps: object) -> None:
    assert told("python -m train.ppo", steps=steps).steps is None
