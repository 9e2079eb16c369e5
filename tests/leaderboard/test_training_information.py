"""Agents' files state what their training was given."""

from pathlib import Path

import pytest

from leaderboard.agents import agent_file
from leaderboard.training_information import (
    IMITATION,
    MODEL_FREE,
    TRAINING_INPUTS,
    training_information,
    with_terms,
)
from tests.train.small import ALGORITHMS

AGENTS = Path(__file__).parents[2] / "agents"
TEACHER = {"model gradients", "true states", "geometry", "life price", "spreads"}


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
    assert set(with_terms(["rewards"], parameters)) == expected


def test_a_flat_life_price_takes_the_dynamic_programme_from_a_teacher() -> None:
    assert set(with_terms(TEACHER, {"life_price": "flat"})) == TEACHER - {"life price", "spreads"}


def test_inputs_are_as_stated() -> None:
    stated = {"training_information": ["rewards", "true states"]}
    assert training_information(stated) == {"rewards", "true states"}


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
def test_what_no_statement_says_is_not_guessed(parameters: dict[str, object]) -> None:
    assert training_information(parameters) is None


@pytest.mark.parametrize(
    "path", sorted(AGENTS.glob("*/*/*-seed0.onnx")), ids=lambda path: path.stem
)
def test_shipped_agents_keep_their_inputs(path: Path) -> None:
    metadata = agent_file.read(path).metadata
    given = training_information(metadata.parameters)
    assert given is not None
    assert (metadata.algorithm == "analytic_gradient") == (not given <= MODEL_FREE | IMITATION)
