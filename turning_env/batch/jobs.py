"""The jobs of a family as the compiled transition reads them: drawn in chunks, and kept."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env.physics.records import CHOICES, PARAMETERS, new_records, numbers_of, parameter_records
from turning_env.scenario import Scenario
from turning_env.scenario.family import CHUNK, Family


class Jobs:
    """The jobs of a split, by number; ``told``: whether the nominal model's numbers are appended to observations."""

    def __init__(self, family: Family, split: str, told: bool) -> None:
        self.family, self.split = family, split
        self._told = told
        self._chunk = cache(self._draw)
        # A job's scenario, of which every job has the choices, such as its action and its sensors.
        self.scenario: Scenario = family.job(0, split).scenario
        self.context_names = family.context_names if told else ()  # of what is appended to an observation
        self._shared = parameter_records(self.scenario)

    def __reduce__(self) -> Any:
        """Pickle and copy the split without its jobs."""
        return Jobs, (self.family, self.split, self._told)

    def block_parameters(self, blocks: int) -> Any:
        """Return parameters for blocks of environments, with the choices that all jobs share."""
        records = new_records(PARAMETERS, blocks)
        for name in CHOICES:
            records[name] = self._shared[name][0]
        return records

    def __getitem__(self, number: int) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Return a job's numbers, in the order of ``PARAMETERS``, and its context."""
        numbers, context = self._chunk(number // CHUNK)
        return numbers[number % CHUNK], context[number % CHUNK]

    def _draw(self, chunk: int) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        draw = self.family.draw(self.split, chunk)
        records = parameter_records(draw.true, CHUNK, draw.nominal)
        for name in CHOICES:
            if (records[name] != self._shared[name][0]).any():
                raise ValueError(f"the jobs of family {self.family.name!r} must all have the same {name}")
        numbers = numbers_of(records).swapaxes(1, 2).reshape(CHUNK, -1)
        context = self.family.context(draw.features) if self._told else np.zeros((CHUNK, 0))
        return numbers, context.astype(np.float32)
