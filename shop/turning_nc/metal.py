"""Metal from which many cuts are taken, kept in small pieces.

A cut costs no more than the pieces that it meets. One polygon for the whole stock would grow by
some vertices with every pass, and each cut would copy all of them: the time of a program would grow
with the square of its moves. So a piece with many vertices is divided. Pieces that lost most of
theirs are joined again; otherwise a long cut would meet more of them the more moves had made the
contour.

This module knows polygons only; tools and moves are in ``sweep`` and ``removal``.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_shop import Values

from turning_env.extras import needed

with needed():
    import shapely

MAX_VERTICES = 64  # of a piece; above it, overlays cost more than the calls to them
MAX_SMALL = MAX_VERTICES // 4  # vertices up to which neighbours in one cut are joined
MAX_UNTESTED = 3  # pieces in the box around a cut up to which none is tested more closely
MIN_EXTENT = 1e-6  # extent of a piece below which it is not divided [mm]
FIRST_PLACES = 16  # for pieces; doubled when all are taken

# Grids on which pieces are joined [mm]. The coarse one closes the gaps that rounding leaves
# between pieces. The fine one serves between cuts, so that areas of thin cuts keep nine digits.
_GRID = 1e-9
_FINE_GRID = 1e-11
# Types of geometries as numbers: to look them up in the enumeration takes longer than a test.
_POLYGON = int(shapely.GeometryType.POLYGON)
_COLLECTION = int(shapely.GeometryType.GEOMETRYCOLLECTION)
_NOWHERE = (np.inf, np.inf, -np.inf, -np.inf)  # bounds of a place without a piece


class Metal:
    """A polygon that loses metal; its pieces lie beside each other."""

    def __init__(self, polygon: Any) -> None:
        self._pieces = np.full(FIRST_PLACES, None, dtype=object)
        # Bounds of the pieces: lowest Z and X, highest Z and X [mm].
        self._bounds = np.full((FIRST_PLACES, 4), _NOWHERE)
        self._free = list(range(FIRST_PLACES))
        polygons = np.array([polygon], dtype=object)
        self._put(polygons, shapely.get_num_coordinates(polygons))

    @property
    def pieces(self) -> NDArray[Any]:
        """Its pieces as polygons."""
        is_taken = self._bounds[:, 0] < np.inf
        return self._pieces[is_taken]

    def polygon(self) -> Any:
        """Return the metal as one polygon, or several where it falls apart."""
        pieces = self.pieces
        if len(pieces) == 1:
            return pieces[0]
        return shapely.union_all(pieces, grid_size=_GRID)

    def meeting(self, area: Any) -> NDArray[np.int64]:
        """Return the places of all pieces that a convex polygon may meet."""
        low_z, low_x, high_z, high_x = shapely.bounds(area)
        bounds = self._bounds
        beside_z = (bounds[:, 0] < high_z) & (bounds[:, 2] > low_z)
        beside_x = (bounds[:, 1] < high_x) & (bounds[:, 3] > low_x)
        places = np.flatnonzero(beside_z & beside_x)
        if len(places) <= MAX_UNTESTED:
            return places

        # A box is apart if it lies beyond one of the polygon's edges with all its corners
        # (separating axes).
        corners = shapely.get_coordinates(area)
        starts = corners[:-1]
        edges = corners[1:] - starts
        outwards = np.array((edges[:, 1], -edges[:, 0]))
        ring = shapely.get_exterior_ring(area)
        if not shapely.is_ccw(ring):
            outwards = -outwards
        edge_at = (outwards * starts.T).sum(axis=0)

        # The corner of a box that comes nearest to an edge follows from the edge's direction.
        low_corners = bounds[places, :2]
        high_corners = bounds[places, 2:]
        towards_low = np.maximum(outwards, 0.0)
        towards_high = np.minimum(outwards, 0.0)
        box_at = low_corners @ towards_low + high_corners @ towards_high
        beyond_an_edge = (box_at > edge_at).any(axis=1)
        return np.asarray(places[~beyond_an_edge])

    def within(self, area: Any, places: NDArray[np.int64]) -> NDArray[Any]:
        """Return the metal of some pieces that lies within a polygon."""
        return np.asarray(shapely.intersection(self._pieces[places], area))

    def area_within(self, low_z: float, low_x: float, high_z: float, high_x: float) -> float:
        """Return the area of the metal within a rectangle [mm2]."""
        box = shapely.box(low_z, low_x, high_z, high_x)
        metal = self.within(box, self.meeting(box))
        return float(shapely.area(metal).sum())

    def take(self, area: Any, places: NDArray[np.int64]) -> None:
        """Take the metal within a polygon away from some pieces."""
        left = shapely.difference(self._pieces[places], area)
        for place in places.tolist():
            self._bounds[place] = _NOWHERE
            self._pieces[place] = None
            self._free.append(place)
        counts = shapely.get_num_coordinates(left)
        has_metal = counts > 0
        is_small = has_metal & (counts <= MAX_SMALL)
        is_large = has_metal & ~is_small
        self._put(left[is_large], counts[is_large])
        small = list(joined_pieces(left[is_small]))
        small_counts = shapely.get_num_coordinates(small)
        self._put(np.array(small, dtype=object), small_counts)

    def _put(self, polygons: NDArray[Any], counts: NDArray[Any]) -> None:
        """Add polygons with their numbers of vertices, divided where they have too many."""
        pieces: list[Any] = []
        for polygon, count in zip(polygons, counts.tolist(), strict=True):
            if count > MAX_VERTICES:
                pieces += divided(polygon)
            else:
                pieces.append(polygon)
        for piece, bounds in zip(pieces, shapely.bounds(pieces), strict=True):
            if not self._free:
                self._grow()
            place = self._free.pop()
            self._pieces[place] = piece
            self._bounds[place] = bounds

    def _grow(self) -> None:
        count = len(self._pieces)
        more_pieces = np.full(count, None, dtype=object)
        more_bounds = np.full((count, 4), _NOWHERE)
        self._pieces = np.concatenate((self._pieces, more_pieces))
        self._bounds = np.concatenate((self._bounds, more_bounds))
        self._free = list(range(count, 2 * count))


def joined_pieces(pieces: NDArray[Any]) -> Iterator[Any]:
    """Yield small pieces, joined with their neighbours as far as they share edges.

    A joined piece has at most half of the vertices at which a piece is divided. So time is spent on
    either only after many cuts.
    """
    if len(pieces) < 2:
        yield from pieces
        return

    # Neighbours follow each other along the longer side of the box around all pieces.
    bounds = shapely.bounds(pieces)
    extents = bounds[:, 2:].max(axis=0) - bounds[:, :2].min(axis=0)
    longer_side = int(np.argmax(extents))
    order = np.argsort(bounds[:, longer_side])
    group: list[Any] = []
    count = 0
    for piece in pieces[order]:
        piece_count = int(shapely.get_num_coordinates(piece))
        if count + piece_count > MAX_VERTICES // 2:
            yield from _joined_group(group)
            group = []
            count = 0
        group.append(piece)
        count += piece_count
    yield from _joined_group(group)


def _joined_group(pieces: list[Any]) -> list[Any]:
    """Return one piece for several; these themselves if they lie apart."""
    if len(pieces) < 2:
        return pieces
    whole = shapely.union_all(pieces, grid_size=_FINE_GRID)
    is_one = shapely.get_type_id(whole) == _POLYGON
    return [whole] if is_one else pieces


def overlaps(polygons: NDArray[Any], whole: Any) -> Values:
    """Return the area of each polygon within another one that may have very many vertices.

    That one is divided first, so that no polygon is compared with more vertices than it is near.
    """
    near, common = _common(polygons, whole)
    areas = np.zeros(len(polygons))
    np.add.at(areas, near, shapely.area(common))
    return areas


def lengths_within(lines: NDArray[Any], whole: Any) -> Values:
    """Return the length of each line within a polygon; see ``overlaps``."""
    near, common = _common(lines, whole)
    lengths = np.zeros(len(lines))
    np.add.at(lengths, near, shapely.length(common))
    return lengths


class _Common(NamedTuple):
    """What geometries have in common with the pieces of a polygon."""

    number: NDArray[np.int64]  # of the geometry
    part: NDArray[Any]  # of it that is in a piece


def _common(geometries: NDArray[Any], whole: Any) -> _Common:
    """Return what geometries have in common with each piece of a polygon."""
    pieces = np.array(list(divided(whole)), dtype=object)
    near, piece = shapely.STRtree(pieces).query(geometries)
    return _Common(near, shapely.intersection(geometries[near], pieces[piece]))


def divided(polygon: Any) -> Iterator[Any]:
    """Yield a polygon, or pieces of it if it has too many vertices; nothing if it is empty."""
    if shapely.is_empty(polygon):
        return
    halves = _useful_halves(polygon)
    if not halves:
        yield polygon
    for half in halves:
        yield from divided(half)


def _useful_halves(polygon: Any) -> list[Any]:
    """Return the halves of a polygon with many vertices; none if few, or if halving does not help.

    It does not help where all vertices lie in one half, as those of a straight cut do.
    """
    count = int(shapely.get_num_coordinates(polygon))
    if count <= MAX_VERTICES:
        return []
    halves = _halves(polygon)
    if halves and max(shapely.get_num_coordinates(halves)) < count:
        return halves
    return []


def _halves(polygon: Any) -> list[Any]:
    """Return two parts of a polygon with about half of its vertices each; none if it is too small.

    The cut is across the direction in which the middle half of the vertices spreads most: ridges on
    a wall are divided along the wall, and not lengthwise.
    """
    points = shapely.get_coordinates(polygon)
    lower, middle, upper = np.percentile(points, (25.0, 50.0, 75.0), axis=0)
    axis = int(np.argmax(upper - lower))
    low = points.min(axis=0)
    high = points.max(axis=0)
    if high[axis] - low[axis] < MIN_EXTENT:
        return []
    cut = middle[axis]
    if not low[axis] < cut < high[axis]:
        cut = 0.5 * (low[axis] + high[axis])
    first_high = high.copy()
    second_low = low.copy()
    first_high[axis] = cut
    second_low[axis] = cut
    first_box = shapely.box(*low, *first_high)
    second_box = shapely.box(*second_low, *high)
    halves = shapely.intersection(polygon, [first_box, second_box])
    return [_areas_of(half) for half in halves]


def _areas_of(geometry: Any) -> Any:
    """Return a geometry without the points and lines that it may hold beside polygons."""
    kind = shapely.get_type_id(geometry)
    if kind == _POLYGON:
        return geometry
    if kind == _COLLECTION:
        parts = shapely.get_parts(geometry)
        return shapely.union_all(parts[shapely.get_dimensions(parts) == 2])
    if shapely.get_dimensions(geometry) == 2:
        return geometry
    return shapely.Polygon()
