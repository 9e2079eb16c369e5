"""The form of a law of force or power: it is chosen by predictions of edges that were left out."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from turning_shop.__main__ import main
from turning_shop.calibrate import Calibration, calibrate
from turning_shop.fit import fit, with_growth
from turning_shop.measurements import Measurements
from turning_shop.regression import MAX_GROWTH

from shop.tests.turning_shop.sheets import forces
from turning_env import Scenario

BASE = Scenario()
EDGES = 12
WEARS = np.linspace(0.03, 0.4, 8)


def sheet(
    load_of_wear, *, wears=WEARS, edge_spread: float = 0.03, scatter: float = 0.02, seed: int = 1
) -> Measurements:
    """Return thrust forces of edges that differ, each read at all wears."""
    random = np.random.default_rng(seed)
    edge = np.repeat(np.arange(EDGES), len(wears))
    feed = np.array([0.15, 0.25, 0.4])[edge % 3]
    depth = np.array([1.5, 2.0, 3.0, 2.5])[edge % 4]
    speed = np.array([120.0, 160.0, 200.0, 180.0, 140.0])[edge % 5]
    wear = np.tile(wears, EDGES)
    log_deviation = edge_spread * random.standard_normal(EDGES)[edge]
    log_deviation += scatter * random.standard_normal(len(edge))
    force = 900 * feed**0.6 * depth * load_of_wear(wear) * np.exp(log_deviation)
    columns = {
        "cutting_speed": speed,
        "feed": feed,
        "depth_of_cut": depth,
        "wear": wear,
        "thrust_force": force,
    }
    return Measurements(columns, np.arange(2, 2 + len(edge)), edges=edge)


def growing(wear):
    return 1.0 + 4.0 * wear


def power(wear):
    return 5.0 * wear**0.6


def calibrated(measurements: Measurements) -> Calibration:
    return calibrate(measurements, BASE)


def test_a_load_with_a_fresh_edges_share_gets_this_form() -> None:
    calibration = calibrated(sheet(growing))
    law = calibration.material.thrust_force
    assert law.wear == 1.0
    assert law.wear_growth == pytest.approx(4.0, abs=0.6)
    estimate = calibration.fits["thrust_force"].estimates["wear_growth"]
    assert estimate.low < 4.0 < estimate.high
    assert calibration.forms["thrust_force"].startswith("1 + b VB, as the median error")


def test_a_power_of_the_wear_stays_one() -> None:
    calibration = calibrated(sheet(power))
    law = calibration.material.thrust_force
    assert law.wear == pytest.approx(0.6, abs=0.03)
    assert law.wear_growth == 0.0
    assert calibration.forms["thrust_force"].startswith("a power of VB, as the median error")


def test_the_base_keeps_its_form_if_rows_cannot_tell() -> None:
    close = sheet(growing, wears=np.array([0.2, 0.22, 0.24]), scatter=0.05)
    assert calibrated(close).material.thrust_force.wear_growth == 0.0
    material = BASE.material.model_copy(
        update={"thrust_force": with_growth(BASE.material.thrust_force, 3.0)}
    )
    base = BASE.model_copy(update={"material": material})
    assert calibrate(close, base).material.thrust_force.wear_growth > 0.0


def test_fresh_edges_decide_for_their_share() -> None:
    calibration = calibrated(sheet(growing, wears=np.array([0.0, 0.1, 0.2, 0.3])))
    assert calibration.material.thrust_force.wear_growth == pytest.approx(4.0, abs=0.5)
    assert "12 rows are of fresh edges" in calibration.forms["thrust_force"]
    assert calibration.fits["thrust_force"].fresh.sum() == 12


def test_one_wear_of_all_edges_leaves_the_bases_exponent() -> None:
    calibration = calibrated(sheet(growing, wears=np.array([0.2])))
    law = calibration.material.thrust_force
    assert law.wear == BASE.material.thrust_force.wear
    assert law.wear_growth == 0.0
    assert "wear never varies: 0.2 mm" in calibration.fits["thrust_force"].assumed["wear"]


@pytest.mark.parametrize("wears", [WEARS, np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.4])])
def test_a_form_that_fits_nowhere_is_named_and_no_row_is_called_wrong(wears) -> None:
    calibration = calibrated(
        sheet(lambda wear: 1.0 + np.exp(-((wear - 0.2) ** 2) / 0.003), wears=wears)
    )
    assert calibration.problems == ()
    (warning,) = [text for text in calibration.warnings if "form does not fit" in text]
    assert warning.startswith("thrust_force: the law's form does not fit: at a wear of")


def test_a_typing_error_is_found_in_either_form() -> None:
    for load_of_wear in (growing, power):
        measurements = sheet(load_of_wear)
        measurements.columns["thrust_force"][20] *= 0.2
        calibration = calibrate(measurements, BASE, force=True)
        assert [problem.split(":")[0] for problem in calibration.problems] == ["line 22"]


def test_many_readings_of_few_edges_do_not_narrow_the_growth() -> None:
    """Edges whose loads grow differently tell the growth only as well as they agree."""
    random = np.random.default_rng(3)
    few = sheet(growing, wears=np.linspace(0.0, 0.4, 8))
    many = sheet(growing, wears=np.linspace(0.0, 0.4, 150))
    growths = 4.0 * np.exp(0.4 * random.standard_normal(EDGES))
    widths = []
    for measurements in (few, many):
        wear = measurements.columns["wear"]
        growth = growths[measurements.edges]
        measurements.columns["thrust_force"] *= (1 + growth * wear) / growing(wear)
        fitted = fit("thrust_force", measurements, with_growth(BASE.material.thrust_force, 1.0))
        estimate = fitted.estimates["wear_growth"]
        widths.append(estimate.high - estimate.low)
        assert estimate.low < 4.0 < estimate.high
    assert widths[1] == pytest.approx(widths[0], rel=0.3)


def test_a_load_that_falls_with_wear_is_implausible() -> None:
    falling = sheet(lambda wear: 1.0 - 0.8 * wear, wears=np.array([0.0, 0.1, 0.2, 0.3, 0.4]))
    calibration = calibrate(falling, BASE, force=True)
    assert "thrust_force: falls with wear: wear_growth" in "\n".join(calibration.problems)


def test_forms_are_chosen_without_names_of_edges() -> None:
    calibration = calibrated(replace(sheet(growing), edges=None))
    assert calibration.material.thrust_force.wear_growth > 0.0
    assert "worn rows left out" in calibration.forms["thrust_force"]


def test_readings_of_an_edge_that_lies_off_the_law_are_no_typing_errors() -> None:
    measurements = sheet(growing, scatter=0.01, edge_spread=0.01)
    columns = measurements.columns
    # Above a depth, the force is higher than a power of the depth says, and most at low feed.
    deep = columns["depth_of_cut"] == 3.0
    columns["thrust_force"][deep] *= 1.35
    columns["thrust_force"][deep & (columns["wear"] > 0.3)] *= 1.2
    assert calibrated(measurements).problems == ()


def test_a_fresh_edge_is_predicted_by_laws_with_its_share(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "cuts.csv"
    path.write_text(forces(0.5, (0.0, 0.1, 0.2, 0.3)))
    made = str(tmp_path / "made.toml")
    assert main(["calibrate", str(path), "--out", made]) == 0
    capsys.readouterr()
    settings = ["--cutting-speed", "190", "--feed", "0.25", "--depth", "1.5", "--wear", "0"]
    assert main(["whatif", made, *settings, "--json"]) == 0
    (cut,) = json.loads(capsys.readouterr().out)
    assert cut["time"] == 0.0
    assert cut["thrust_force"] == pytest.approx(900 * 0.25**0.6 * 1.5, rel=0.03)
    assert cut["thrust_force_low"] < cut["thrust_force"] < cut["thrust_force_high"]
    assert not cut["extrapolated"]
    assert main(["whatif", "rough_turning", *settings]) == 2
    assert "says nothing of a fresh edge" in capsys.readouterr().err


def test_the_growth_stays_within_its_range_where_a_power_of_the_wear_is_true() -> None:
    steep = sheet(lambda wear: wear**1.5)
    fitted = fit("thrust_force", steep, with_growth(BASE.material.thrust_force, 1.0))
    assert fitted.law.wear_growth == pytest.approx(MAX_GROWTH)
    assert fitted.law.wear_growth <= MAX_GROWTH
