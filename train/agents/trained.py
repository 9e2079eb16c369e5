"""A finished training, ready to play, whatever kind of file it comes from."""

from dataclasses import dataclass
from typing import Any

from turning_env import Scenario
from turning_env.score.policy import PolicyFactory

ONNX_SUFFIX = ".onnx"
"""Of agents' files that need neither PyTorch nor trust: see ``agent_file.py``."""


@dataclass(frozen=True)
class TrainedAgent:
    """A finished training, ready to play."""

    name: str
    seed: int
    env_id: str
    scenario: Scenario
    """On which it was trained."""
    command: str
    parameters: dict[str, Any]
    """The algorithm's hyperparameters."""
    trained_steps: int
    digest: str
    """SHA-256 of what it acts by."""
    make: PolicyFactory

    def check_fits(self, scenario: Scenario) -> None:
        """See that it can play a scenario, which need not be the one that it was trained on.

        Raises:
            ValueError: the scenario has other actions, or observations of other meaning.
        """
        for field in ("control.action", "control.aim", "control.edge_changes", "sensors.force", "sensors.probe"):
            mine, its = (_value(each, field) for each in (self.scenario, scenario))
            if mine != its:
                raise ValueError(
                    f"{self.name}, trained on scenario {self.scenario.name!r} with {field} = {mine!r}, cannot play "
                    f"{scenario.name!r}, where it is {its!r}: actions or observations would mean something else"
                )


def _value(scenario: Scenario, field: str) -> Any:
    section, name = field.split(".")
    return getattr(getattr(scenario, section), name)
