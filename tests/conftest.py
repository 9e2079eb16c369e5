"""Settings for the whole suite."""

from hypothesis import settings

# The first call of a compiled function takes seconds, and a run must not depend on chance.
settings.register_profile("suite", deadline=None, derandomize=True, database=None)
settings.load_profile("suite")
