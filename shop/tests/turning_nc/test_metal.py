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


def random_sweeps(kind: str, count: int) -> list[Sweep]:
    """Return moves of a tool in and around a bar of 60 mm."""
    rng = np.random.default_rng(5)
    ends = np.column_stack((rng.uniform(-40.0, 3.0, count + 1), rng.uniform(15.0, 32.0, count + 1)))
    points = [(float(z), float(x)) for z, x in ends]
    return [Sweep(shape_of(kind), start, end) for start, end in itertools.pairwise(points)]


@pytest.mark.parametrize("kind", KINDS)
def test_a_sweep_removes_at_every_place_what_lies_in_the_area_up_to_there(kind: str) -> None:
    stock = shapely.box(-50.0, 5.0, 1.0, 30.0).difference(shapely.Point(-20.0, 25.0).buffer(3.0))
    through_metal = [
        sweep for sweep in random_sweeps(kind, 12) if stock.intersection(sweep.area).area > 0.1
    ]
    assert len(through_metal) > 5
    for sweep in through_metal:
        metal = shapely.intersection(stock, sweep.area)
        removed = Removed(sweep, np.array([metal]))
        end = np.array(sweep.start) + sweep.length * sweep.along
        distances = sweep.length * np.array([0.0, 0.2, 0.5, 0.93, 1.0])
        partial = [
            shapely.intersection(metal, _area(sweep.shape, sweep.start, end, share))
            for share in distances / sweep.length
        ]
        assert removed.areas(distances) == pytest.approx([part.area for part in partial], abs=1e-8)
        moments = [part.area * part.centroid.y if part.area else 0.0 for part in partial]
        assert removed.moments(distances) == pytest.approx(moments, abs=1e-6)


def _area(
    shape: np.ndarray, start: tuple[float, float], end: np.ndarray, share: float
) -> shapely.Polygon:
    place = np.array(start) + share * (end - start)
    return shapely.MultiPoint(np.concatenate((shape + start, shape + place))).convex_hull


def test_the_step_at_which_a_sweep_has_removed_an_area_is_the_first_that_removes_more() -> None:
    sweep = Sweep(shape_of("groove:3"), (-10.0, 32.0), (-10.0, 20.0))
    metal = shapely.intersection(shapely.box(-50.0, 0.0, 0.0, 30.0), sweep.area)
    removed = Removed(sweep, np.array([metal]))  # 3 mm2 with every mm from 2 mm on
    assert removed.first_steps(np.array([0.0, 1.5, 29.0, 31.0]), 0.01, 1200).tolist() == [
        201,
        251,
        1167,
        1200,
    ]


def test_metal_in_pieces_is_the_polygon_that_all_cuts_leave() -> None:
    stock = shapely.box(-50.0, 0.0, 1.0, 30.0)
    metal, whole = Metal(stock), stock
    for sweep in random_sweeps("copying", 40):
        places = metal.meeting(sweep.area)
        assert shapely.area(metal.within(sweep.area, places)).sum() == pytest.approx(
            whole.intersection(sweep.area).area
        )
        metal.take(sweep.area, places)
        whole = whole.difference(sweep.area)
    assert metal.polygon().symmetric_difference(whole).area < 1e-6


def test_a_cut_meets_few_vertices_however_many_cuts_there_were() -> None:
    metal = Metal(shapely.box(-50.0, 0.0, 0.0, 30.0))
    shape = shape_of("outside")
    for number in range(2000):  # passes of 0.01 mm, each of which leaves a ridge at the shoulder
        radius = 30.0 - 0.01 * number
        area = Sweep(shape, (2.0, radius), (-40.0, radius)).area
        places = metal.meeting(area)
        met = shapely.get_num_coordinates(metal.within(area, places)).sum()
        assert met <= 4 * MAX_VERTICES
        metal.take(area, places)
    assert shapely.get_num_coordinates(metal.pieces).max() <= MAX_VERTICES
    assert shapely.get_num_coordinates(metal.polygon()) > 2000


def toothed_bar(teeth: int) -> shapely.Polygon:
    """Return a bar of 60 mm with fine teeth along it."""
    z = np.linspace(-50.0, 0.0, 2 * teeth + 1)
    radius = np.where(np.arange(len(z)) % 2, 29.9, 30.0)
    return shapely.Polygon(
        [(-50.0, 0.0), *zip(z.tolist(), radius.tolist(), strict=True), (0.0, 0.0)]
    )


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
    areas = np.array(
        [sweep.area for sweep in random_sweeps("copying", 40)] + [shapely.box(-9.0, 3.0, -8.0, 4.0)]
    )
    assert overlaps(areas, whole) == pytest.approx(
        shapely.area(shapely.intersection(areas, whole)), abs=1e-9
    )
