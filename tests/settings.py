"""Settings for the whole suite."""

import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from tests.programs import NO_CHROMIUM
from tests.walking import MAX

# The first call of a compiled function takes seconds, and whether the suite passes must not depend on chance.
settings.register_profile("suite", deadline=None, derandomize=True, database=None)
# ``make soak``: other inputs with every run, and a hundred times as many (``tried`` in tests/soundness/acting.py). Failures are
# printed in the form that ``hypothesis.reproduce_failure`` takes.
settings.register_profile(
    "soak",
    deadline=None,
    derandomize=False,
    database=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
# Workers share the cores: with more threads they wait for one another. NumPy and torch read this when they are imported.
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
# No window is shown.
os.environ["SDL_VIDEODRIVER"] = "dummy"
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))
SOAKS = os.environ.get("HYPOTHESIS_PROFILE") == "soak"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out tests of ``make soak``, and begin with the longest tests, so that no worker ends with one."""
    left_out = [item for item in items if item.get_closest_marker("soak")] if not SOAKS else []
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]
    longest = (
        "tests/test_pages.py",
        "tests/test_identity.py",
        "tests/research/papers/test_reproduce.py",
    )
    items.sort(key=lambda item: not item.nodeid.startswith(longest))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say which tests were left out, and what installs the programs that they need."""
    reasons: Counter[str] = Counter()
    for report in terminalreporter.getreports("skipped"):
        if isinstance(report.longrepr, tuple):
            reason = report.longrepr[2]
            reasons[reason.removeprefix("Skipped: ")] += 1
    if not reasons:
        return
    terminalreporter.section("not tested here")
    for reason, count in reasons.most_common():
        terminalreporter.line(f"{count:4d}  {reason}")


@pytest.fixture(scope="module")
def browser() -> Iterator[object]:
    """Yield a Chromium, one for all tests of a file."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip(NO_CHROMIUM)
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture
def opened(browser: Any) -> Iterator[Callable[..., Any]]:
    """Open pages by their addresses; at the end they must have said nothing and asked for nothing else."""
    contexts, heard = [], []

    def go(address: str, width: int = 1280) -> Any:
        context = browser.new_context(viewport={"width": width, "height": 844})
        context.set_default_timeout(1000 * MAX)
        contexts.append(context)
        page, own = context.new_page(), address.partition("#")[0]
        page.on("console", lambda message: heard.append(message.text))
        page.on("pageerror", lambda error: heard.append(str(error)))
        page.on(
            "request",
            lambda request: None if request.url.startswith(own) else heard.append(request.url),
        )
        page.goto(address)
        return page

    yield go
    for context in contexts:
        context.close()
    assert heard == []
