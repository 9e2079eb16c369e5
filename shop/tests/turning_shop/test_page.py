"""The page of ``advise --page`` in a browser: its numbers are Python's, it asks for nothing, and it fits phones."""

from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from turning_shop.advise import advise, plan
from turning_shop.page import render
from turning_shop.provenance import load

from tests.walking import ROOT
from turning_env import Scenario
from turning_env.__main__ import main

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
SETTINGS: list[dict[str, float]] = [
    {"cutting_speed": 61.3, "feed": 0.55, "wear": 0.11, "hardness": 1.22, "edges_per_insert": 8},
    {
        "cutting_speed": 187.0,
        "feed": 0.2,
        "depth_of_cut": 1.3,
        "machine_rate": 95.5,
        "edge_change_time": 0.7,
    },
    {
        "cutting_speed": 90.0,
        "depth_of_cut": 4.7,
        "hardness": 0.8,
        "wear": 0.3,
        "operator_rate": 0,
        "insert_price": 21,
    },
]


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> Scenario:
    """Fitted, with warnings, an idling spindle that is weak at low speed, and prices in a hostile currency."""
    folder = tmp_path_factory.mktemp("tool")
    (folder / "machine.toml").write_text(MACHINE)
    sheet = str(ROOT / "shop" / "examples" / "cuts.csv")
    assert (
        main(
            [
                "calibrate",
                sheet,
                "--base",
                str(folder / "machine.toml"),
                "--out",
                str(folder / "tool.toml"),
            ]
        )
        == 0
    )
    return load(folder / "tool.toml")[0]


@pytest.fixture
def show(opened: Callable[..., Page], tmp_path: Path) -> Show:
    def show(scenario: Scenario, width: int = 1280) -> Page:
        evidence, path = load(scenario.file or "rough_turning")[1], tmp_path / "page.html"
        path.write_text(render(scenario, evidence, advise(scenario, evidence)), "utf-8")
        return opened(path.as_uri(), width)

    return show


def of_python(
    scenario: Scenario, at: dict[str, float]
) -> tuple[dict[str, float], dict[str, tuple[float, float]], bool]:
    """Return the values, intervals and mark of extrapolation that belong to settings of the page."""
    values = scenario.model_dump()
    values["economics"] |= {name: at[name] for name in values["economics"] if name in at}
    values["workpiece"]["depth_of_cut"] = at["depth_of_cut"]
    evidence, scenario = load(scenario.file or "rough_turning")[1], Scenario.model_validate(values)
    found = plan(scenario, evidence, at["cutting_speed"], at["feed"], at["wear"], at["hardness"])
    names = (
        "thrust_force",
        "thrust_force_share",
        "power",
        "power_share",
        "tool_life",
        "removal_rate",
        "spindle_speed",
    )
    numbers = {name: float(getattr(found.cuts, name)) for name in names}
    numbers |= {
        name: float(getattr(found, name))
        for name in ("parts", "minutes", "cycle_time", "mean_removal_rate", "cost")
    }
    known = found.prediction
    intervals = {
        name: (float(known.low[name]), float(known.high[name]))
        for name in ("thrust_force", "power", "tool_life")
    }
    intervals["cost"] = float(found.cost_low), float(found.cost_high)
    return numbers, intervals, bool(known.extrapolated)


@pytest.mark.parametrize("settings", SETTINGS)
def test_the_numbers_are_those_of_python(
    settings: dict[str, float], scenario: Scenario, show: Show
) -> None:
    page = show(scenario)
    for name, value in settings.items():
        page.locator(f"#{name}").fill(str(value))
    at, found = page.evaluate("settings"), page.evaluate("results(settings)")
    assert at.items() >= settings.items()
    values, intervals, extrapolated = of_python(scenario, at)
    assert {name: found["values"][name] for name in values} == pytest.approx(values, rel=1e-6)
    assert set(found["intervals"]) == set(intervals)
    for name, ends in intervals.items():
        assert found["intervals"][name] == pytest.approx(ends, rel=1e-6), name
    assert found["extrapolated"] == extrapolated
    assert page.get_by_role("status").inner_text().endswith("not measured there") == extrapolated
    for name in ("thrust_force", "tool_life", "cost"):
        shown = page.evaluate("name => shown(results(settings).values[name])", name)
        expect(page.locator(f"[data-name={name}]")).to_contain_text(shown)


def test_it_begins_with_the_cheapest_as_advised(scenario: Scenario, show: Show) -> None:
    page = show(scenario)
    least, *_, metal = (each.plan for each in advise(*load(scenario.file or "")))
    assert page.evaluate("cheapest().cost") == pytest.approx(least.cost, rel=1e-6)
    assert page.evaluate("results(settings).values.cost") == pytest.approx(least.cost, rel=1e-6)
    page.get_by_role("button", name="most metal").click()
    assert page.evaluate("results(settings).values.minutes") == pytest.approx(
        metal.minutes, rel=1e-6
    )
    page.get_by_role("button", name="choose it").click()
    assert page.evaluate("settings.feed - cheapest().feed") == 0


def test_warnings_are_shown_and_texts_are_texts(scenario: Scenario, show: Show) -> None:
    page = show(scenario.model_copy(update={"name": "<i>plain</i>"}))
    assert (
        page.get_by_role("listitem").all_inner_texts()
        == list(load(scenario.file or "")[1].warnings)
        != []
    )
    expect(page.get_by_role("status")).to_contain_text("</b>$ a part")
    expect(page.get_by_role("heading", level=1)).to_have_text("<i>plain</i>")


def test_without_prices_costs_are_minutes(show: Show) -> None:
    page = show(Scenario())
    expect(page.get_by_role("status")).to_contain_text("min a part")
    expect(page.locator(".warnings")).to_contain_text("not measured on your machine")
    page.locator("#insert_price").fill("12")
    expect(page.get_by_role("status")).to_contain_text("set an hourly rate")
    expect(page.locator("[data-name=cost]")).to_have_count(0)


def test_it_fits_phones(scenario: Scenario, show: Show) -> None:
    page = show(scenario, width=360)
    expect(page.locator("#map path")).not_to_have_count(0)
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") == 0
