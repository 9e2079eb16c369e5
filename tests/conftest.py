"""Settings for the whole suite."""

import os

from hypothesis import HealthCheck, settings

# The first call of a compiled function takes seconds, and a run must not depend on chance.
settings.register_profile("suite", deadline=None, derandomize=True, database=None)
# ``make soak``: other inputs with every run, and some thousand times as many (tests/soundness/effort.py). What fails is printed
# so that it can be given to ``hypothesis.reproduce_failure``.
settings.register_profile(
    "soak", deadline=None, derandomize=False, database=None, print_blob=True, suppress_health_check=[HealthCheck.too_slow]
)
# Windows are opened where nobody sees them, with a display or without.
os.environ["SDL_VIDEODRIVER"] = "dummy"
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))
