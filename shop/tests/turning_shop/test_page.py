"""The page of ``advise --page``: its numbers are Python's, it asks for nothing, it fits phones.

Tests of the data that are put into the page need no browser.
"""

import math
from base64 import b64decode
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from playwright.sync_api import Page, expect
from turning_shop.__main__ import main
from turning_shop.advise import advise, plan
from turning_shop.page import page_data, render
from turning_shop.prediction import longest_life
from turning_shop.provenance import load
from turning_shop.units import INCH
from turning_shop.whatif import what_if

from shop.tests.turning_shop.sheets import forces
from tests.walking import ROOT
from turning_env import Scenario

Show = Callable[..., Page]
MACHINE = """
base = "rough_turning"
[limits]
power = 5.5
thrust_force = 1500.0
[spindle]
base_speed = 400.0
idle_torque = 3.0
[economics]
currency = "</b>$"
machine_rate = 60.0
operator_rate = 25.0
insert_price = 12.0
"""
# Steps of the sliders: cutting speed, feed, depth of cut, wear and hardness.
SLIDERS = ("cutting_speed", "feed", "depth_of_cut", "wear", "hardness")
STEPS = {"low": (0, 0, 0, 0, 0), "mixed": (3, 5, 1, 2, 2), "high": (-1, -1, -1, -1, -1)}
CUT_VALUES = (
    "thrust_force",
    "power",
    "tool_life",
    "removal_rate",
    "spindle_speed",
)
PLAN_VALUES = ("parts", "minutes", "cycle_time", "mean_removal_rate", "cost")


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    """Return a fitted scenario with warnings, and with prices in a hostile currency.

    Its spindle idles, and is weak at low speed.
    """
    folder = tmp_path_factory.mktemp("tool")
    base = folder / "machine.toml"
    base.write_text(MACHINE)
    sheet = str(ROOT / "shop" / "examples" / "cuts.csv")
    out = folder / "tool.toml"
    assert main(["calibrate", sheet, "--base", str(base), "--out", str(out)]) == 0
    scenario, _ = load(out)
    return scenario


@pytest.fixture(scope="module")
def growing(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    """Return the scenario with laws of force and power that have a fresh edge's share."""
    folder = tmp_path_factory.mktemp("growing")
    sheet = folder / "forces.csv"
    sheet.write_text(forces(0.5, (0.0, 0.1, 0.2, 0.3)))
    out = folder / "tool.toml"
    assert main(["calibrate", str(sheet), "--base", str(scenario.file), "--out", str(out)]) == 0
    scenario, _ = load(out)
    assert scenario.material.power.wear_growth > 0.0
    return scenario


@pytest.fixture
def show(opened: Callable[..., Page], tmp_path: Path) -> Show:
    """Return a function that opens the page of a scenario."""

    def show(scenario: Scenario, width: int = 1280) -> Page:
        _, evidence = load(scenario.file or "rough_turning")
        path = tmp_path / "page.html"
        path.write_text(render(scenario, evidence, advise(scenario, evidence)), "utf-8")
        return opened(path.as_uri(), width)

    return show


class Results(NamedTuple):
    """The numbers that belong to the steps of the sliders."""

    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    extrapolated: bool


def of_python(scenario: Scenario, data: dict[str, Any], steps: Sequence[int]) -> Results:
    """Return the results at steps of the page, by a plan of Python."""
    _, evidence = load(scenario.file or "rough_turning")
    at = {}
    for axis, step in zip(data["axes"], steps, strict=True):
        at[axis["name"]] = axis["values"][step]
    values = scenario.model_dump()
    values["workpiece"]["depth_of_cut"] = at.pop("depth_of_cut")
    planned = plan(Scenario.model_validate(values), evidence, **at)
    numbers = {name: float(getattr(planned.cuts, name)) for name in CUT_VALUES}
    if numbers["tool_life"] > longest_life(evidence):
        numbers["tool_life"] = math.inf  # not limited by wear
    for name in PLAN_VALUES:
        numbers[name] = float(getattr(planned, name))
    prediction = planned.prediction
    intervals = {"cost": (float(planned.cost_low), float(planned.cost_high))}
    for name in ("thrust_force", "power", "tool_life"):
        intervals[name] = (float(prediction.low[name]), float(prediction.high[name]))
    return Results(numbers, intervals, extrapolated=bool(prediction.extrapolated))


def of_page(data: dict[str, Any], steps: Sequence[int]) -> Results:
    """Return the results at steps of the page, looked up in the data that are put into it."""
    table = data["table"]

    def look(name: str) -> float:
        shape = table[name]["shape"]
        numbers = np.frombuffer(b64decode(table[name]["numbers"]), "<f4").reshape(shape)
        index = tuple(0 if length == 1 else step for length, step in zip(shape, steps, strict=True))
        return float(numbers[index])

    values = {name: look(name) for name in (*CUT_VALUES, *PLAN_VALUES)}
    intervals = {"cost": (look("cost_low"), look("cost_high"))}
    for name in ("thrust_force", "power", "tool_life"):
        factor = look(f"{name}_factor")
        intervals[name] = (values[name] / factor, values[name] * factor)
    return Results(values, intervals, extrapolated=bool(look("extrapolated")))


@pytest.fixture(scope="module")
def data(scenario: Scenario) -> dict[str, Any]:
    """Return the data that are put into the scenario's page."""
    _, evidence = load(scenario.file or "")
    return page_data(scenario, evidence, advise(scenario, evidence))


@pytest.mark.parametrize("steps", STEPS.values(), ids=STEPS)
def test_the_table_is_that_of_python(
    steps: tuple[int, ...], scenario: Scenario, data: dict[str, Any]
) -> None:
    compare(of_page(data, steps), of_python(scenario, data, steps))


@pytest.mark.slow
def test_the_table_of_laws_with_a_fresh_edges_share_is_that_of_python(growing: Scenario) -> None:
    _, evidence = load(growing.file or "")
    data = page_data(growing, evidence, advise(growing, evidence))
    steps = STEPS["mixed"]
    compare(of_page(data, steps), of_python(growing, data, steps))


def compare(found: Results, expected: Results) -> None:
    """Compare two results; the page holds numbers of 32 bits."""
    assert found.values == pytest.approx(expected.values, rel=1e-6)
    for name, ends in expected.intervals.items():
        if math.isfinite(expected.values[name]):
            assert found.intervals[name] == pytest.approx(ends, rel=1e-5), name
    assert found.extrapolated == expected.extrapolated


@pytest.mark.slow
@pytest.mark.parametrize("name", ["low", "mixed"])
def test_the_browser_shows_the_numbers_of_python(
    name: str, scenario: Scenario, data: dict[str, Any], show: Show
) -> None:
    page = show(scenario)
    steps = STEPS[name]
    for slider, step in zip(SLIDERS, steps, strict=True):
        page.locator(f"#{slider}").fill(str(step))
    expected = of_python(scenario, data, steps)
    for value, number in expected.values.items():
        assert page.evaluate("name => look(name, at)", value) == pytest.approx(number, rel=1e-6)
        if not math.isfinite(number):
            continue
        text = page.evaluate("shown", number) if value != "cost" else f"{number:.2f}"
        expect(page.locator(f"[data-name={value}]")).to_contain_text(text)
    status = page.get_by_role("status").inner_text()
    assert status.endswith("not measured there") == expected.extrapolated


@pytest.mark.slow
def test_the_page_begins_with_the_cheapest_as_advised(scenario: Scenario, show: Show) -> None:
    page = show(scenario)
    advice = advise(*load(scenario.file or ""))
    cheapest = advice[0].plan
    most_metal = advice[-1].plan
    assert page.evaluate("look('cost', at)") == pytest.approx(cheapest.cost, rel=1e-6)
    page.get_by_role("button", name="most metal").click()
    assert page.evaluate("look('minutes', at)") == pytest.approx(most_metal.minutes, rel=1e-6)
    page.get_by_role("button", name="choose it").click()
    assert page.evaluate("at[1] - cheapest()[1]") == 0


def test_the_page_begins_at_a_cut_that_is_advised(data: dict[str, Any]) -> None:
    first = data["advice"][0]["at"]
    found = of_page(data, first)
    for axis, step in zip(data["axes"], first, strict=True):
        assert 0 <= step < len(axis["values"])
    others = [of_page(data, entry["at"]).values["cost"] for entry in data["advice"]]
    assert found.values["cost"] == min(others)


@pytest.mark.slow
def test_warnings_are_shown_and_texts_are_texts(scenario: Scenario, show: Show) -> None:
    page = show(scenario.model_copy(update={"name": "<i>plain</i>"}))
    _, evidence = load(scenario.file or "")
    assert evidence.warnings
    assert page.get_by_role("listitem").all_inner_texts() == list(evidence.warnings)
    expect(page.get_by_role("status")).to_contain_text("</b>$ a part")
    expect(page.get_by_role("heading", level=1)).to_have_text("<i>plain</i>")


@pytest.mark.slow
def test_the_page_shows_inches(
    scenario: Scenario, opened: Callable[..., Page], tmp_path: Path
) -> None:
    _, evidence = load(scenario.file or "rough_turning")
    path = tmp_path / "page.html"
    path.write_text(
        render(
            scenario,
            evidence,
            advise(scenario, evidence),
            units=INCH,
        ),
        "utf-8",
    )
    page = opened(path.as_uri(), 1280)
    speed, feed, depth, wear, _ = page.evaluate("data.axes.map((axis, i) => axis.values[at[i]])")
    expected = what_if(scenario, speed, feed, depth_of_cut=depth, wear=wear)
    thrust = page.text_content('[data-name="thrust_force"]') or ""
    assert float(thrust.split()[0]) == pytest.approx(expected.thrust_force / 4.448, rel=0.01)
    assert thrust.split()[1].startswith("lbf")
    expect(page.locator("#map")).to_contain_text("feed [IPR]")


@pytest.mark.slow
def test_without_prices_costs_are_minutes(show: Show) -> None:
    page = show(Scenario())
    expect(page.get_by_role("status")).to_contain_text("min a part")
    expect(page.locator(".warnings")).to_contain_text("not measured on your machine")


@pytest.mark.slow
def test_the_page_fits_phones(scenario: Scenario, show: Show) -> None:
    page = show(scenario, width=360)
    expect(page.locator("#map path")).not_to_have_count(0)
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") == 0
    # A map without a size is not drawn, and complains of nothing.
    page.evaluate("map.replaceChildren(); map.style.display = 'none'; update()")
    expect(page.locator("#map path")).to_have_count(0)
    page.evaluate("map.style.display = ''")
    expect(page.locator("#map path")).not_to_have_count(0)
