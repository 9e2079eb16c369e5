"""Rungs of the ladder are the jobs of `shop` in which only their own factor is uncertain."""

from pathlib import Path

import numpy as np
import pytest

from baselines.comparators import CAUSAL, NOMINAL_SHARE
from leaderboard.statistics import Floats
from research.studies import ladder
from research.studies.ladder import FACTORS, NONE, RUNGS, SPREADS, Rung, TruthfulRung
from turning_env import Family
from turning_env.scenario.family import DrawnJobs

pytestmark = pytest.mark.slow

SHOP = Family.load("shop")


def drawn(rung: Family) -> DrawnJobs:
    return rung.draw(ladder.SPLIT, 0)


def uncertain_fields(jobs: DrawnJobs) -> set[str]:
    """Return the fields that scatter in truth, or have another value than the nominal model."""
    scattering = {name for names in SPREADS.values() for name in names}
    names = set()
    for name, nominal in jobs.nominal_fields.items():
        value = jobs.true_fields[name]
        certain = 0.0 if name in scattering else nominal
        if np.any(value != certain):
            names.add(name)
    return names


@pytest.mark.parametrize("factor", FACTORS)
def test_a_rung_is_uncertain_in_its_own_factor_alone(factor: str) -> None:
    names = uncertain_fields(drawn(Rung.with_factors(SHOP, [factor])))
    # The base's spread of edge strength is one value in all jobs, and not one of the family's.
    names |= {"tool.edge_strength_spread"} if factor == "edges" else set()
    assert all(ladder.is_of(name, FACTORS[factor]) for name in names)
    for place in FACTORS[factor]:
        assert any(ladder.is_of(name, [place]) for name in names)


def test_nothing_is_uncertain_without_factors() -> None:
    assert uncertain_fields(drawn(Rung.with_factors(SHOP, RUNGS[NONE]))) == set()


@pytest.mark.parametrize("rung", RUNGS)
def test_policies_are_told_the_same_on_every_rung(rung: str) -> None:
    jobs = drawn(Rung.with_factors(SHOP, RUNGS[rung]))
    of_family = drawn(SHOP)
    for name, value in of_family.nominal_fields.items():
        np.testing.assert_array_equal(jobs.nominal_fields[name], value, err_msg=name)
    for name, number in of_family.features.items():
        np.testing.assert_array_equal(jobs.features[name], number, err_msg=name)


def test_a_rung_with_all_factors_is_the_family() -> None:
    jobs = drawn(Rung.with_factors(SHOP, RUNGS["all"]))
    for name, value in drawn(SHOP).true_fields.items():
        np.testing.assert_array_equal(jobs.true_fields[name], value, err_msg=name)


@pytest.mark.parametrize("name", [NONE, "depth", "law-of-wear"])
def test_the_oracle_knows_the_truth_of_a_rung(name: str) -> None:
    rung = Rung.with_factors(SHOP, RUNGS[name])
    known = TruthfulRung.of(rung).job(3, ladder.SPLIT).scenario
    played = rung.job(3, ladder.SPLIT).scenario
    assert known == known.nominal()
    assert known == played.model_copy(update={"nominal_model": ()})


def test_no_field_belongs_to_two_factors() -> None:
    places = [place for factor in FACTORS.values() for place in factor]
    assert len(places) == len(set(places))


def test_regrets_are_less_than_the_oracle_and_additions_more_than_without_any() -> None:
    def returns(lost: float) -> dict[str, Floats]:
        oracle = np.array([100.0, -50.0])
        return {CAUSAL: oracle, "predictive": oracle - lost}

    by_factor = {NONE: returns(lost=10.0), "depth": returns(lost=25.0)}
    without_any, with_depth = ladder.regrets(by_factor)
    assert without_any["`predictive`"] == "10 (10 to 10)"
    assert with_depth["`predictive`"] == "25 (25 to 25)"
    (added,) = ladder.additions(by_factor)
    assert added == {"Uncertain": "depth", "`predictive`": "15 (15 to 15)"}


def test_what_was_played_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--rungs", "depth", "--policies", NOMINAL_SHARE, "--jobs", "2"]
    words += ["--runs", str(tmp_path)]
    assert ladder.main(words) == 0
    table = capsys.readouterr().out
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    assert len(kept) == 2
    assert ladder.main(words) == 0
    assert capsys.readouterr().out == table
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")} == kept
