"""The policies with which all others are compared on a task, and that are the ends of its score."""

from dataclasses import dataclass

from turning_env.scenario import Scenario

CAUSAL = "causal"
"""The oracle on all tasks, which sees the true present state: it scores 100."""
NOMINAL_OPTIMUM = "fixed_nominal_optimum"
"""The nominal model's best set point of each job of a family."""
NOMINAL_SHARE = "fixed_nominal_share"
"""A share of that speed and feed, tuned on training jobs to be feasible."""


@dataclass(frozen=True)
class Comparators:
    """The policies with which all others are compared on a task."""

    fixed: str  # best feasible fixed speed and feed on tuning seeds or training jobs: score 0
    published: str | None  # a published controller; None if none plays


SPEED_AND_FEED = Comparators(fixed="fixed_tuned", published="grid_search")
OVERRIDE = Comparators(fixed="override_tuned", published="modified_fuzzy_override")
ROUGHNESS = Comparators(fixed="override_tuned", published="constant_force")
PARTS = Comparators(fixed="parts_fixed_tuned", published="parts_app_pt")
JOBS = Comparators(fixed=NOMINAL_SHARE, published=None)


def comparators(scenario: Scenario, *, on_family: bool = False) -> Comparators:
    """Return the comparators of a scenario, or of a family whose jobs share its values."""
    if on_family:
        return JOBS
    if scenario.control.action == "part":
        return PARTS
    if scenario.control.action != "override":
        return SPEED_AND_FEED
    return ROUGHNESS if scenario.control.aim == "roughness" else OVERRIDE
