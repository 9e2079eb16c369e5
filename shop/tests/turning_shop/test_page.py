"""The page of ``advise --page`` in a browser.

Its numbers are Python's, it asks for nothing, and it fits phones.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from playwright.sync_api import Page, expect
from turning_shop.__main__ import main
from turning_shop.advise import advise, plan
from turning_shop.page import render
from turning_shop.provenance import load
from turning_shop.units import INCH
from turning_shop.whatif import what_if

from shop.tests.turning_shop.sheets import forces
from tests.walking import ROOT
from turning_env import Scenario

pytestmark = pytest.mark.slow

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
SETTINGS: dict[str, dict[str, float]] = {
    "slow": {
        "cutting_speed": 61.3,
        "feed": 0.55,
        "wear": 0.11,
        "hardness": 1.22,
        "edges_per_insert": 8,
    },
    "fast": {
        "cutting_speed": 187.0,
        "feed": 0.2,
        "depth_of_cut": 1.3,
        "machine_rate": 95.5,
        "edge_change_time": 0.7,
    },
    "deep": {
        "cutting_speed": 90.0,
        "depth_of_cut": 4.7,
        "hardness": 0.8,
        "wear": 0.3,
        "operator_rate": 0,
        "insert_price": 21,
    },
}
CUT_VALUES = (
    "thrust_force",
    "thrust_force_share",
    "power",
    "power_share",
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
    """The numbers that belong to settings."""

    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    extrapolated: bool


def of_python(scenario: Scenario, settings: dict[str, float]) -> Results:
    """Return the results of settings of the page, by Python."""
    _, evidence = load(scenario.file or "rough_turning")
    values = scenario.model_dump()
    for name in values["economics"]:
        if name in settings:
            values["economics"][name] = settings[name]
    values["workpiece"]["depth_of_cut"] = settings["depth_of_cut"]
    planned = plan(
        Scenario.model_validate(values),
        evidence,
        cutting_speed=settings["cutting_speed"],
        feed=settings["feed"],
        wear=settings["wear"],
        hardness=settings["hardness"],
    )
    numbers = {name: float(getattr(planned.cuts, name)) for name in CUT_VALUES}
    for name in PLAN_VALUES:
        numbers[name] = float(getattr(planned, name))
    prediction = planned.prediction
    intervals = {"cost": (float(planned.cost_low), float(planned.cost_high))}
    for name in ("thrust_force", "power", "tool_life"):
        intervals[name] = (float(prediction.low[name]), float(prediction.high[name]))
    return Results(numbers, intervals, extrapolated=bool(prediction.extrapolated))


@pytest.mark.parametrize("name", SETTINGS)
def test_the_numbers_are_those_of_python(name: str, scenario: Scenario, show: Show) -> None:
    compare_with_python(name, scenario, show(scenario))


def test_laws_with_a_fresh_edges_share_are_those_of_python(growing: Scenario, show: Show) -> None:
    compare_with_python("slow", growing, show(growing))


def compare_with_python(name: str, scenario: Scenario, page: Page) -> None:
    """Set the sliders of a page, and compare its numbers with those of Python."""
    for setting, value in SETTINGS[name].items():
        page.locator(f"#{setting}").fill(str(value))
    settings = page.evaluate("settings")
    results = page.evaluate("results(settings)")
    expected = of_python(scenario, settings)
    assert settings.items() >= SETTINGS[name].items()
    values = {value: results["values"][value] for value in expected.values}
    assert values == pytest.approx(expected.values, rel=1e-6)
    assert set(results["intervals"]) == set(expected.intervals)
    for value, ends in expected.intervals.items():
        assert results["intervals"][value] == pytest.approx(ends, rel=1e-6), value
    assert results["extrapolated"] == expected.extrapolated
    status = page.get_by_role("status").inner_text()
    assert status.endswith("not measured there") == expected.extrapolated
    for value in ("thrust_force", "tool_life", "cost"):
        shown = page.evaluate("name => shown(results(settings).values[name])", value)
        expect(page.locator(f"[data-name={value}]")).to_contain_text(shown)


def test_the_page_begins_with_the_cheapest_as_advised(scenario: Scenario, show: Show) -> None:
    page = show(scenario)
    advice = advise(*load(scenario.file or ""))
    cheapest = advice[0].plan
    most_metal = advice[-1].plan
    assert page.evaluate("cheapest().cost") == pytest.approx(cheapest.cost, rel=1e-6)
    cost = page.evaluate("results(settings).values.cost")
    assert cost == pytest.approx(cheapest.cost, rel=1e-6)
    page.get_by_role("button", name="most metal").click()
    minutes = page.evaluate("results(settings).values.minutes")
    assert minutes == pytest.approx(most_metal.minutes, rel=1e-6)
    page.get_by_role("button", name="choose it").click()
    assert page.evaluate("settings.feed - cheapest().feed") == 0


def test_warnings_are_shown_and_texts_are_texts(scenario: Scenario, show: Show) -> None:
    page = show(scenario.model_copy(update={"name": "<i>plain</i>"}))
    _, evidence = load(scenario.file or "")
    assert evidence.warnings
    assert page.get_by_role("listitem").all_inner_texts() == list(evidence.warnings)
    expect(page.get_by_role("status")).to_contain_text("</b>$ a part")
    expect(page.get_by_role("heading", level=1)).to_have_text("<i>plain</i>")


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
    page.fill("#cutting_speed", "500")
    page.fill("#feed", "0.012")
    settings = {"cutting_speed": 500 * 0.3048, "feed": 0.012 * 25.4}
    wear = float(page.input_value("#wear")) * 25.4
    depth = float(page.input_value("#depth_of_cut")) * 25.4
    expected = what_if(
        scenario,
        **settings,
        depth_of_cut=depth,
        wear=wear,
    )
    thrust = page.text_content('[data-name="thrust_force"]') or ""
    assert float(thrust.split()[0]) == pytest.approx(expected.thrust_force / 4.448, rel=0.01)
    assert thrust.split()[1].startswith("lbf")
    expect(page.locator("#map")).to_contain_text("feed [IPR]")


def test_without_prices_costs_are_minutes(show: Show) -> None:
    page = show(Scenario())
    expect(page.get_by_role("status")).to_contain_text("min a part")
    expect(page.locator(".warnings")).to_contain_text("not measured on your machine")
    page.locator("#insert_price").fill("12")
    expect(page.get_by_role("status")).to_contain_text("set an hourly rate")
    expect(page.locator("[data-name=cost]")).to_have_count(0)


def test_the_page_fits_phones(scenario: Scenario, show: Show) -> None:
    page = show(scenario, width=360)
    expect(page.locator("#map path")).not_to_have_count(0)
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") == 0
