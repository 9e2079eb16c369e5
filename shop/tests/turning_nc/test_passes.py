"""Passes of roughing cycles.

None is deeper than programmed, no rapid move goes through metal, and the contour is left.
"""

import itertools
import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pytest

pytest.importorskip("shapely")

from turning_nc.cutting import AssumedMachine, Situation, play
from turning_nc.edges import change_wear
from turning_nc.moves import Move
from turning_nc.paths import Point
from turning_nc.removal import remove
from turning_nc.report import rows
from turning_nc.stock import read_stock, volume

from shop.tests.turning_nc.programs import moves
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


@pytest.fixture
def neck() -> Situation:
    """The contour that ends low, turned from a bar of 40 mm diameter."""
    made = moves(NECK)
    removal = remove(made, read_stock("bar:40x60"), {"T0101": "copying"})
    return Situation(Scenario.load("rough_turning"), AssumedMachine(), made, removal)


def test_a_contour_that_ends_low_is_roughed_level_by_level(neck: Situation) -> None:
    fed = [move.path for move in neck.moves.moves if move.kind == "feed"]
    long_cuts = [path for path in fed if path.end.z == -50.0]
    diameters = [40.0, 38.0, 36.0, 34.0, 32.0, 30.0, 28.0, 26.0]
    assert [2.0 * path.end.x for path in long_cuts] == diameters
    assert [2.0 * path.start.x for path in long_cuts] == diameters


def test_no_pass_of_a_contour_that_ends_low_is_too_deep(neck: Situation) -> None:
    table = rows(neck, play(neck, change_wear(neck)))
    # A pass takes 1 mm, and what a slope of 27 degrees leaves beside it.
    assert max(row.depth for row in table) < 1.3
    assert neck.removal.rapids == {}


def test_a_contour_that_ends_low_takes_all_metal_above_it(neck: Situation) -> None:
    bar = 20.0  # radius [mm]
    front = 18.0
    end = 13.0
    mean_square_of_cone = (front**2 + front * end + end**2) / 3.0
    # Lengths along Z: the front, the cone and the neck.
    expected = math.pi * (
        20.0 * (bar**2 - front**2)
        + 10.0 * (bar**2 - mean_square_of_cone)
        + 20.0 * (bar**2 - end**2)
    )
    removed = volume(neck.removal.stock) - volume(neck.removal.part)
    assert removed == pytest.approx(expected, rel=5e-3)


class Place(NamedTuple):
    """A place as the tool sees it."""

    along: float  # distance along the feed, 0 to 60 mm in a contour
    height: float  # above the least that a contour may have, 5 to 25 mm in a contour


@dataclass(frozen=True)
class Job:
    """A contour, and the cycle that roughs it."""

    cycle: str
    inside: bool
    depth: float
    contour: Sequence[Place]

    @property
    def facing(self) -> bool:
        """Whether passes run along X."""
        return self.cycle in ("G72", "facing")

    def place(self, point: Point) -> Place:
        """Return a point of a move as the tool sees it."""
        if self.facing:
            return Place(65.0 - point.x, point.z + 25.0)
        return Place(-point.z, 50.0 - point.x if self.inside else point.x - 10.0)

    def words(self, place: Place) -> str:
        """Return the coordinates of a place, X as a diameter."""
        if self.facing:
            radius = 65.0 - place.along
            z = place.height - 25.0
        else:
            radius = 50.0 - place.height if self.inside else place.height + 10.0
            z = -place.along
        return f"X{2.0 * radius:.4f} Z{z:.4f}"

    @property
    def text(self) -> str:
        """The program."""
        start = self.words(Place(-2.0, 27.0))
        points = [self.words(place) for place in self.contour]
        lines = self._fanuc(start, points)
        if self.cycle in ("longitudinal", "facing"):
            lines = self._sinumerik(start, points)
        return "\n".join(lines)

    def _fanuc(self, start: str, points: list[str]) -> list[str]:
        entry_x, entry_z = self.words(Place(-2.0, self.contour[0].height)).split()
        return [
            "G21 G99 G97 S500 M3 F0.2",
            f"G0 {start}",
            f"{self.cycle} {'W' if self.facing else 'U'}{self.depth:.3f} R0.5",
            f"{self.cycle} P1 Q2 U0. W0.",
            f"N1 G0 {entry_z if self.facing else entry_x}",
            *(f"G1 {words}" for words in points[:-1]),
            f"N2 G1 {points[-1]}",
        ]

    def _sinumerik(self, start: str, points: list[str]) -> list[str]:
        variant = 2 if self.facing else 1
        if self.inside:
            variant = 3
        return [
            "DIAMON G90 G95 G71 G97 S500 M4 F0.2",
            f"G0 {start}",
            f'CYCLE95("C",{self.depth},0,0,0,0.2,0.1,0.1,{variant},,,0.5)',
            "M30",
            "%_N_C_SPF",
            *(f"G1 {words}" for words in points),
            "M17",
        ]


def random_job(seed: int) -> Job:
    """Return a job with steps, slopes and pockets; its contour may end anywhere."""
    rng = random.Random(seed)
    distances = [*sorted(rng.sample(range(1, 60), rng.randint(2, 6))), 60]
    height = rng.uniform(5.0, 25.0)
    contour = [Place(0.0, height)]
    for along in distances:
        height = height if rng.random() < 0.4 else rng.uniform(5.0, 25.0)
        contour.append(Place(along, height))
        if rng.random() < 0.3:  # a wall
            height = rng.uniform(5.0, 25.0)
            contour.append(Place(along, height))
    cycle = rng.choice(["G71", "G72", "longitudinal", "facing"])
    inside = cycle in ("G71", "longitudinal") and rng.random() < 0.5
    depth = rng.choice([0.7, 1.0, 2.5, 4.0])
    return Job(cycle, inside=inside, depth=depth, contour=contour)


class Metal:
    """The metal above a contour, by its height at places along it."""

    def __init__(self, job: Job) -> None:
        self.job = job
        self.along = np.linspace(0.0123, 59.9871, 1500)
        # CYCLE95 takes the top of the contour as its blank.
        top = max(place.height for place in job.contour)
        if job.cycle in ("G71", "G72"):
            top = 25.0
        self.height = np.full(self.along.shape, top)
        self.deepest_cut = 0.0  # [mm]
        self.deepest_rapid = 0.0  # depth of rapid moves in metal [mm]

    def move(self, move: Move) -> None:
        """Cut along a move."""
        points = [move.path.start, *move.path.points()]
        for start, end in itertools.pairwise(points):
            self._cut(self.job.place(start), self.job.place(end), is_rapid=move.kind == "rapid")

    def _cut(self, start: Place, end: Place, is_rapid: bool) -> None:
        low = min(start.along, end.along)
        high = max(start.along, end.along)
        on = (self.along > low) & (self.along < high)
        if not on.any():
            return
        slope = (end.height - start.height) / (end.along - start.along)
        path = start.height + slope * (self.along[on] - start.along)
        depth = float((self.height[on] - path).max())
        if is_rapid:
            self.deepest_rapid = max(self.deepest_rapid, depth)
        else:
            self.deepest_cut = max(self.deepest_cut, depth)
            self.height[on] = np.minimum(self.height[on], path)


@pytest.mark.parametrize("block", range(4))
def test_passes_are_as_deep_as_programmed_and_leave_the_contour(block: int) -> None:
    for seed in range(12 * block, 12 * block + 12):
        job = random_job(seed)
        metal = Metal(job)
        # The first move comes from anywhere.
        for move in moves(job.text).moves[1:]:
            metal.move(move)
        assert 0.0 < metal.deepest_cut < job.depth + 1e-3, job.text
        assert metal.deepest_rapid < 1e-3, job.text
        distances, heights = np.array(job.contour).T
        from_walls = abs(metal.along[:, np.newaxis] - distances).min(axis=1)
        is_clear = from_walls > 0.05
        expected = np.interp(metal.along, distances, heights)[is_clear]
        assert metal.height[is_clear] == pytest.approx(expected, abs=2e-3), job.text
