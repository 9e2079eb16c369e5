"""Metal in pieces and the sweep of a tool agree with overlays of whole polygons."""

import itertools

import numpy as np
import pytest

pytest.importorskip("shapely")

import shapely
from turning_nc.metal import MAX_VERTICES, Metal, overlaps
from turning_nc.sweep import Removed, Sweep
from turning_nc.tool_shapes import tool_shape

KINDS = ("outside", "outside-left", "inside", "copying", "neutral", "groove:3", "drill:8")


def shape_of(kind: str) -> np.ndarray:
    shape = tool_shape(kind)
    assert shape is not None
    return shape


def bar(back: float, front: float) -> shapely.Polygon:
    """Return half the section of a bar of 60 mm from one Z to another."""
    return shapely.box(back, 0.0, front, 30.0)


def random_sweeps(kind: str, count: int) -> list[Sweep]:
    """Return moves of a tool in and around a bar of 60 mm."""
    rng = np.random.default_rng(5)
    z = rng.uniform(-40.0, 3.0, count + 1)
    x = rng.uniform(15.0, 32.0, count + 1)
    points = list(zip(z.tolist(), x.tolist(), strict=True))
    shape = shape_of(kind)
    return [Sweep(shape, start, end) for start, end in itertools.pairwise(points)]


def swept(sweep: Sweep, share: float) -> shapely.Polygon:
    """Return the area of a tool up to a share of its move."""
    place = np.array(sweep.start) + share * sweep.length * sweep.along
    corners = np.concatenate((sweep.shape + sweep.start, sweep.shape + place))
    return shapely.MultiPoint(corners).convex_hull


@pytest.mark.parametrize("kind", KINDS)
def test_a_sweep_removes_at_every_place_what_lies_in_the_area_up_to_there(kind: str) -> None:
    hole = shapely.Point(-20.0, 25.0).buffer(3.0)
    stock = shapely.box(-50.0, 5.0, 1.0, 30.0).difference(hole)
    num_cuts = 0
    for sweep in random_sweeps(kind, 12):
        metal = shapely.intersection(stock, sweep.area)
        if metal.area < 0.1:
            continue
        num_cuts += 1
        shares = np.array([0.0, 0.2, 0.5, 0.93, 1.0])
        areas = []
        moments = []
        for share in shares:
            part = shapely.intersection(metal, swept(sweep, share))
            areas.append(part.area)
            # An empty polygon has no centroid.
            moments.append(part.area * part.centroid.y if part.area else 0.0)
        removed = Removed(sweep, np.array([metal]))
        distances = sweep.length * shares
        assert removed.areas(distances) == pytest.approx(areas, abs=1e-8)
        assert removed.moments(distances) == pytest.approx(moments, abs=1e-6)
    assert num_cuts > 5


def test_the_step_at_which_a_sweep_has_removed_an_area_is_the_first_that_removes_more() -> None:
    sweep = Sweep(shape_of("groove:3"), (-10.0, 32.0), (-10.0, 20.0))
    metal = shapely.intersection(bar(-50.0, 0.0), sweep.area)
    # The tool removes 3 mm2 with every mm, from 2 mm on.
    removed = Removed(sweep, np.array([metal]))
    steps = removed.first_steps(np.array([0.0, 1.5, 29.0, 31.0]), step=0.01, count=1200)
    assert steps.tolist() == [201, 251, 1167, 1200]


def test_metal_in_pieces_is_the_polygon_that_all_cuts_leave() -> None:
    whole = bar(-50.0, 1.0)
    metal = Metal(whole)
    for sweep in random_sweeps("copying", 40):
        places = metal.meeting(sweep.area)
        met = shapely.area(metal.within(sweep.area, places)).sum()
        assert met == pytest.approx(whole.intersection(sweep.area).area)
        metal.take(sweep.area, places)
        whole = whole.difference(sweep.area)
    assert metal.polygon().symmetric_difference(whole).area < 1e-6


@pytest.mark.slow
def test_a_cut_meets_few_vertices_however_many_cuts_there_were() -> None:
    metal = Metal(bar(-50.0, 0.0))
    shape = shape_of("outside")
    # Each pass of 0.01 mm leaves a ridge at the shoulder.
    for number in range(2000):
        radius = 30.0 - 0.01 * number
        area = Sweep(shape, (2.0, radius), (-40.0, radius)).area
        places = metal.meeting(area)
        num_met = shapely.get_num_coordinates(metal.within(area, places)).sum()
        assert num_met <= 4 * MAX_VERTICES
        metal.take(area, places)
    assert shapely.get_num_coordinates(metal.pieces).max() <= MAX_VERTICES
    assert shapely.get_num_coordinates(metal.polygon()) > 2000


def toothed_bar(teeth: int) -> shapely.Polygon:
    """Return half the section of a bar of 60 mm with fine teeth along it."""
    z = np.linspace(-50.0, 0.0, 2 * teeth + 1)
    radius = np.where(np.arange(len(z)) % 2, 29.9, 30.0)
    edge = list(zip(z.tolist(), radius.tolist(), strict=True))
    return shapely.Polygon([(-50.0, 0.0), *edge, (0.0, 0.0)])


def test_pieces_that_lost_their_vertices_are_joined_again() -> None:
    whole = toothed_bar(1500)
    metal = Metal(whole)
    shape = shape_of("outside-left")
    assert len(metal.pieces) > 40
    for number in range(6):
        radius = 29.5 - 0.1 * number
        area = Sweep(shape, (2.0, radius), (-60.0, radius)).area
        metal.take(area, metal.meeting(area))
        whole = whole.difference(area)
    assert len(metal.pieces) < 6
    assert metal.polygon().symmetric_difference(whole).area < 1e-6


def test_overlaps_with_many_vertices_are_those_of_the_whole_polygons() -> None:
    whole = toothed_bar(1500).difference(shapely.box(-30.0, 5.0, -20.0, 29.0))
    areas = [sweep.area for sweep in random_sweeps("copying", 40)]
    # The last lies inside the bar.
    areas.append(shapely.box(-9.0, 3.0, -8.0, 4.0))
    expected = shapely.area(shapely.intersection(np.array(areas), whole))
    assert overlaps(np.array(areas), whole) == pytest.approx(expected, abs=1e-9)
