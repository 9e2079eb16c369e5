"""Passes of roughing cycles: no deeper than programmed, no rapid move in metal, and the contour at the end."""

import itertools
import math
import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("shapely")

from turning_nc.cutting import Machine, Situation, play
from turning_nc.edges import change_wear
from turning_nc.moves import Move
from turning_nc.removal import remove
from turning_nc.report import rows
from turning_nc.stock import read_stock, volume

from shop.tests.turning_nc.test_moves import moves
from turning_env import Scenario

NECK = """G21 G40 G99
T0101
G97 S800 M03
G0 X42. Z2.
G71 U1. R0.5
G71 P10 Q20 U0. W0. F0.2
N10 G0 X36.
G1 Z-20.
X26. Z-30.
N20 Z-50.
G0 X100. Z50.
M30
"""


def test_a_contour_that_ends_low_is_roughed_level_by_level() -> None:
    made = moves(NECK)
    removal = remove(made, read_stock("bar:40x60"), {"T0101": "copying"})
    situation = Situation(Scenario.load("rough_turning"), Machine(), made, removal)
    table = rows(situation, play(situation, change_wear(situation)))
    assert (
        max(row.depth for row in table) < 1.3
    )  # 1 mm, and what a slope of 27 degrees leaves beside it
    assert removal.rapids == {}
    long_cuts = [
        move.path for move in made.moves if move.kind == "feed" and move.path.end[0] == -50.0
    ]
    assert [2.0 * path.end[1] for path in long_cuts] == [
        40.0,
        38.0,
        36.0,
        34.0,
        32.0,
        30.0,
        28.0,
        26.0,
    ]
    assert all(path.start[1] == path.end[1] for path in long_cuts)
    cylinders = 20.0 * (20.0**2 - 18.0**2) + 20.0 * (20.0**2 - 13.0**2)
    cone = 10.0 * (20.0**2 - (18.0**2 + 18.0 * 13.0 + 13.0**2) / 3.0)
    assert volume(removal.stock) - volume(removal.part) == pytest.approx(
        math.pi * (cylinders + cone), rel=5e-3
    )


@dataclass(frozen=True)
class Job:
    """A contour, as distances along the feed and heights, and the cycle that roughs it."""

    cycle: str
    inside: bool
    depth: float
    contour: Sequence[
        tuple[float, float]
    ]  # distances along, from 0 to 60 mm; heights, from 5 to 25 mm

    def point(self, along: float, height: float) -> tuple[float, float]:
        """Return X (diameter) and Z."""
        if self.cycle in ("G72", "facing"):
            return 2.0 * (65.0 - along), height - 25.0
        return 2.0 * (50.0 - height if self.inside else height + 10.0), -along

    def seen(self, path: tuple[float, float]) -> tuple[float, float]:
        """Return the distance along and the height of a point of a move, Z and radius."""
        z, x = path
        if self.cycle in ("G72", "facing"):
            return 65.0 - x, z + 25.0
        return -z, 50.0 - x if self.inside else x - 10.0

    def words(self, along: float, height: float) -> str:
        x, z = self.point(along, height)
        return f"X{x:.4f} Z{z:.4f}"

    @property
    def text(self) -> str:
        """The program."""
        start = self.words(-2.0, 27.0)
        points = [self.words(*point) for point in self.contour]
        if self.cycle in ("G71", "G72"):
            first = "Z" if self.cycle == "G72" else "X"
            entry = next(
                word for word in self.words(-2.0, self.contour[0][1]).split() if word[0] == first
            )
            depth = f"{'W' if self.cycle == 'G72' else 'U'}{self.depth:.3f}"
            lines = [
                "G21 G99 G97 S500 M3 F0.2",
                f"G0 {start}",
                f"{self.cycle} {depth} R0.5",
                f"{self.cycle} P1 Q2 U0. W0.",
            ]
            lines += [
                f"N1 G0 {entry}",
                *(f"G1 {words}" for words in points[:-1]),
                f"N2 G1 {points[-1]}",
            ]
            return "\n".join(lines)
        kind = 2 if self.cycle == "facing" else 3 if self.inside else 1
        call = f'CYCLE95("C",{self.depth},0,0,0,0.2,0.1,0.1,{kind},,,0.5)'
        lines = ["DIAMON G90 G95 G71 G97 S500 M4 F0.2", f"G0 {start}", call, "M30", "%_N_C_SPF"]
        return "\n".join([*lines, *(f"G1 {words}" for words in points), "M17"])


def random_job(seed: int) -> Job:
    """Return a job with steps, slopes and pockets; its contour may end anywhere."""
    rng = random.Random(seed)
    places = [0.0, *sorted(rng.sample(range(1, 60), rng.randint(2, 6))), 60.0]
    height = rng.uniform(5.0, 25.0)
    contour = [(0.0, height)]
    for along in places[1:]:
        height = height if rng.random() < 0.4 else rng.uniform(5.0, 25.0)
        contour.append((along, height))
        if rng.random() < 0.3:  # a wall
            height = rng.uniform(5.0, 25.0)
            contour.append((along, height))
    cycle = rng.choice(["G71", "G72", "longitudinal", "facing"])
    inside = cycle in ("G71", "longitudinal") and rng.random() < 0.5
    return Job(cycle, inside, rng.choice([0.7, 1.0, 2.5, 4.0]), contour)


def cut(
    job: Job, made: Sequence[Move]
) -> tuple[float, float, NDArray[np.float64], NDArray[np.float64]]:
    """Return the deepest cut, the deepest rapid move in metal, and the places and heights of the metal that stays [mm]."""
    along = np.linspace(0.0123, 59.9871, 1500)
    top = 25.0 if job.cycle in ("G71", "G72") else max(height for _, height in job.contour)
    metal = np.full(along.shape, top)
    deepest = {"feed": 0.0, "rapid": 0.0}
    for move in made[1:]:  # the first comes from anywhere
        for start, end in itertools.pairwise([move.path.start, *move.path.points()]):
            (first, height), (last, end_height) = job.seen(start), job.seen(end)
            on = (along > min(first, last)) & (along < max(first, last))
            if not on.any():
                continue
            path = height + (along[on] - first) / (last - first) * (end_height - height)
            deepest[move.kind] = max(deepest[move.kind], float((metal[on] - path).max()))
            if move.kind == "feed":
                metal[on] = np.minimum(metal[on], path)
    return deepest["feed"], deepest["rapid"], along, metal


@pytest.mark.parametrize("block", range(4))
def test_passes_are_as_deep_as_programmed_and_leave_the_contour(block: int) -> None:
    for seed in range(12 * block, 12 * block + 12):
        job = random_job(seed)
        deepest, rapid, along, metal = cut(job, moves(job.text).moves)
        assert deepest < job.depth + 1e-3, job.text
        assert rapid < 1e-3, job.text
        places, heights = np.array(job.contour).T
        clear = abs(along[:, np.newaxis] - places).min(axis=1) > 0.05  # of walls
        assert metal[clear] == pytest.approx(np.interp(along, places, heights)[clear], abs=2e-3), (
            job.text
        )
