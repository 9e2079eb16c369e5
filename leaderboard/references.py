"""The references that are ranked beside the policies of a scenario: what no policy can know is known to them."""

from leaderboard.contestants import Reference
from turning_env import Scenario


def references(scenario: Scenario) -> list[Reference]:
    """Those that can be computed for a scenario."""
    return []
