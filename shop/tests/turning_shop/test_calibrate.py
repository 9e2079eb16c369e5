"""``python -m turning_shop calibrate`` writes a scenario, or refuses the measurements."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from turning_shop.__main__ import main
from turning_shop.fit import TYPICAL_EDGE_SPREAD
from turning_shop.provenance import load
from turning_shop.start import job_of, toml_of
from turning_shop.start_question import Question, Stock
from turning_shop.whatif import NO_LIMIT

from tests.soundness.acting import tried
from turning_env import Scenario

EXAMPLE = str(Path(__file__).parents[2] / "examples" / "cuts.csv")


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def calibrate(*options: str, measurements: str = EXAMPLE) -> int:
    return main(["calibrate", measurements, "--out", "my_tool.toml", *options])


MACHINE = """
base = "paper"
name = "old"
[limits]
power = 11.0
[material.power]
feed = 0.9
[material.wear]
feed = 0.9
"""


def test_values_of_a_base_file_are_kept() -> None:
    Path("machine.toml").write_text(MACHINE)
    rows = [f"100,0.3,2.5,{time},{0.1 * time**0.3}" for time in (1, 2, 4, 8)]
    Path("wear.csv").write_text("\n".join(["cutting_speed,feed,depth_of_cut,time,wear", *rows]))
    assert calibrate("--base", "machine.toml", measurements="wear.csv") == 0
    made = Scenario.load("my_tool.toml")
    base = Scenario.load("machine.toml")
    assert made.material.wear.time == pytest.approx(0.3)
    assert made.material.wear.feed == 0.9  # never varies
    assert made.material.power == base.material.power
    assert made.limits.power == 11.0
    # No file states this limit, and its law was not measured.
    assert made.limits.thrust_force == NO_LIMIT["thrust_force"]
    # One edge does not tell how edges differ, and no file states it.
    assert made.tool.wear_factor_spread == TYPICAL_EDGE_SPREAD["wear"]
    changes = {
        "material": base.material,
        "name": "old",
        "limits": base.limits,
        "tool": base.tool,
    }
    assert made.model_copy(update=changes) == base
    comment = "# The law of power is the base's: there is no column power"
    assert comment in Path("my_tool.toml").read_text()


ONE_EDGE = "cutting_speed,feed,depth_of_cut,time,wear\n" + "\n".join(
    f"100,0.3,2.5,{time},{0.1 * time**0.5:.6f}" for time in range(1, 9)
)


@pytest.mark.parametrize(("stated", "spread"), [("", 0.34), ("wear_factor_spread = 0.1", 0.1)])
def test_one_edge_tells_the_usual_wear_no_better_than_edges_differ(
    stated: str, spread: float
) -> None:
    Path("wear.csv").write_text(ONE_EDGE)
    Path("base.toml").write_text(f"[tool]\nwear_criterion = 0.4\n{stated}")
    assert calibrate("--base", "base.toml", measurements="wear.csv") == 0
    scenario, evidence = load("my_tool.toml")
    cut = {"cutting_speed": 100.0, "feed": 0.3, "depth_of_cut": 2.5, "time": 4.0, "hardness": 1.0}
    factors = {name: np.array(value) for name, value in cut.items()}
    law = evidence.laws["wear"]
    # The rows have no scatter, so only the edge's own deviation is left: Student's t is 2.571.
    of_law = law.quantile * law.log_deviation(scenario.material.wear, factors, of_reading=False)
    of_reading = law.quantile * law.log_deviation(scenario.material.wear, factors)
    assert of_law == pytest.approx(2.571 * spread, rel=0.01)
    # Another edge deviates as well.
    assert of_reading == pytest.approx(2.571 * spread * math.sqrt(2.0), rel=0.01)


def test_spread_of_edges_is_written() -> None:
    lines = ["cutting_speed,feed,depth_of_cut,time,wear,edge"]
    for edge, factor in enumerate((0.9, 1.0, 1.1, 1.05, 0.95)):
        for time in (1, 3, 9):
            wear = 0.1 * factor * time**0.25
            lines.append(f"100,0.3,2.5,{time},{wear:.4f},E{edge}")
    Path("wear.csv").write_text("\n".join(lines))
    Path("base.toml").write_text("[tool]\nwear_criterion = 0.4\n")
    assert calibrate("--base", "base.toml", measurements="wear.csv") == 0
    made = Scenario.load("my_tool.toml")
    # The standard deviation of the factors' logarithms.
    assert made.tool.wear_factor_spread == pytest.approx(0.079, abs=0.001)
    assert made.tool.wear_criterion == 0.4


@pytest.mark.parametrize(("factor", "is_named"), [(1.0, False), (1000.0 / (100.0 * math.pi), True)])
def test_a_power_beyond_the_catalogue_of_the_base_asks_for_the_unit(
    factor: float, is_named: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    stock = Stock(diameter=80.0, length=200.0)
    job = job_of(Question("42CrMo4", "CNMG120408-PM", "P25", stock=stock, depth=2.0))
    Path("start.toml").write_text(toml_of(job, Path("start.toml")))
    header, *lines = Path(EXAMPLE).read_text("utf-8").splitlines()
    rows = [header]
    for line in lines:
        speed, others = line.split(",", 1)
        rows.append(f"{factor * float(speed)},{others}")
    Path("cuts.csv").write_text("\n".join(rows))
    assert calibrate("--base", "start.toml", measurements="cuts.csv") == 0
    assert ("is cutting_speed in rev/min" in capsys.readouterr().err) == is_named


@pytest.mark.slow
def test_a_file_is_not_based_on_itself() -> None:
    assert calibrate() == 0
    assert calibrate("--base", "my_tool.toml", "--overwrite") == 2


@pytest.mark.parametrize("speeds", [(220, 220, 220), (219, 220, 221)])
def test_a_sheet_that_cannot_tell_the_exponent_of_speed_gets_the_catalogues(
    speeds: tuple[float, ...],
) -> None:
    def true_wear(feed: float, time: float) -> float:
        return 0.06 * feed**0.5 * time**0.5

    scatter = itertools.cycle((1.05, 0.97, 1.02, 0.96))
    rows = ["cutting_speed,feed,depth_of_cut,time,wear"]
    for feed, speed, time in itertools.product((0.2, 0.3, 0.4), speeds, (5, 10, 20)):
        wear = true_wear(feed, time) * next(scatter)
        rows.append(f"{speed},{feed},2,{time},{wear:.5f}")
    Path("wear.csv").write_text("\n".join(rows))
    assert calibrate(measurements="wear.csv") == 0
    law = Scenario.load("my_tool.toml").material.wear
    assert law.time / law.cutting_speed == pytest.approx(0.25, rel=0.02)
    assert law(
        220,
        0.3,
        2,
        time=10,
    ) == pytest.approx(true_wear(0.3, 10), rel=0.03)
    assert "Taylor's n is 0.25" in Path("my_tool.toml").read_text()


NAMES = "cutting_speed,feed,depth_of_cut,time,wear,thrust_force,power,hardness,edge"
CELLS = st.sampled_from(["", "0.999", "1", "1.0001", "2", "4"])
ROWS = st.lists(CELLS, min_size=9, max_size=9).map(",".join)
OVERFLOWING = [
    "0.999,1,4,0.999,2,,,,",
    "0.999,2,1,4,1,,,4,",
    "2,2,0.999,0.999,2,,,4,",
    "4,0.999,4,0.999,0.999,,,,",
    "4,2,0.999,0.999,0.999,,,4,",
]
"""Wears whose law, by least squares, has a coefficient beyond the largest float."""


@pytest.mark.slow
@tried(25, 1000)
@example(table=OVERFLOWING)
@given(table=st.lists(ROWS, max_size=12))
def test_poor_rows_give_a_scenario_or_an_error(
    table: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    Path("cuts.csv").write_text("\n".join([NAMES, *table]))
    Path("my_tool.toml").unlink(missing_ok=True)
    if calibrate("--force", measurements="cuts.csv") == 0:
        assert load("my_tool.toml")[1].laws
    else:
        assert capsys.readouterr().err.splitlines()[-1].startswith("error: ")
        assert not Path("my_tool.toml").exists()
