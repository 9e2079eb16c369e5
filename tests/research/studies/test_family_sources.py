"""Counts of the numbers of families by what their sources name."""

import pytest

from research.studies.family_sources import (
    ASSUMPTION,
    DATA,
    NEITHER,
    clause_for,
    counts_of,
    kind_of,
    numbers_of,
)
from turning_env import Family
from turning_env.scenario.family import families


@pytest.mark.parametrize(
    ("clause", "kind"),
    [
        ("measured: 0.39 to 0.73 (AIST)", DATA),
        ("0.24 of the paper (range: assumption)", ASSUMPTION),
        ("presets", NEITHER),
        ("", NEITHER),
    ],
)
def test_a_source_names_data_or_an_assumption_or_neither(clause: str, kind: str) -> None:
    assert kind_of(clause) == kind


def test_a_clause_holds_for_the_names_before_it() -> None:
    source = "kc, mc: ISCAR; speed: maker. truth: Roehm, eight materials; and replicates"
    names = ["kc", "mc", "speed", "truth"]
    assert clause_for(source, "mc", names) == "ISCAR"
    assert clause_for(source, "speed", names) == "maker"
    assert clause_for(source, "truth", names) == "Roehm, eight materials; and replicates"


def test_a_source_without_names_holds_for_all_but_the_truth() -> None:
    source = "typical of makers' data sheets"
    assert clause_for(source, "rated_power", ["rated_power", "truth"]) == source
    assert clause_for(source, "truth", ["rated_power", "truth"]) == ""


def test_every_number_of_a_family_is_counted_once() -> None:
    family = Family.load(
        {
            "name": "small",
            "jobs": 8,
            "variables": {
                "factor": {
                    "log_uniform": [0.8, 1.2],
                    "unit": "-",
                    "source": "assumption; truth: AIST",
                    "truth": {"log_normal": [1.0, 0.1]},
                }
            },
            "tables": {"machine": {"columns": ["rated"], "rows": {"A": [7.5]}, "source": "none"}},
            "fields": {
                "material.power.coefficient": "0.30338170 * factor",
                "material.power.reference_depth_of_cut": 2.5,
                "limits.power": "rated",
                "economics.edge_cost": 2.0,
            },
        }
    )
    assert counts_of(family) == {DATA: 2, ASSUMPTION: 2, NEITHER: 2}


@pytest.mark.parametrize("name", families())
def test_every_number_has_a_source_and_three_in_ten_are_data(name: str) -> None:
    family = Family.load(name)
    counts = counts_of(family)
    assert [number for number in numbers_of(family) if number.kind == NEITHER] == []
    assert counts[DATA] / counts.total() > 0.3
