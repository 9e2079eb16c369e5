"""A kind of controller: how it is built, what it can play, and which of its parameters are tuned."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from turning_env import Scenario
from turning_env.score.policy import Policy

Parameters = dict[str, float]


@dataclass(frozen=True)
class Range:
    """The range within which a parameter is tuned."""

    low: float
    high: float
    logarithmic: bool = False


@dataclass(frozen=True)
class Rule:
    """A kind of controller."""

    description: str
    """One line, which names the source."""
    build: Callable[[Scenario, int, Parameters], Policy]
    """Makes the policy for a scenario, a number of environments and its parameters."""
    plays: Callable[[Scenario], bool]
    """Whether a scenario offers the actions and the inputs that it needs."""
    parameters: Mapping[str, float | Range]
    """A number is fixed, a range is tuned."""
    version: int = 1
    """Raised when its actions change: results and tuned parameters of other versions are no longer its own."""
    changes_edges: bool = False
    """Whether it says itself when to change the edge, where edges are changed on command."""
    tuned_on: str | None = None
    """The preset on which alone it is tuned, for all scenarios; for rules slow to play, whose parameters have no unit."""

    tolerance: float = 0.0
    """By how much the return of an episode [s] may differ on another processor; 0: not by a bit."""

    @property
    def ranges(self) -> dict[str, Range]:
        """The parameters to be tuned."""
        return {name: value for name, value in self.parameters.items() if isinstance(value, Range)}

    @property
    def fixed(self) -> Parameters:
        """The parameters that are what they are."""
        return {name: value for name, value in self.parameters.items() if not isinstance(value, Range)}
