"""Many scenarios side by side, for arithmetic on all of them at once."""

from collections.abc import Iterator, Mapping, Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from turning_env.scenario.derived import DerivedQuantities
from turning_env.scenario.power_law import PowerLaw, log_coefficient
from turning_env.scenario.scenario import Scenario, flat, nested


class SectionBatch(SimpleNamespace):
    """One section of many scenarios: an attribute for each of its fields.

    Iteration gives names and values of the fields, as for a ``Section``.
    """

    def __iter__(self) -> Iterator[tuple[str, Any]]:
        return iter(vars(self).items())


class PowerLawBatch(SectionBatch):
    """One power law of many scenarios."""

    @property
    def log_coefficient(self) -> Any:
        """Natural logarithm of the coefficient, with the reference depth folded in."""
        return log_coefficient(self)


class ScenarioBatch(DerivedQuantities):
    """Many scenarios side by side.

    Sections and fields have the names of ``Scenario``'s: ``batch.limits.power``. A field is an
    array of shape (scenarios,), or one value that all scenarios share. Values are not checked.
    """

    if TYPE_CHECKING:
        # The constructor sets an attribute for each section of ``Scenario``.
        def __getattr__(self, name: str) -> SectionBatch: ...

    def __init__(self, values: Mapping[str, Any], num_scenarios: int) -> None:
        """Take the values of all fields by dotted names.

        Args:
            values: arrays of shape (scenarios,), which are not copied, and values that all share.
            num_scenarios: number of scenarios.
        """
        self.num_scenarios = num_scenarios
        self._names = []
        for name, fields in nested(values.items()).items():
            setattr(self, name, _section_batch(fields, Scenario.model_fields[name].annotation))
            self._names.append(name)

    @classmethod
    def of(cls, scenarios: Sequence[Scenario]) -> "ScenarioBatch":
        """Return scenarios side by side, without their names and nominal models."""
        rows = []
        for scenario in scenarios:
            rows.append(flat(scenario.model_dump(exclude={"name", "nominal_model"})))
        values = {}
        for name, first in rows[0].items():
            same = all(row[name] == first for row in rows)
            values[name] = first if same else np.array([row[name] for row in rows])
        return cls(values, len(rows))

    def __iter__(self) -> Iterator[tuple[str, SectionBatch]]:
        """Iterate over names and sections, as for a ``Scenario``."""
        for name in self._names:
            yield name, getattr(self, name)


def _section_batch(fields: Mapping[str, Any], section: Any) -> SectionBatch:
    values = {}
    for name, value in fields.items():
        if isinstance(value, dict):
            value = _section_batch(value, section.model_fields[name].annotation)
        values[name] = value
    if issubclass(section, PowerLaw):
        return PowerLawBatch(**values)
    return SectionBatch(**values)
