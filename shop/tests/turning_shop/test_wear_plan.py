"""The page of what to measure next: what it promises is what calibrating on such readings gives."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from turning_shop import WorkshopError
from turning_shop.__main__ import main
from turning_shop.advise import PartPlan
from turning_shop.fit import TYPICAL_EDGE_SPREAD
from turning_shop.measurements import Measurements, read_measurements
from turning_shop.start import CatalogueJob, job_of, start_advice
from turning_shop.start_question import Question, Stock
from turning_shop.wear_plan import (
    ENOUGH,
    READING_ERROR,
    Stop,
    enough,
    expected_sheet,
    known_after,
    known_now,
    render,
    stops,
)

QUESTION = Question("42CrMo4", "CNMG120408-PM", "P25", stock=Stock(80.0, 200.0), depth=2.0)
COMMAND = "advise --material 42CrMo4 --tool CNMG120408-PM --grade P25 --stock 80x200 --depth 2"


@pytest.fixture(scope="module")
def job() -> CatalogueJob:
    """Return a job of a catalogue."""
    return job_of(QUESTION)


@pytest.fixture(scope="module")
def best(job: CatalogueJob) -> PartPlan:
    """Return its advised plan."""
    return start_advice(job)[0].plan


def drawn_sheet(
    folder: Path, job: CatalogueJob, best: PartPlan, *, edges: int, rng: np.random.Generator
) -> Measurements:
    """Return a file of readings that were drawn as public data scatter, at the plan's stops."""
    material = job.scenario.material
    speed, feed, depth = (float(value) for value in best.cuts[:3])
    path = folder / "readings.csv"
    with path.open("w", newline="") as file:
        sheet = csv.writer(file)
        sheet.writerow(["edge", "cutting_speed", "feed", "depth_of_cut", "time", "wear", "power"])
        for edge in range(edges):
            level = TYPICAL_EDGE_SPREAD["wear"] * rng.standard_normal()
            load = TYPICAL_EDGE_SPREAD["power"] * rng.standard_normal()
            for stop in stops(job, best):
                wear_error = READING_ERROR["wear"] * rng.standard_normal()
                power_error = READING_ERROR["power"] * rng.standard_normal()
                wear = float(material.wear(speed, feed, depth, time=stop.time))
                wear *= np.exp(level + wear_error)
                power = float(material.power(speed, feed, depth, wear=wear))
                power *= np.exp(load + power_error)
                sheet.writerow([edge, speed, feed, depth, stop.time, wear, power])
    return read_measurements(path)


@pytest.mark.slow
def test_the_plan_promises_what_calibrating_on_such_readings_gives(
    job: CatalogueJob, best: PartPlan, tmp_path: Path
) -> None:
    edges = 8
    promised = known_after(job, best, expected_sheet(job, best, edges))
    rng = np.random.default_rng(edges)
    lives = []
    powers = []
    for _ in range(11):
        sheet = drawn_sheet(tmp_path, job, best, edges=edges, rng=rng)
        known = known_after(job, best, sheet)
        lives.append(known.life.log_width)
        powers.append(known.power.log_width)
    assert promised.life.log_width == pytest.approx(np.median(lives), rel=0.25)
    assert promised.power.log_width == pytest.approx(np.median(powers), rel=0.35)


@pytest.mark.slow
def test_the_width_of_the_life_is_that_of_a_mean_of_edges(
    job: CatalogueJob, best: PartPlan
) -> None:
    promised = known_after(job, best, expected_sheet(job, best, 10))
    # Student's t of 9 degrees is 2.262; wear grows as the square root of time.
    half_width = 2.262 * TYPICAL_EDGE_SPREAD["wear"] / np.sqrt(10.0) / 0.5
    assert promised.life.log_width == pytest.approx(2.0 * half_width, rel=0.02)


def test_more_edges_narrow_more_until_enough(job: CatalogueJob, best: PartPlan) -> None:
    now = known_now(job, best)
    later = [known_after(job, best, expected_sheet(job, best, edges)) for edges in (4, 8, 14)]
    widths = [known.life.log_width for known in later]
    assert widths == sorted(widths, reverse=True)
    assert enough(now, later).edges == 14
    assert later[2].life.log_width <= ENOUGH * now.life.log_width < later[1].life.log_width
    assert enough(now, later[:1]).edges == 4


def test_the_catalogue_is_as_wide_as_the_advice_says(job: CatalogueJob, best: PartPlan) -> None:
    life = known_now(job, best).life
    part_time = best.minutes / best.parts
    # The advice counts whole parts that 97.5 % of edges last.
    assert life.high / life.value == pytest.approx(float(best.parts_high / best.parts), rel=0.06)
    assert life.low / part_time > float(best.parts_low)


def test_stops_are_after_whole_parts_and_reach_the_change(
    job: CatalogueJob, best: PartPlan
) -> None:
    planned = stops(job, best)
    assert [stop.parts % 1.0 for stop in planned] == [0.0] * 4
    wears = [stop.wear for stop in planned]
    assert wears == sorted(set(wears))
    assert wears[-1] == pytest.approx(float(best.cuts.wear), rel=0.05)


def test_one_part_is_a_part() -> None:
    texts = [Stop(time=1.0, parts=parts, wear=0.1).parts_text for parts in (0.5, 1.0, 12.0)]
    assert texts == ["0.5 parts", "1 part", "12 parts"]


@pytest.mark.slow
def test_long_parts_are_stopped_within(best: PartPlan) -> None:
    long = job_of(QUESTION._replace(stock=Stock(300.0, 1500.0)))
    planned = stops(long, start_advice(long)[0].plan)
    assert len({round(stop.time, 6) for stop in planned}) == 4


def test_an_edge_that_wear_does_not_limit_has_no_plan(job: CatalogueJob, best: PartPlan) -> None:
    with pytest.raises(WorkshopError, match="wear does not limit the edge"):
        render(job, best._replace(by_wear=np.asarray(False)))


@pytest.mark.slow
def test_the_command_writes_the_page_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "plan.html"
    assert main([*COMMAND.split(), "--plan", str(page)]) == 0
    assert str(page) in capsys.readouterr().out
    text = page.read_text("utf-8")
    chosen = re.search(r'<tr class="chosen"><td>(\d+) edges', text)
    assert chosen is not None
    boxes = text.partition('class="boxes"')[2]
    assert len(re.findall(r"<tr><th>\d+</th>", boxes)) == int(chosen[1])
    assert "calibrate readings.csv --base start.toml" in text
    assert "<script" not in text
    assert "://" not in text

    assert main([*COMMAND.split(), "--plan", str(page)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert page.read_text("utf-8") == text


def test_a_scenario_with_laws_has_no_plan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "plan.html"
    assert main(["advise", "h13_romi", "--plan", str(page)]) == 2
    assert "it plans a first sheet" in capsys.readouterr().err
    assert not page.exists()
