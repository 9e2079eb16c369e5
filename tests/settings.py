"""Settings for the whole suite."""

import functools
import gc
import os
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.internal.conjecture import providers
from hypothesis.internal.constants_ast import Constants

from tests.programs import NO_CHROMIUM
from tests.walking import MAX_SECONDS

# No deadline, as the first call of a compiled function takes seconds. The inputs are the same in
# every run, as whether the suite passes must not depend on chance.
settings.register_profile(
    "suite",
    deadline=None,
    derandomize=True,
    database=None,
)
# ``make soak``: other inputs with every run, and a hundred times as many (``tried`` in
# tests/soundness/acting.py). Failures are printed as ``hypothesis.reproduce_failure`` takes them.
settings.register_profile(
    "soak",
    deadline=None,
    derandomize=False,
    database=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
# Workers share the cores: with more threads they wait for one another. NumPy and torch read this
# when they are imported.
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
# Else each process compiles the sources again: a tenth of a second for a command, and half of the
# time in which tests are collected.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
# No window is shown.
os.environ["SDL_VIDEODRIVER"] = "dummy"
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))
SOAKS = os.environ.get("HYPOTHESIS_PROFILE") == "soak"
if not SOAKS:
    # Hypothesis also draws the constants of all modules imported so far: inputs would depend on the
    # tests that ran before in the same worker. No setting turns this off.
    providers._get_local_constants = Constants

LONGEST = (
    "tests/test_pages.py",
    "tests/test_identity.py",
    "tests/research/papers/test_reproduce.py",
    "shop/tests/test_notebooks.py",
    "shop/tests/turning_shop/test_your_own_machine.py",
)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out tests of ``make soak``, and start with the longest tests.

    Then no worker starts a long test when the others have finished.
    """
    if not SOAKS:
        only_in_soak = [item for item in items if item.get_closest_marker("soak")]
        items[:] = [item for item in items if item not in only_in_soak]
        if only_in_soak:
            config.hook.pytest_deselected(items=only_in_soak)
    # False sorts before True, and the sort is stable.
    items.sort(key=lambda item: not item.nodeid.startswith(LONGEST))


def pytest_collectstart() -> None:
    """Collect no garbage while tests are imported: a fifth of that time, for next to nothing."""
    gc.disable()


def read_onnx_functions_once() -> None:
    """Have PyTorch keep its functions in ONNX, whose sources each export reads: half of its time.

    No setting does.
    """
    if "train.to_onnx" in sys.modules:
        from torch.onnx._internal.exporter._registration import ONNXRegistry

        kept: Any = staticmethod(functools.cache(ONNXRegistry.from_torchlib))
        ONNXRegistry.from_torchlib = kept


def pytest_collection_finish(session: pytest.Session) -> None:
    """Leave what was imported out of garbage collections, which visit a million objects else."""
    # Only slow tests export agents.
    if any(item.get_closest_marker("slow") for item in session.items):
        read_onnx_functions_once()
    gc.collect()
    gc.freeze()
    gc.enable()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """List why tests were skipped, and what installs the programs that they need."""
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
        chromium_browser = playwright.chromium.launch(
            executable_path=chromium, args=["--no-sandbox"]
        )
        yield chromium_browser
        chromium_browser.close()


@pytest.fixture
def opened(browser: Any) -> Iterator[Callable[..., Any]]:
    """Open pages by their addresses.

    After the test, no page may have printed, failed, or requested anything but itself.
    """
    contexts = []
    complaints: list[str] = []

    def open_page(address: str, width: int = 1280) -> Any:
        context = browser.new_context(viewport={"width": width, "height": 844})
        context.set_default_timeout(1000 * MAX_SECONDS)
        contexts.append(context)
        address_without_anchor, _, _ = address.partition("#")

        def note_request(request: Any) -> None:
            if not request.url.startswith(address_without_anchor):
                complaints.append(request.url)

        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", note_request)
        page.goto(address)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert complaints == []
