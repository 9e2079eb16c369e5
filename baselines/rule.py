"""A kind of controller: how it is built, which scenarios it can play, and which of its parameters are tuned."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from turning_env import Scenario
from turning_env.scoring.policy import Policy

Parameters = dict[str, float]


TOLERANCE = 1e-6
"""Difference that another processor may make in any number of a rule's episode, such as its return [s].

Rules compute with NumPy, whose exponentials and logarithms differ in their last bit between processors: measured, at most 3e-9.
"""


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
    """Makes the policy for a scenario, a number of environments and parameters."""
    plays: Callable[[Scenario], bool]
    """Whether a scenario offers the actions and the inputs that it needs."""
    parameters: Mapping[str, float | Range]
    """A number is fixed, a range is tuned."""
    version: int = 1
    """Raised when its actions change, which makes results and tuned parameters of other versions invalid."""
    changes_edges: bool = False
    """Whether it decides itself when to change the edge, if edges are changed on command."""
    worth_tuning: bool = False
    """Whether a quick tuning includes it: the best of those that need tuning, and the fixed parameters to compare with."""
    tuned_on: str | None = None
    """The one preset on which it is tuned for all scenarios: for slow rules, whose parameters have no unit."""

    @property
    def ranges(self) -> dict[str, Range]:
        """Return the parameters to tune."""
        return {name: value for name, value in self.parameters.items() if isinstance(value, Range)}

    @property
    def fixed(self) -> Parameters:
        """Return the parameters that are not tuned."""
        return {name: value for name, value in self.parameters.items() if not isinstance(value, Range)}
