"""True hardness and allowance along a bar, and the passes of an action: the transition's own functions on separate records."""

import numpy as np
from numpy.typing import NDArray

from turning_env.numerics.compilation import compiled_entry
from turning_env.physics.parts import start_part, start_pass
from turning_env.physics.quantities import WIDTH
from turning_env.physics.records import block_records
from turning_env.physics.workpiece import look_up_fields
from turning_env.scenario import Scenario

Array = NDArray[np.float64]


@compiled_entry
def read_fields(states, parameters, scratches, seed, episode, bar, places, hardness, depth):  # type: ignore[no-untyped-def]
    """Set log hardness [-] and depth of cut [mm] at places along a bar [mm], all of shape (places,)."""
    state, p, work = states[0], parameters[0], scratches[0].work
    for first in range(0, places.shape[0], WIDTH):
        count = min(WIDTH, places.shape[0] - first)
        for i in range(count):
            state.seed[i] = seed
            state.episode[i] = episode
            state.bar[i] = -1.0
            state.pass_ceiling[i] = np.inf
            work.engaged[i] = 1.0
            work.middle[i] = bar * p.bar_length[i] + places[first + i]
        look_up_fields(state, work, 0, count, p)
        for i in range(count):
            hardness[first + i] = state.log_hardness[i]
            depth[first + i] = state.depth_of_cut[i]


class Fields:
    """The bars of a scenario."""

    def __init__(self, scenario: Scenario) -> None:
        self._records = block_records(scenario)

    def along(self, key: tuple[int, int], bar: int, places: Array) -> tuple[Array, Array]:
        """Return relative hardness [-] and allowance [mm] at places along a bar [mm], without the ripple of run-out.

        ``key`` is the seed and the number of the episode.
        """
        hardness, depth = np.empty_like(places), np.empty_like(places)
        seed, episode = (np.uint64(number) for number in key)
        read_fields(*self._records, seed, episode, float(bar), places, hardness, depth)
        return np.exp(hardness), depth

    def passes(self, action: Array) -> list[tuple[float, float, float]]:
        """Return cutting speed [m/min], feed [mm/rev] and depth [mm] of each pass that an action on a whole part names."""
        (state,), (p,), (scratch,) = self._records
        start_part(state, scratch.work, 0, p, action)
        passes = []
        for number in range(scratch.work.passes[0]):
            start_pass(state, scratch.work, scratch.report, 0, p, action, number)
            passes.append(
                (
                    state.commanded_cutting_speed[0],
                    state.commanded_feed[0],
                    scratch.work.pass_depth[0],
                )
            )
        return passes


def warm_up() -> None:
    """Compile everything here."""
    Fields(Scenario()).along((0, 0), 0, np.zeros(1))
