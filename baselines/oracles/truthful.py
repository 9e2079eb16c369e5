"""A family whose nominal models are true: what a policy could earn that knows its lathes."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env.scenario.family import DrawnJobs, Family
from turning_env.scenario.plan import features, plan_of

Prefixes = str | tuple[str, ...]
"""Beginning of the dotted names of fields, or one of several beginnings."""


class Truthful(Family):
    """A family whose nominal models are true in some fields; its jobs are otherwise the same."""

    true_fields: Prefixes = ""  # beginnings of the dotted names of these fields

    @classmethod
    def of(cls, family: Family, true_fields: Prefixes = "") -> "Truthful":
        """Return a family with nominal models that are true in the fields with these prefixes."""
        return cls.model_validate(family.model_dump() | {"true_fields": true_fields})

    def __reduce__(self) -> Any:
        """Pickle the family without its jobs."""
        return Truthful.model_validate, (self.model_dump(),)

    def draw_numbers(self, split: str, numbers: NDArray[np.uint64]) -> DrawnJobs:
        """Draw the family's jobs, then replace nominal values of ``true_fields`` by the true ones.

        ``numbers`` are those of the jobs, shape (jobs,).
        """
        jobs = super().draw_numbers(split, numbers)
        fields = dict(jobs.nominal_fields)
        for name in fields:
            if name.startswith(self.true_fields):
                fields[name] = jobs.true_fields[name]
        nominal = self.batch_of(fields, len(numbers))
        plan = plan_of(nominal)
        # The catalogue's numbers do not follow from a nominal model, so they stay.
        shown = {name: jobs.features[name] for name in self.shown}
        return replace(
            jobs,
            nominal=nominal,
            plan=plan,
            nominal_fields=fields,
            features=features(nominal, plan) | shown,
        )
