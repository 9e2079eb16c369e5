"""True hardness and allowance along a bar, and the passes of an action.

They come from the transition's own functions, on separate records.
"""

from typing import NamedTuple

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
def read_fields(  # type: ignore[no-untyped-def]  # noqa: PLR0913 - compiled, so without objects
    states, parameters, scratches, seed, episode, bar, places, hardness, depth
):
    """Set log hardness [-] and depth of cut [mm] at places along a bar [mm]; shape (places,)."""
    state = states[0]
    p = parameters[0]
    work = scratches[0].work
    for first in range(0, places.shape[0], WIDTH):
        count = min(WIDTH, places.shape[0] - first)
        for i in range(count):
            state.seed[i] = seed
            state.episode[i] = episode
            # No bar has this number, so the nodes of the wanted bar are drawn.
            state.bar[i] = -1.0
            # The whole blank, as before its first pass.
            state.pass_ceiling[i] = np.inf
            # Fields are only looked up in metal, at the middle of a cut.
            work.engaged[i] = 1.0
            work.middle[i] = bar * p.bar_length[i] + places[first + i]
        look_up_fields(state, work, 0, count, p)
        for i in range(count):
            hardness[first + i] = state.log_hardness[i]
            depth[first + i] = state.depth_of_cut[i]


class BarMetal(NamedTuple):
    """True properties of a bar at places along it."""

    hardness: Array  # relative to nominal [-]
    depth: Array  # allowance [mm], without the ripple of run-out


class Pass(NamedTuple):
    """A pass over a whole part."""

    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]
    depth: float  # [mm]


class Fields:
    """The bars of a scenario."""

    def __init__(self, scenario: Scenario) -> None:
        self._states, self._parameters, self._scratches = block_records(scenario)

    def along(self, key: tuple[int, int], bar: int, places: Array) -> BarMetal:
        """Return hardness and allowance at places along a bar [mm].

        ``key`` is the seed and the number of the episode.
        """
        seed, episode = key
        hardness = np.empty_like(places)
        depth = np.empty_like(places)
        read_fields(
            self._states,
            self._parameters,
            self._scratches,
            np.uint64(seed),
            np.uint64(episode),
            float(bar),
            places,
            hardness,
            depth,
        )
        return BarMetal(np.exp(hardness), depth)

    def passes(self, action: Array) -> list[Pass]:
        """Return the passes that an action on a whole part names."""
        state = self._states[0]
        p = self._parameters[0]
        scratch = self._scratches[0]
        start_part(state, scratch.work, 0, p, action)
        passes = []
        for number in range(scratch.work.passes[0]):
            start_pass(state, scratch.work, scratch.report, 0, p, action, number)
            passes.append(
                Pass(
                    cutting_speed=state.commanded_cutting_speed[0],
                    feed=state.commanded_feed[0],
                    depth=scratch.work.pass_depth[0],
                )
            )
        return passes


def warm_up() -> None:
    """Compile the functions of this module."""
    Fields(Scenario()).along((0, 0), 0, np.zeros(1))
