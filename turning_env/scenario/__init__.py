"""What can be configured: the scenario, its sections, the power law, validation and the presets.

A scenario holds values and no state; what happens on a lathe belongs in ``physics``.
"""

from turning_env.scenario.scenario import PortableScenario, Scenario, ScenarioError, presets

__all__ = ["PortableScenario", "Scenario", "ScenarioError", "presets"]
