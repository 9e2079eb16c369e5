"""Fits of the laws return known numbers, and name what cannot be estimated."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from turning_shop import WorkshopError
from turning_shop.calibrate import Calibration, calibrate
from turning_shop.fit import FACTORS, fit
from turning_shop.measurements import Measurements, read_measurements

from turning_env import PowerLaw, Scenario

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "shop" / "examples" / "cuts.csv"
BASE = Scenario()
LAW = PowerLaw(
    coefficient=0.3, cutting_speed=0.8, feed=0.6, depth_of_cut=0.9, wear=0.3, hardness=0.5
)
RANGES = {
    "cutting_speed": (50, 200),
    "feed": (0.1, 0.6),
    "depth_of_cut": (1, 4),
    "wear": (0.05, 0.3),
    "hardness": (0.8, 1.2),
}


def table(**columns: object) -> Measurements:
    """Return measurements of columns that broadcast to one length, from line 2 on."""
    values = np.broadcast_arrays(*(np.asarray(column, float) for column in columns.values()))
    arrays = dict(zip(columns, values, strict=True))
    return Measurements(arrays, np.arange(2, 2 + len(values[0])))


def cuts(
    law: PowerLaw, count: int = 40, scatter: float = 0.0, seed: int = 0, **fixed: float
) -> Measurements:
    """Return measurements of a power by a law of five factors, which vary unless fixed."""
    random = np.random.default_rng(seed)
    factors = {}
    for name, (low, high) in RANGES.items():
        if name in fixed:
            factors[name] = np.full(count, fixed[name])
        else:
            factors[name] = random.uniform(low, high, count)
    power = law(**factors) * np.exp(scatter * random.standard_normal(count))
    return table(**factors, power=power)


@pytest.fixture(scope="module")
def example() -> Calibration:
    return calibrate(read_measurements(EXAMPLE), BASE)


@pytest.mark.parametrize("response", FACTORS)
def test_papers_tables_give_the_known_coefficients(response: str, example: Calibration) -> None:
    fitted = example.fits[response]
    known = getattr(BASE.material, response)
    for name, estimate in fitted.estimates.items():
        value = getattr(known, name)
        assert estimate.value == pytest.approx(value, rel=1e-3), name
        assert estimate.low <= value <= estimate.high, name
    assert set(fitted.assumed) == {"depth_of_cut", "hardness"}
    assert "depth_of_cut never varies: 2.5 mm" in fitted.assumed["depth_of_cut"]
    assert fitted.law.depth_of_cut == known.depth_of_cut
    assert fitted.r_squared == pytest.approx(1.0, abs=1e-5)
    assert len(fitted.lines) == (48 if response == "wear" else 32)


exponents = st.floats(-2, 2)
all_exponents = st.fixed_dictionaries(dict.fromkeys(FACTORS["power"], exponents))


@settings(max_examples=15)
@given(
    values=all_exponents,
    log_coefficient=st.floats(-3, 3),
    reference=st.floats(0.5, 5),
    seed=st.integers(0, 1000),
)
def test_any_law_is_recovered(
    values: dict[str, float], log_coefficient: float, reference: float, seed: int
) -> None:
    coefficient = float(np.exp(log_coefficient))
    law = PowerLaw(coefficient=coefficient, reference_depth_of_cut=reference, **values)
    base = PowerLaw(coefficient=1.0, reference_depth_of_cut=reference)
    fitted = fit("power", cuts(law, 12, seed=seed), base)
    assert not fitted.assumed
    for name, estimate in fitted.estimates.items():
        assert estimate.value == pytest.approx(getattr(law, name), rel=1e-6, abs=1e-6)


@settings(max_examples=10)
@given(
    first=st.sampled_from(("cutting_speed", "feed")),
    slope=st.sampled_from((-1.5, 0.5, 2.0)),
    assumed=exponents,
)
def test_of_factors_that_vary_together_one_is_assumed(
    first: str, slope: float, assumed: float
) -> None:
    measured = cuts(LAW, 30)
    measured.columns["depth_of_cut"] = (measured.columns[first] / 10) ** slope
    measured.columns["power"] = LAW(**{name: measured.columns[name] for name in FACTORS["power"]})
    fitted = fit("power", measured, PowerLaw(coefficient=1.0, depth_of_cut=assumed))
    assert fitted.assumed == {"depth_of_cut": f"depth_of_cut varies only together with {first}"}
    # An error of the assumption goes to the exponent of the other factor.
    # The law still reproduces the rows.
    exponent = getattr(LAW, first) + slope * (LAW.depth_of_cut - assumed)
    assert getattr(fitted.law, first) == pytest.approx(exponent, abs=1e-6)
    assert fitted.predicted == pytest.approx(fitted.measured, rel=1e-6)


@pytest.mark.parametrize(("count", "needed"), [(1, 2), (2, 7), (6, 7)])
def test_too_few_rows_are_refused_with_the_number_needed(count: int, needed: int) -> None:
    message = rf"^power: {count} rows? with .* but {needed} are needed"
    with pytest.raises(WorkshopError, match=message):
        fit("power", cuts(LAW, count, scatter=0.1), LAW)


def test_as_many_rows_as_needed_leave_one_degree_of_freedom() -> None:
    assert fit("power", cuts(LAW, 7, scatter=0.1), LAW).degrees == 1


def with_edges(spread: float, seed: int) -> Measurements:
    """Return four readings of wear of each of twelve edges.

    Edges differ by a factor; ``spread`` is the standard deviation of its logarithm.
    """
    random = np.random.default_rng(seed)
    low = (60, 0.1, 1, 0.85)
    high = (190, 0.6, 4, 1.15)
    settings = np.repeat(random.uniform(low, high, (12, 4)), 4, axis=0)
    names = ("cutting_speed", "feed", "depth_of_cut", "hardness")
    factors = dict(zip(names, settings.T, strict=True))
    factors["time"] = np.tile((1.0, 3.0, 6.0, 10.0), 12)
    log_edge_factor = np.repeat(spread * random.standard_normal(12), 4)
    log_factor = log_edge_factor + 0.03 * random.standard_normal(48)
    measured = table(**factors, wear=BASE.material.wear(**factors) * np.exp(log_factor))
    return replace(measured, edges=np.repeat(random.permutation(12), 4))


TRIALS = 100


@pytest.mark.slow
def test_unnamed_edges_that_differ_are_noticed_and_chance_is_not() -> None:
    def share_noticed(spread: float, sheets: int) -> float:
        """Return the share of sheets that are warned of."""
        num_noticed = 0
        for seed in range(sheets):
            measured = replace(with_edges(spread, seed), edges=None)
            warnings = "\n".join(calibrate(measured, BASE, force=True).warnings)
            num_noticed += "wear: rows at the same settings deviate together" in warnings
        return num_noticed / sheets

    assert share_noticed(0.1, sheets=TRIALS // 2) > 0.95
    assert share_noticed(0.0, sheets=TRIALS) <= 0.05


@pytest.mark.slow
@pytest.mark.parametrize("spread", [0.0, 0.1])
def test_intervals_cover_the_truth_with_named_edges(spread: float) -> None:
    covered = dict.fromkeys(("coefficient", *FACTORS["wear"]), 0)
    spreads = []
    for seed in range(TRIALS):
        fitted = fit("wear", with_edges(spread, seed), BASE.material.wear)
        assert fitted.edges is not None
        spreads.append(fitted.edges.spread)
        for name, estimate in fitted.estimates.items():
            covered[name] += estimate.low <= getattr(BASE.material.wear, name) <= estimate.high
    for name, times in covered.items():
        # If edges do not differ, intervals still allow for it, and are wider than they need be.
        assert 0.87 < times / TRIALS < (0.99 if spread else 1.01), name
    assert np.sqrt(np.mean(np.square(spreads))) == pytest.approx(spread, abs=0.01)


def test_law_without_rows_stays_the_bases() -> None:
    measured = cuts(BASE.material.power)
    calibration = calibrate(measured, BASE)
    assert calibration.material.power.hardness == pytest.approx(0.75)
    assert calibration.material.wear == BASE.material.wear
    assert calibration.kept == {
        "wear": "there is no column time",
        "thrust_force": "there is no column thrust_force",
    }
    measured.columns["thrust_force"] = np.full(40, np.nan)
    reason = calibrate(measured, BASE).kept["thrust_force"]
    assert "no row has all of thrust_force, cutting_speed" in reason
    assert reason.endswith("empty in all rows: thrust_force")


def test_a_sheet_without_responses_is_refused() -> None:
    settings_alone = table(cutting_speed=[1.0, 2.0], feed=0.3, depth_of_cut=2.0)
    message = "no law can be fitted: wear: there is no column wear, time"
    with pytest.raises(WorkshopError, match=message):
        calibrate(settings_alone, BASE)


def test_empty_cells_exclude_rows_and_mean_nominal_hardness() -> None:
    measured = cuts(BASE.material.power, 40)
    measured.columns["power"][:10] = np.nan
    measured.columns["hardness"][10:15] = np.nan
    calibration = calibrate(measured, BASE)
    assert calibration.fits["power"].lines.tolist() == list(range(12, 42))
    assert (
        "10 rows have too many empty cells for any law, the first in line 2" in calibration.warnings
    )
    assert "hardness is empty in 5 rows, where it was taken as nominal, 1" in calibration.warnings


def test_wide_intervals_are_warned_of(example: Calibration) -> None:
    assert example.warnings == ()
    measured = cuts(PowerLaw(coefficient=0.3, cutting_speed=0.8), 12, scatter=0.05)
    measured.columns["feed"] = np.where(np.arange(12) < 6, 0.3, 0.305)
    warnings = calibrate(measured, BASE, force=True).warnings
    assert any("power: the exponent of feed is hardly known" in warning for warning in warnings)
