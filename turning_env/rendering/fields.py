"""True hardness and allowance along a bar, and the passes of an action: the transition's own functions on separate records."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env.numerics.compilation import compiled_entry, handed_over, source_digest
from turning_env.physics.parts import start_part, start_pass
from turning_env.physics.records import LANES, REPORT, WIDTH, WORK, new_records, parameter_records
from turning_env.physics.workpiece import look_up_fields
from turning_env.scenario import Scenario
from turning_env.scenario.sections import MAX_PASSES

Array = NDArray[np.float64]


def _entries(digest: str) -> tuple[Any, Any]:
    @compiled_entry
    def read_fields(blocks, parameters, works, seed, episode, bar, places, hardness, depth):  # type: ignore[no-untyped-def]
        """Log hardness [-] and depth of cut [mm] at places along a bar [mm], all of shape (places,)."""
        digest  # noqa: B018 - see compiled_entry
        p, lanes, work = parameters[0], blocks[0], works[0]
        for first in range(0, places.shape[0], WIDTH):
            count = min(WIDTH, places.shape[0] - first)
            for i in range(count):
                lanes.seed[i] = seed
                lanes.episode[i] = episode
                lanes.bar[i] = -1.0
                lanes.pass_ceiling[i] = np.inf
                work.engaged[i] = 1.0
                work.middle[i] = bar * p.bar_length + places[first + i]
            look_up_fields(lanes, work, 0, count, p)
            for i in range(count):
                hardness[first + i] = lanes.log_hardness[i]
                depth[first + i] = lanes.depth_of_cut[i]

    @compiled_entry
    def read_passes(blocks, parameters, works, reports, action, passes):  # type: ignore[no-untyped-def]
        """Cutting speed [m/min], feed [mm/rev] and depth [mm] of each pass, shape (MOST_PASSES, 3); returns how many."""
        digest  # noqa: B018 - see compiled_entry
        p, lanes, work, report = parameters[0], blocks[0], works[0], reports[0]
        start_part(lanes, work, 0, p, action)
        for number in range(work.passes[0]):
            start_pass(lanes, work, report, 0, p, action, number)
            passes[number, 0] = lanes.commanded_cutting_speed[0]
            passes[number, 1] = lanes.commanded_feed[0]
            passes[number, 2] = work.pass_depth[0]
        return work.passes[0]

    return read_fields, read_passes


_read_fields, _read_passes = _entries(source_digest())


@dataclass(frozen=True)
class Key:
    """What determines an episode's bars."""

    seed: int
    episode: int


class Fields:
    """The bars of a scenario."""

    def __init__(self, scenario: Scenario) -> None:
        parameters = parameter_records(scenario)
        records = (new_records(LANES, 1), parameters, new_records(WORK, 1), new_records(REPORT, 1))
        self._records = tuple(handed_over(record) for record in records)

    def along(self, key: Key, bar: int, places: Array) -> tuple[Array, Array]:
        """Return relative hardness [-] and allowance [mm] at places along a bar [mm], without the ripple of run-out."""
        hardness, depth = np.empty_like(places), np.empty_like(places)
        seed, episode = np.uint64(key.seed), np.uint64(key.episode)
        _read_fields(*self._records[:3], seed, episode, float(bar), places, hardness, depth)
        return np.exp(hardness), depth

    def passes(self, action: Array) -> list[tuple[float, float, float]]:
        """Return cutting speed [m/min], feed [mm/rev] and depth [mm] of each pass that an action on a whole part names."""
        passes = np.zeros((MAX_PASSES, 3))
        count = _read_passes(*self._records, action, passes)
        return [tuple(row) for row in passes[:count].tolist()]
