"""The description of a controller.

A ``Rule`` says how to build a controller, which scenarios it can play, and which parameters are
tuned. The controllers are files of their own; ``catalogue.py`` collects them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from turning_env import Scenario
from turning_env.policy import Policy

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]  # of environments, shape (num_envs,), unless it says otherwise
Parameters = dict[str, float]
Scenarios = Scenario | Sequence[Scenario]  # a task, or one for each environment


@dataclass(frozen=True)
class TuningRange:
    """The range within which a parameter is tuned."""

    low: float
    high: float
    logarithmic: bool = False


@dataclass(frozen=True)
class Rule:
    """A controller with its parameters."""

    description: str
    """One line that names the source."""
    controller: Callable[..., Policy]
    """Builds the policy from a scenario, a number of environments, and the parameters by name."""
    plays: Callable[[Scenario], bool]
    """Returns whether a scenario offers the actions and the inputs that the controller needs."""
    parameters: Mapping[str, float | TuningRange]
    """Fixed numbers, and ranges of parameters to tune."""
    version: int = 1
    """Version, raised when its actions change.

    Results and tuned parameters of other versions are then invalid.
    """
    changes_edges: bool = False
    """Whether it decides when to change the edge, if edges are changed on command."""
    worth_tuning: bool = False
    """Whether ``--quick`` tuning includes it.

    These are the best rules that need tuning, and fixed parameters for comparison.
    """
    together: bool = False
    """Whether ``controller`` also takes a sequence of scenarios, one for each environment."""
    published: bool = False
    """Whether it is a controller of a published paper; its parameters may be tuned here."""
    tuned_on: str | None = None
    """The preset on which it is tuned for all scenarios.

    It is for slow rules whose parameters have no unit.
    """

    @property
    def ranges(self) -> dict[str, TuningRange]:
        """Parameters to tune."""
        ranges = {}
        for name, value in self.parameters.items():
            if isinstance(value, TuningRange):
                ranges[name] = value
        return ranges

    @property
    def fixed(self) -> Parameters:
        """Parameters that are not tuned."""
        fixed = {}
        for name, value in self.parameters.items():
            if not isinstance(value, TuningRange):
                fixed[name] = value
        return fixed


def published(rules: Mapping[str, Rule]) -> dict[str, Rule]:
    """Return rules as those of a published paper."""
    return {name: replace(rule, published=True) for name, rule in rules.items()}
