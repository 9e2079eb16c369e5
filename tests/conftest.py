"""Settings for the whole suite."""

import os

import pytest
from hypothesis import HealthCheck, settings

# The first call of a compiled function takes seconds, and whether the suite passes must not depend on chance.
settings.register_profile("suite", deadline=None, derandomize=True, database=None)
# ``make soak``: other inputs with every run, and a hundred times as many (``tried`` in tests/soundness/acting.py). Failures are
# printed in the form that ``hypothesis.reproduce_failure`` takes.
settings.register_profile(
    "soak", deadline=None, derandomize=False, database=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
# No window is shown.
os.environ["SDL_VIDEODRIVER"] = "dummy"
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest tests, so that no worker is left with one at the end."""
    longest = ("tests/test_pages.py", "tests/test_identity.py")
    items.sort(key=lambda item: not item.nodeid.startswith(longest))
