"""Fitting the laws: what is known comes out, and what cannot be known is named."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats

from turning_env import PowerLaw, Scenario
from turning_env.workshop.calibration.columns import FACTORS, CalibrationError
from turning_env.workshop.calibration.material import Calibration, calibrate
from turning_env.workshop.calibration.reading import Measurements, read_measurements
from turning_env.workshop.calibration.regression import fit
from turning_env.workshop.calibration.student import MANY, two_sided_quantile

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "docs" / "examples" / "cuts.csv"
BASE = Scenario()


def table(**columns: object) -> Measurements:
    arrays = dict(zip(columns, np.broadcast_arrays(*(np.asarray(values, float) for values in columns.values())), strict=True))
    return Measurements(arrays, np.arange(2, 2 + len(next(iter(arrays.values())))))


def cuts(law: PowerLaw, count: int = 40, scatter: float = 0.0, seed: int = 0, **fixed: float) -> Measurements:
    """Measurements of a power by a law of speed, feed, depth, wear and hardness, all of which vary unless fixed."""
    random = np.random.default_rng(seed)
    ranges = {
        "cutting_speed": (50, 200),
        "feed": (0.1, 0.6),
        "depth_of_cut": (1, 4),
        "wear": (0.05, 0.3),
        "hardness": (0.8, 1.2),
    }
    factors = {
        name: np.full(count, fixed[name]) if name in fixed else random.uniform(*ends, count) for name, ends in ranges.items()
    }
    return table(**factors, power=law(**factors) * np.exp(scatter * random.standard_normal(count)))


def example() -> Calibration:
    return calibrate(read_measurements(EXAMPLE), BASE)


def test_the_example_is_the_papers_tables() -> None:
    def printed(name: str) -> list[dict[str, str]]:
        return list(csv.DictReader((ROOT / "baselines" / "paper" / name).read_text("utf-8").splitlines()))

    expected = {
        (r["speed_m_min"], r["feed_mm_rev"], "2.5", r["time_min"], r["wear_mm"], r["thrust_force_n"], r["power_kw"])
        for r in printed("table1.csv")
    }
    for r in printed("table2.csv"):
        start = (r["speed_m_min"], r["feed_mm_rev"], "2.5")
        expected |= {(*start, "1", r["wear_at_t_minus_1_mm"], "", ""), (*start, "2", r["wear_at_t_mm"], "", "")}
        expected |= {(*start, "", r["total_wear_mm"], r["thrust_force_n"], r["power_kw"])}
    rows = list(csv.reader(EXAMPLE.read_text("utf-8").splitlines()))
    assert len(rows) == 65
    assert {tuple(row) for row in rows[1:]} == expected


@pytest.mark.parametrize("response", FACTORS)
def test_the_papers_tables_give_the_known_coefficients(response: str) -> None:
    found, known = example().fits[response], getattr(BASE.material, response)
    for name, estimate in found.estimates.items():
        value = getattr(known, name)
        assert estimate.value == pytest.approx(value, rel=1e-3), name
        assert estimate.low <= value <= estimate.high, name
    assert set(found.assumed) == {"depth_of_cut", "hardness"}
    assert "depth_of_cut never varies: 2.5 mm" in found.assumed["depth_of_cut"]
    assert found.law.depth_of_cut == known.depth_of_cut
    assert found.r_squared == pytest.approx(1.0, abs=1e-5)
    assert len(found.lines) == (48 if response == "wear" else 32)


exponents = st.floats(-2, 2)


@given(
    values=st.fixed_dictionaries({name: exponents for name in FACTORS["power"]}),
    log_coefficient=st.floats(-3, 3),
    reference=st.floats(0.5, 5),
    seed=st.integers(0, 1000),
)
def test_any_law_comes_back_from_what_it_gives(
    values: dict[str, float], log_coefficient: float, reference: float, seed: int
) -> None:
    law = PowerLaw(coefficient=float(np.exp(log_coefficient)), reference_depth_of_cut=reference, **values)
    base = PowerLaw(coefficient=1.0, reference_depth_of_cut=reference)
    found = fit("power", cuts(law, 12, seed=seed), base)
    assert found is not None
    assert not found.assumed
    for name, estimate in found.estimates.items():
        assert estimate.value == pytest.approx(getattr(law, name), rel=1e-6, abs=1e-6)


@given(values=st.fixed_dictionaries({name: exponents for name in FACTORS["power"]}), held=st.sampled_from(FACTORS["power"]))
def test_a_factor_that_never_varies_keeps_its_exponent_and_the_law_still_holds(values: dict[str, float], held: str) -> None:
    law = PowerLaw(coefficient=2.0, **values)
    base = PowerLaw(coefficient=1.0, **{held: 0.7})
    measurements = cuts(law, 20, **{held: 1.1 if held == "hardness" else 0.3})
    found = fit("power", measurements, base)
    assert found is not None
    assert list(found.assumed) == [held]
    assert "never varies" in found.assumed[held]
    assert getattr(found.law, held) == 0.7
    assert found.predicted == pytest.approx(found.measured, rel=1e-6)


@given(first=st.sampled_from(("cutting_speed", "feed")), slope=st.sampled_from((-1.5, 0.5, 2.0)), assumed=exponents)
def test_factors_that_vary_together_are_named_and_one_is_assumed(first: str, slope: float, assumed: float) -> None:
    law = PowerLaw(coefficient=2.0, cutting_speed=0.8, feed=0.6, depth_of_cut=0.9, wear=0.3, hardness=0.5)
    told = cuts(law, 30)
    told.columns["depth_of_cut"] = (told.columns[first] / 10) ** slope
    factors = {name: told.columns[name] for name in FACTORS["power"]}
    told.columns["power"] = law(**factors)
    found = fit("power", told, PowerLaw(coefficient=1.0, depth_of_cut=assumed))
    assert found is not None
    assert found.assumed == {"depth_of_cut": f"depth_of_cut varies only together with {first}"}
    # What is wrong with the assumption goes to the exponent of the other; the law gives back the rows all the same.
    assert getattr(found.law, first) == pytest.approx(getattr(law, first) + slope * (0.9 - assumed), abs=1e-6)
    assert found.predicted == pytest.approx(found.measured, rel=1e-6)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    law = PowerLaw(coefficient=0.3, cutting_speed=0.8, feed=0.6, depth_of_cut=0.9, wear=0.3, hardness=0.5)
    trials, held = 400, dict.fromkeys(("coefficient", *FACTORS["power"]), 0)
    for seed in range(trials):
        found = fit("power", cuts(law, 12, 0.05, seed), law, confidence=0.9)
        assert found is not None
        for name, estimate in found.estimates.items():
            held[name] += estimate.low <= getattr(law, name) <= estimate.high
    for name, times in held.items():
        assert times / trials == pytest.approx(0.9, abs=0.045), name  # three standard errors


def test_the_numbers_are_those_of_textbook_least_squares() -> None:
    law = PowerLaw(coefficient=0.3, cutting_speed=0.8)
    told = cuts(law, 15, 0.1, feed=0.3, depth_of_cut=2.5, wear=0.2, hardness=1.0)
    found = fit("power", told, PowerLaw(coefficient=1.0))
    assert found is not None
    line = stats.linregress(np.log(told.columns["cutting_speed"]), np.log(told.columns["power"]))
    reach = stats.t.ppf(0.975, 13) * line.stderr
    estimate = found.estimates["cutting_speed"]
    assert (estimate.value, estimate.low, estimate.high) == pytest.approx((line.slope, line.slope - reach, line.slope + reach))
    low, high = (line.intercept + sign * stats.t.ppf(0.975, 13) * line.intercept_stderr for sign in (-1, 1))
    estimate = found.estimates["coefficient"]
    assert np.log((estimate.value, estimate.low, estimate.high)) == pytest.approx((line.intercept, low, high))
    assert found.r_squared == pytest.approx(line.rvalue**2)


@pytest.mark.parametrize("confidence", [0.5, 0.9, 0.95, 0.9999])
@pytest.mark.parametrize("degrees", [1, 2, 3, 4, 5, 10, 31, MANY, MANY + 1, 10**7])
def test_quantiles_are_students(confidence: float, degrees: int) -> None:
    assert two_sided_quantile(confidence, degrees) == pytest.approx(stats.t.ppf(0.5 + confidence / 2, degrees), rel=1e-8)


@given(count=st.integers(1, 6))
def test_too_few_rows_are_refused_with_the_number_that_is_needed(count: int) -> None:
    law = PowerLaw(coefficient=0.3, cutting_speed=0.8)
    told = cuts(law, count, 0.1)
    needed = 2 if count == 1 else 7
    with pytest.raises(CalibrationError, match=rf"^power: {count} rows? with .* but {needed} are needed"):
        fit("power", told, law)
    assert fit("power", cuts(law, 7, 0.1), law) is not None


def test_one_condition_repeated_scales_the_base_law() -> None:
    told = table(cutting_speed=150, feed=0.3, depth_of_cut=2.5, wear=0.2, power=[5.4, 5.5, 5.6])
    found = calibrate(told, BASE)
    assert list(found.fits["power"].estimates) == ["coefficient"]
    assert found.material.power(150, 0.3, 2.5, wear=0.2) == pytest.approx((5.4 * 5.5 * 5.6) ** (1 / 3))
    assert found.material.power.feed == BASE.material.power.feed
    assert found.fits["power"].r_squared == pytest.approx(0.0, abs=1e-9)


def test_a_law_without_rows_is_the_bases() -> None:
    told = cuts(BASE.material.power)
    found = calibrate(told, BASE)
    assert found.material.wear == BASE.material.wear
    assert found.kept == {"wear": "there is no column time", "thrust_force": "there is no column thrust_force"}
    told.columns["thrust_force"] = np.full(40, np.nan)
    assert "no row has all of thrust_force, cutting_speed" in calibrate(told, BASE).kept["thrust_force"]
    with pytest.raises(CalibrationError, match="as --strict demands: thrust_force: no row has all of"):
        calibrate(told, BASE, strict=True)


def test_nothing_to_fit_is_an_error() -> None:
    with pytest.raises(CalibrationError, match="no law can be fitted: wear: there is no column wear, time"):
        calibrate(table(cutting_speed=[1.0, 2.0], feed=0.3, depth_of_cut=2.0), BASE)


def test_strict_refuses_what_the_file_has_and_cannot_tell() -> None:
    with pytest.raises(CalibrationError, match="as --strict demands") as error:
        calibrate(read_measurements(EXAMPLE), BASE, strict=True)
    assert "; thrust_force: depth_of_cut never varies" in str(error.value)
    assert "hardness" not in str(error.value)  # there is no such column
    assert calibrate(cuts(BASE.material.power), BASE, strict=True).material.power.hardness == pytest.approx(0.75)


def test_rows_count_for_the_laws_whose_cells_they_have() -> None:
    told = cuts(BASE.material.power, 40)
    told.columns["power"][:10] = np.nan
    told.columns["hardness"][10:15] = np.nan
    found = calibrate(told, BASE)
    assert len(found.fits["power"].lines) == 30
    assert found.fits["power"].lines[0] == 12
    assert "10 rows have too many empty cells for any law, the first in line 2" in found.warnings
    assert "hardness is empty in 5 rows, where it was taken as nominal, 1" in found.warnings


def test_extrapolation_is_said() -> None:
    warnings = example().warnings
    assert warnings == (
        "wear, thrust_force, power: extrapolated, used at a feed of 0.06 to 0.6 mm/rev, but measured at 0.165 to 0.6",
        "wear: extrapolated, used at a wear of up to 0.3 mm, but measured at 0.06753 to 0.203",
        "thrust_force, power: extrapolated, used at a wear of up to 0.3 mm, but measured at 0.08388 to 0.1889",
    )
    told = cuts(BASE.material.power, 40, depth_of_cut=2.0)
    deep = "power: extrapolated, used at a depth_of_cut of 2.5 mm, but measured at 2"
    assert deep in calibrate(told, BASE).warnings
    stepped = Scenario.model_validate({"workpiece": {"depth_profile": [1.0, 2.0]}})
    assert deep.replace("2.5 mm", "1 to 2 mm") in calibrate(told, stepped).warnings


def test_an_exponent_that_is_hardly_known_is_said() -> None:
    told = cuts(PowerLaw(coefficient=0.3, cutting_speed=0.8), 12, 0.05)
    told.columns["feed"] = np.where(np.arange(12) < 6, 0.3, 0.305)
    assert any("power: the exponent of feed is hardly known" in warning for warning in calibrate(told, BASE).warnings)


def test_what_is_no_law_is_refused() -> None:
    told = cuts(PowerLaw(coefficient=1.0, wear=10), 20)
    told.columns["power"] *= told.columns["wear"] ** 0.5
    with pytest.raises(
        CalibrationError, match=r"power: exponent of wear, as fitted: 10\.5.* is outside the allowed range -10 to 10"
    ):
        calibrate(told, BASE)
    shrinking = table(cutting_speed=100, feed=0.3, depth_of_cut=2, time=[1, 2, 4, 8], wear=[0.3, 0.2, 0.15, 0.1])
    with pytest.raises(CalibrationError, match="but wear must grow with time"):
        calibrate(shrinking, BASE)


@given(seed=st.integers(0, 100), scale=st.floats(0.1, 10))
def test_the_order_of_rows_and_the_unit_of_a_response_do_not_matter(seed: int, scale: float) -> None:
    law = PowerLaw(coefficient=0.3, cutting_speed=0.8, feed=0.6, depth_of_cut=0.9, wear=0.3, hardness=0.5)
    told = cuts(law, 20, 0.05, seed)
    order = np.random.default_rng(seed).permutation(20)
    changed = Measurements({name: values[order] for name, values in told.columns.items()}, told.lines[order])
    changed.columns["power"] *= scale
    first, second = fit("power", told, law), fit("power", changed, law)
    assert first is not None
    assert second is not None
    assume(first.r_squared is not None)
    assert second.r_squared == pytest.approx(first.r_squared)
    for name, estimate in first.estimates.items():
        factor = scale if name == "coefficient" else 1.0
        assert getattr(second.estimates[name], "high") == pytest.approx(factor * estimate.high, abs=1e-9)  # noqa: B009


def of_edges(spread: float, seed: int, named: bool) -> Measurements:
    """Four readings of wear along each of twelve edges, which differ by a factor of a given log standard deviation."""
    random = np.random.default_rng(seed)
    low, high = (60, 0.1, 1, 0.85), (190, 0.6, 4, 1.15)
    settings = np.repeat(random.uniform(low, high, (12, 4)), 4, axis=0)
    names = ("cutting_speed", "feed", "depth_of_cut", "hardness")
    factors = dict(zip(names, settings.T, strict=True)) | {"time": np.tile((1.0, 3.0, 6.0, 10.0), 12)}
    log_factor = np.repeat(spread * random.standard_normal(12), 4) + 0.03 * random.standard_normal(48)
    told = table(**factors, wear=BASE.material.wear(**factors) * np.exp(log_factor))
    return replace(told, edges=np.repeat(random.permutation(12), 4)) if named else told


TRIALS = 200


def test_edges_that_differ_are_noticed_and_chance_is_not() -> None:
    def noticed(spread: float) -> int:
        warnings = (calibrate(of_edges(spread, seed, named=False), BASE).warnings for seed in range(TRIALS))
        return sum(any("wear: rows of the same settings lie off together" in warning for warning in each) for each in warnings)

    assert noticed(0.1) > 0.95 * TRIALS
    assert noticed(0.0) < 0.05 * TRIALS


@pytest.mark.parametrize("spread", [0.0, 0.1])
def test_intervals_hold_the_truth_where_edges_are_named(spread: float) -> None:
    held = dict.fromkeys(("coefficient", *FACTORS["wear"]), 0)
    spreads = []
    for seed in range(TRIALS):
        found = fit("wear", of_edges(spread, seed, named=True), BASE.material.wear, confidence=0.9)
        assert found is not None
        assert found.edges is not None
        spreads.append(found.edges.spread)
        for name, estimate in found.estimates.items():
            held[name] += estimate.low <= getattr(BASE.material.wear, name) <= estimate.high
    for name, times in held.items():
        # Where edges do not differ, intervals allow for that they might, and hold it more often.
        assert 0.83 < times / TRIALS < (0.97 if spread else 1.01), name
    assert np.sqrt(np.mean(np.square(spreads))) == pytest.approx(spread, abs=0.01)


def test_edges_of_one_reading_each_change_nothing() -> None:
    told = cuts(BASE.material.power, 20, 0.05)
    plain = fit("power", told, BASE.material.power)
    alone = fit("power", replace(told, edges=np.arange(20)), BASE.material.power)
    assert plain is not None
    assert alone is not None
    assert alone.edges is None
    assert alone.estimates == plain.estimates
    warnings = calibrate(replace(told, edges=np.arange(20)), BASE).warnings
    assert any("power: too few edges or readings" in warning for warning in warnings)


def test_readings_that_agree_exactly_within_edges_are_fitted() -> None:
    told = of_edges(0.1, 0, named=True)
    factors = {name: told.columns[name] for name in FACTORS["wear"]}
    assert told.edges is not None
    told.columns["wear"][:] = BASE.material.wear(**factors) * (1 + 0.01 * told.edges)
    found = fit("wear", told, BASE.material.wear)
    assert found is not None
    assert found.law.time == pytest.approx(0.245)
    assert found.edges is not None
    assert 0.01 < found.edges.spread < 0.1
