"""The page in a browser: what it does on clicks and keys, how it looks on narrow and dark screens, whom it trusts."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Browser, FloatRect, Locator, Page, expect

from leaderboard import page
from leaderboard.ranking import Leaderboard
from leaderboard.result import Task
from leaderboard.standings import rank
from leaderboard.trajectories import Trajectories, record
from tests.leaderboard.conftest import ENV_ID, MakeResult, spec
from tests.walking import MAX
from turning_env.scoring.policy import PolicySpec

HOSTILE = "</script><img src=x onerror=\"document.title='owned'\">'&amp;"
GRID_SEARCH_COLOUR = "rgb(230, 159, 0)"
BACKWARDS, LONG = "\u202eexe.gpj \u05d0\u05d1", "long" * 125

pytestmark = pytest.mark.slow

Open = Callable[..., Page]


def renamed(policy: PolicySpec, name: str) -> PolicySpec:
    """Called and described as no file would let it."""
    return policy.model_construct(**(dict(policy) | {"name": name, "description": name, "parameters": {name: name}}))


@pytest.fixture(scope="module")
def leaderboard(task: Task, make_result: MakeResult) -> Leaderboard:
    """Hostile rules, an infeasible agent, an oracle, and the published controller, some of them recorded."""
    results = [
        make_result("grid_search", **{"return": [1.0, 2.0, 3.0, 5.0]}),
        make_result("fixed_tuned", **{"return": [0.0, 1.0, 2.0, 3.0]}),
        make_result("oracle", policy=spec("oracle", kind="oracle"), **{"return": 9.0}),
        *(make_result("ppo", seed, severe_overload_time=30.0, **{"return": 2.0 * seed}) for seed in (0, 1)),
    ]
    for place, name in enumerate((HOSTILE, BACKWARDS, LONG)):
        plain = make_result("plain", **{"return": [-1.0, -2.0, -3.0, -4.0 - place]})
        results.append(plain.model_copy(update={"policy": renamed(plain.policy, name)}))
    recorded = {HOSTILE: (7, 8), "grid_search": (7, 8), BACKWARDS: (8,)}
    episodes = [
        record(spec("plain", (0.1, 0.1)), task.scenario, seed).model_copy(update={"policy": result.policy})
        for result in results
        for seed in recorded.get(result.policy.name, ())
    ]
    trajectories = Trajectories(task=task.digest, episodes=[]).model_copy(update={"episodes": episodes})
    return Leaderboard(task, results, rank(results), trajectories, [])


@pytest.fixture(scope="module")
def file(leaderboard: Leaderboard, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of two leaderboards."""
    path = tmp_path_factory.mktemp("page") / "index.html"
    scenario = leaderboard.task.scenario.model_copy(update={"name": "other"})
    path.write_text(
        page.render([leaderboard, replace(leaderboard, task=leaderboard.task.model_copy(update={"scenario": scenario}))]), "utf-8"
    )
    return path


@pytest.fixture
def opened(browser: Browser, file: Path) -> Iterator[Open]:
    """Opens a page; at the end it must have said nothing and asked for nothing."""
    contexts, heard = [], []

    def go(at: str = file.as_uri(), width: int = 1280, height: int = 844, **settings: object) -> Page:
        context = browser.new_context(viewport={"width": width, "height": height}, **settings)  # type: ignore[arg-type]
        context.set_default_timeout(1000 * MAX)
        contexts.append(context)
        shown = context.new_page()
        shown.on("console", lambda message: heard.append(message.text))
        shown.on("pageerror", lambda error: heard.append(str(error)))
        shown.on("request", lambda request: None if request.url.startswith(file.as_uri()) else heard.append(request.url))
        shown.goto(at)
        return shown

    yield go
    for context in contexts:
        context.close()
    assert heard == []


def names(shown: Page) -> list[str]:
    """The policies that are to be seen, in their order."""
    return shown.locator("section:visible .open:visible bdi").all_inner_texts()


def row(shown: Page, name: str) -> Locator:
    """The button that opens a policy's row."""
    return shown.locator("section:visible .open").filter(has_text=re.compile(f"^{re.escape(name)}$"))


def box_of(found: Locator) -> FloatRect:
    """Return the position of an element on the screen."""
    box = found.bounding_box()
    assert box is not None
    return box


def width_beyond(shown: Page) -> int:
    """Return the page's width beyond the screen [pixels]."""
    return int(shown.evaluate("document.documentElement.scrollWidth - innerWidth"))


def test_one_leaderboard_is_shown_at_a_time(opened: Open) -> None:
    shown = opened()
    expect(shown.get_by_role("heading", level=2)).to_have_text([f"{ENV_ID}: rough_turning"])
    shown.get_by_role("link", name="other").click()
    expect(shown.get_by_role("heading", level=2)).to_have_text([f"{ENV_ID}: other"])
    expect(shown.locator("nav [aria-current]")).to_have_text(["other"])
    shown.go_back()
    expect(shown.get_by_role("heading", level=2)).to_have_text([f"{ENV_ID}: rough_turning"])


def test_a_link_opens_its_policy(opened: Open, file: Path) -> None:
    shown = opened()
    row(shown, HOSTILE).click()
    link = shown.url
    assert shown.get_by_role("link", name="Link to this policy").evaluate("link => link.href") == link
    row(shown, HOSTILE).click()
    assert shown.url == f"{file.as_uri()}#{ENV_ID}/rough_turning"
    again = opened(at=link)
    expect(row(again, HOSTILE)).to_be_in_viewport()
    expect(again.locator(".inner:visible .panels svg").first).to_be_visible()


def test_filters_leave_what_is_asked_for(opened: Open) -> None:
    shown = opened()
    shown.get_by_label("feasible only").check()
    assert "ppo" not in names(shown)
    shown.get_by_label("rules").uncheck()
    assert names(shown) == ["oracle"]
    expect(shown.locator("section:visible .count")).to_have_text("1 of 7 policies shown")
    shown.get_by_label("rules").check()
    shown.get_by_label("Policy").first.fill("GRID")
    assert names(shown) == ["grid_search"]
    shown.get_by_label("Policy").first.fill("nobody")
    expect(shown.locator("section:visible .nothing")).to_be_visible()
    expect(shown.get_by_role("columnheader", name="over fixed [s]")).to_be_hidden()
    shown.get_by_label("compared on the same seeds").check()
    expect(shown.get_by_role("columnheader", name="over fixed [s]")).to_be_visible()


def test_a_row_opens_and_a_second_policy_lies_over_it(opened: Open) -> None:
    shown = opened()
    button = row(shown, HOSTILE)
    button.click()
    expect(button).to_have_attribute("aria-expanded", "true")
    inner = shown.locator(".inner:visible")
    titles = ["cutting speed [m/min]", "feed [mm/rev]", "thrust force [N]", "power [kW]", "flank wear [mm]"]
    expect(inner.locator("figcaption")).to_have_text(titles)
    assert inner.locator(".panels .limit").count() == 3
    # The published controller lies over it at first.
    expect(inner.get_by_role("combobox", name="Second policy")).to_have_value("0")
    assert inner.locator(".panels .second").count() == 5
    colour = "path => getComputedStyle(path).stroke"
    assert inner.locator(".panels .second").first.evaluate(colour) == GRID_SEARCH_COLOUR
    # Where the pointer is, every panel tells the values of both.
    inner.locator(".panels svg").nth(1).hover(position={"x": 150, "y": 60})
    expect(inner.locator(".pointer[visibility=visible]")).to_have_count(5)
    expect(inner.locator(".readout").first).to_have_text(re.compile(r"^at 0\.\d+:.* \d.*grid_search \d"))
    inner.get_by_role("combobox", name="Second policy").select_option(label="none")
    assert inner.locator(".panels .second").count() == 0
    assert inner.locator(".panels .first").count() == 5
    inner.get_by_role("combobox", name="Second policy").select_option(label=f"\u2068{BACKWARDS}\u2069")
    expect(inner.locator(".note")).to_contain_text("second policy was not recorded")
    inner.get_by_role("combobox", name="Seed").select_option(label="8")
    assert inner.locator(".panels .second").count() == 5
    inner.get_by_role("combobox", name="Along").select_option(label="path [mm]")
    expect(inner.locator(".panels svg text").last).to_have_text("path [mm]")


@pytest.mark.parametrize("width", [360, 1280])
def test_the_page_is_no_wider_than_the_screen(opened: Open, width: int) -> None:
    shown = opened(width=width)
    assert box_of(row(shown, LONG))["height"] < 30
    assert width_beyond(shown) == 0
    value = shown.locator("section:visible .policy").first.locator("td.g0").first
    number = box_of(value)  # the best policy's return, to be seen at once
    assert number["x"] + number["width"] <= width
    assert number["y"] + number["height"] < 844
    row(shown, HOSTILE).click()
    expect(shown.locator(".panels svg").first).to_be_visible()
    assert width_beyond(shown) == 0
