"""The page in a browser: clicks, narrow screens, and hostile names."""

import re
from collections.abc import Callable

import pytest
from playwright.sync_api import Locator, Page, expect

from baselines.policy_spec import PolicySpec
from leaderboard import page
from leaderboard.ranking import Leaderboard, rank
from leaderboard.result import Task
from leaderboard.trajectories import Trajectories, record
from tests.leaderboard.conftest import ENV_ID, MakeResult, spec

HOSTILE = "</script><img src=x onerror=\"document.title='owned'\">'&amp;"
BACKWARDS = "\u202eexe.gpj \u05d0\u05d1"
LONG = "long" * 125

pytestmark = pytest.mark.slow

Open = Callable[..., Page]


def renamed(policy: PolicySpec, name: str) -> PolicySpec:
    """Return a policy with a name and a description that no file may have."""
    changes = {"name": name, "description": name, "parameters": {name: name}}
    return policy.model_construct(**(dict(policy) | changes))


@pytest.fixture(scope="module")
def leaderboard(task: Task, make_result: MakeResult) -> Leaderboard:
    """Hostile rules, an infeasible agent, an oracle and the published controller."""
    oracle = spec("oracle", kind="oracle")
    results = [
        make_result("grid_search", returns=[1.0, 2.0, 3.0, 5.0]),
        make_result("fixed_tuned", returns=[0.0, 1.0, 2.0, 3.0]),
        make_result("oracle", policy=oracle, returns=9.0),
        make_result("ppo", 0, severe_overload_time=30.0, returns=0.0),
        make_result("ppo", 1, severe_overload_time=30.0, returns=2.0),
    ]
    for place, name in enumerate((HOSTILE, BACKWARDS, LONG)):
        plain = make_result("plain", returns=[-1.0, -2.0, -3.0, -4.0 - place])
        results.append(plain.model_copy(update={"policy": renamed(plain.policy, name)}))

    recorded_seeds = {HOSTILE: (7, 8), "grid_search": (7, 8), BACKWARDS: (8,)}
    trajectory = {seed: record(spec("plain", (0.1, 0.1)), task.scenario, seed) for seed in (7, 8)}
    episodes = []
    for result in results:
        for seed in recorded_seeds.get(result.policy.name, ()):
            episodes.append(trajectory[seed].model_copy(update={"policy": result.policy}))
    # Validation would refuse the names.
    trajectories = Trajectories(task=task.digest, episodes=[])
    trajectories = trajectories.model_copy(update={"episodes": episodes})
    return Leaderboard(
        task,
        results,
        rank(results),
        trajectories,
        left_out=[],
    )


@pytest.fixture(scope="module")
def address(leaderboard: Leaderboard, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "index.html"
    path.write_text(page.render([leaderboard]), "utf-8")
    return path.as_uri()


def row(shown: Page, name: str) -> Locator:
    """Return the button that opens the row of a policy."""
    whole_name = re.compile(f"^{re.escape(name)}$")
    return shown.locator("section:visible .open").filter(has_text=whole_name)


def test_a_link_opens_its_policy(opened: Open, address: str) -> None:
    shown = opened(address)
    row(shown, HOSTILE).click()
    link = shown.url
    link_to_policy = shown.get_by_role("link", name="Link to this policy")
    assert link_to_policy.evaluate("link => link.href") == link
    row(shown, HOSTILE).click()
    assert shown.url == f"{address}#{ENV_ID}/rough_turning"
    again = opened(link)
    expect(row(again, HOSTILE)).to_be_in_viewport()
    expect(again.locator(".inner:visible .panels svg").first).to_be_visible()


def test_a_row_opens_and_a_second_policy_lies_over_it(opened: Open, address: str) -> None:
    shown = opened(address)
    button = row(shown, HOSTILE)
    button.click()
    expect(button).to_have_attribute("aria-expanded", "true")
    inner = shown.locator(".inner:visible")
    titles = [
        "cutting speed [m/min]",
        "feed [mm/rev]",
        "thrust force [N]",
        "power [kW]",
        "flank wear [mm]",
    ]
    expect(inner.locator("figcaption")).to_have_text(titles)
    assert inner.locator(".panels .limit").count() == 3
    # The published controller lies over it at first. Every panel shows the values of both where
    # the pointer is.
    assert inner.locator(".panels .second").count() == 5
    inner.locator(".panels svg").nth(1).hover(position={"x": 150, "y": 60})
    expect(inner.locator(".pointer[visibility=visible]")).to_have_count(5)
    readout = re.compile(r"^at 0\.\d+:.* \d.*grid_search \d")
    expect(inner.locator(".readout").first).to_have_text(readout)
    second = inner.get_by_role("combobox", name="Second policy")
    second.select_option(label="none")
    assert inner.locator(".panels .second").count() == 0
    second.select_option(label=f"\u2068{BACKWARDS}\u2069")
    expect(inner.locator(".note")).to_contain_text("second policy was not recorded")
    inner.get_by_role("combobox", name="Seed").select_option(label="8")
    assert inner.locator(".panels .second").count() == 5
    inner.get_by_role("combobox", name="Along").select_option(label="path [mm]")
    expect(inner.locator(".panels svg text").last).to_have_text("path [mm]")


@pytest.mark.parametrize("width", [360, 1280])
def test_the_page_is_no_wider_than_the_screen(opened: Open, address: str, width: int) -> None:
    shown = opened(address, width)
    best_return = shown.locator("section:visible .policy").first.locator("td.g0").first
    expect(best_return).to_be_in_viewport(ratio=1.0)
    row(shown, HOSTILE).click()
    expect(shown.locator(".panels svg").first).to_be_visible()
    assert shown.evaluate("document.documentElement.scrollWidth - innerWidth") == 0


SCROLLS = """element => {
  const { overflowX, overflowY } = getComputedStyle(element);
  const scrolls = /auto|scroll/;
  return scrolls.test(overflowX) && element.scrollWidth > element.clientWidth + 1
    || scrolls.test(overflowY) && element.scrollHeight > element.clientHeight + 1;
}"""


def test_nothing_but_the_page_scrolls_on_a_phone(opened: Open, address: str) -> None:
    shown = opened(address, 360)
    row(shown, "grid_search").click()
    expect(shown.locator(".panels svg").first).to_be_visible()
    first = shown.locator("section:visible .policy").first
    expect(first.locator("td.g0").first).to_have_attribute("data-label", "return [s]")
    elements = "[...document.querySelectorAll('body *')]"
    scrolling = f"{elements}.filter({SCROLLS}).map(element => element.tagName)"
    assert shown.evaluate(scrolling) == []
