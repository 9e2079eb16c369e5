"""Whatever a part program holds, it is played with finite numbers or refused with an NcError."""

import json
import math
from dataclasses import asdict
from random import Random
from typing import Any

import pytest

pytest.importorskip("shapely")

from hypothesis import given
from hypothesis import strategies as st
from turning_nc.adapt import adapt
from turning_nc.cutting import AssumedMachine, Situation, play
from turning_nc.edges import beyond, change_wear
from turning_nc.moves import ReadingChoices, run
from turning_nc.plausibility import implausible
from turning_nc.removal import remove
from turning_nc.report import blocks_table, findings, rows, summary
from turning_nc.stock import guessed_stock, read_stock
from turning_nc.words import NcError, divide

from shop.tests.soundness.programs import STOCKS, TOOLS, any_program
from tests.soundness.acting import tried
from turning_env import Scenario

SCENARIO = Scenario.load("rough_turning")


def attempt(
    text: str, stock: str | None, kind: str | None, go_on: bool, adapted: bool
) -> list[Any] | None:
    """Return the rows and totals of a program; None if it is refused."""
    try:
        moves = run(divide(text), ReadingChoices(go_on=go_on))
        tools = {} if kind is None else {moves.moves[0].tool: kind}
        polygon = read_stock(stock) if stock else guessed_stock(moves, tools)[0]
        removal = remove(moves, polygon, tools)
        situation = Situation(SCENARIO, AssumedMachine(), moves, removal)
        played = play(situation, change_wear(situation))
        blocks = rows(situation, played)
        results = [
            [asdict(row) for row in blocks],
            asdict(summary(situation, played)),
            beyond(situation, played),
            implausible(situation, played),
            blocks_table(situation, blocks),
            findings(blocks),
        ]
        if adapted:
            after = adapt(situation)
            results.append(asdict(summary(after.situation, after.played)))
    except NcError:
        return None
    return results


def assert_finite(value: Any) -> None:
    """Assert that all numbers in nested results are finite."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple):
        for item in value:
            assert_finite(item)
    elif isinstance(value, float):
        assert math.isfinite(value)


@pytest.mark.slow
@tried(short=20, soak=15_000)
@given(st.randoms(use_true_random=False))
def test_a_program_is_played_with_finite_numbers_or_refused(random: Random) -> None:
    text = any_program(random)
    go_on = random.random() < 0.3
    adapted = random.random() < 0.1
    results = attempt(text, random.choice(STOCKS), random.choice(TOOLS), go_on, adapted)
    assert_finite(results)
    json.dumps(results, allow_nan=False)
