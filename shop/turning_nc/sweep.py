"""A convex tool that moves along a straight line through metal: how much it has removed at each place of the line.

Let ``s`` be the distance after which the tool's front reaches a point of the metal, and ``c`` the point's distance across the
line. In these coordinates the metal keeps its area, and what the tool has removed after a distance is the part with a lower
``s``. Area and first moment of that part are integrals along the metal's boundary (Green's theorem). They are exact, because the
boundary and the tool's front consist of straight lines.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_nc.paths import Point
from turning_shop import Values

from turning_env.extras import needed

with needed():
    import shapely


SAME = 1e-9  # distance below which two corners of a tool stand behind each other, or two ends of an edge are level [mm]
_PROBES = 24  # places that a round of a search tries at once


class Sweep:
    """A convex tool that moves along a straight line."""

    def __init__(self, shape: Values, start: Point, end: Point) -> None:
        """Sweep a shape, given by its corners relative to its tip, from one place of the tip to another."""
        self.shape, self.start = shape, start
        self.length = math.dist(start, end)
        dz, dx = (end[0] - start[0]) / self.length, (end[1] - start[1]) / self.length
        self.along = np.array((dz, dx))
        self.across = np.array((-dx, dz))
        corners = np.concatenate((shape + start, shape + end))
        self.area = shapely.convex_hull(shapely.linestrings(corners))


class Removed:
    """Area and first moment of the metal that a sweep has removed, by the distance along its line."""

    def __init__(self, sweep: Sweep, metal: NDArray[Any]) -> None:
        """Take the polygons of metal within the sweep."""
        front = _front(sweep)
        edges = _edges(metal, sweep)
        for place in front.across[1:-1]:
            edges = _divided(edges, float(place))
        band = np.searchsorted(front.across[1:-1], 0.5 * (edges.first_across + edges.last_across))
        self._sign = edges.sign
        self._first = edges.first_along - np.interp(edges.first_across, front.across, front.along)
        self._last = edges.last_along - np.interp(edges.last_across, front.across, front.along)
        self._across = edges.first_across
        rise = self._last - self._first
        level = abs(rise) < SAME
        self._slope = np.where(
            level, 0.0, (edges.last_across - edges.first_across) / np.where(level, 1.0, rise)
        )

        # The front is f(c) = along + tilt * (c - across) in each band, and its integral over c continues from band to band.
        widths, heights = front.across[1:] - front.across[:-1], front.along[1:] - front.along[:-1]
        tilts = heights / widths
        integrals = np.concatenate(([0.0], np.cumsum(widths * (front.along[:-1] + 0.5 * heights))))
        self._band_across, self._band_along = (
            front.across[band, np.newaxis],
            front.along[band, np.newaxis],
        )
        self._band_tilt, self._band_integral = tilts[band, np.newaxis], integrals[band, np.newaxis]
        self._start_x = sweep.start[1]
        self._along_x, self._across_x = float(sweep.along[1]), float(sweep.across[1])

    def areas(self, distances: Values) -> Values:
        """Return the area removed after each distance [mm2]."""
        low, high, first, last = self._below(distances)
        return -self._sign @ (0.5 * (first + last) * (high - low))

    def moments(self, distances: Values) -> Values:
        """Return the first moment about the axis of the area removed after each distance [mm3]."""
        low, high, first, last = self._below(distances)
        middle = self._moment_density(0.5 * (low + high), 0.5 * (first + last))
        ends = self._moment_density(low, first) + self._moment_density(high, last)
        return -self._sign @ (
            (ends + 4.0 * middle) / 6.0 * (high - low)
        )  # Simpson's rule, exact for cubics

    def _below(self, distances: Values) -> tuple[Values, Values, Values, Values]:
        """Return the part of every edge (rows) below each distance (columns): s at its ends, then c at its ends."""
        first, last = self._first[:, np.newaxis], self._last[:, np.newaxis]
        across, slope = self._across[:, np.newaxis], self._slope[:, np.newaxis]
        low, high = np.minimum(first, distances), np.minimum(last, distances)
        return low, high, across + slope * (low - first), across + slope * (high - first)

    def _moment_density(self, s: Values, c: Values) -> Values:
        """Return the integral over c, from 0, of the radius at (s, c): start + along * (s + front) + across * c."""
        beside = c - self._band_across
        front = self._band_integral + beside * (self._band_along + 0.5 * self._band_tilt * beside)
        return (
            (self._start_x + self._along_x * s) * c
            + self._along_x * front
            + 0.5 * self._across_x * c * c
        )

    def first_steps(self, areas: Values, step: float, count: int) -> NDArray[np.int64]:
        """Return the first of ``count`` steps along the line after which more than each area is removed; ``count`` if none is."""
        low, high = np.zeros(len(areas), np.int64), np.full(len(areas), count)
        shares = np.arange(1.0, _PROBES + 1.0) / (_PROBES + 1.0)
        rows = np.arange(len(areas))
        while (low < high).any():
            probes = low[:, np.newaxis] + ((high - low)[:, np.newaxis] * shares).astype(np.int64)
            removed = self.areas(step * probes.ravel().astype(np.float64)).reshape(probes.shape)
            below = (removed <= areas[:, np.newaxis]).sum(axis=1)  # probes up to the one sought
            first_beyond = probes[rows, np.minimum(below, _PROBES - 1)]
            high = np.where(below < _PROBES, first_beyond, high)
            low = np.where(below > 0, np.minimum(probes[rows, below - 1] + 1, high), low)
        return low


class _Front(NamedTuple):
    """The front of a tool: places along its line over places across, at its corners."""

    across: Values
    along: Values


class _Edges(NamedTuple):
    """Edges of polygons, by their places along and across a line."""

    first_along: Values
    first_across: Values
    last_along: Values
    last_across: Values
    sign: Values  # 1 if the metal lies to the left of the edge, otherwise -1


def _front(sweep: Sweep) -> _Front:
    """Return the corners of a tool that lead, in their order across the line: the upper convex hull."""
    across, along = sweep.shape @ sweep.across, sweep.shape @ sweep.along
    corners = sorted(zip(across.tolist(), along.tolist(), strict=True))
    chain: list[Point] = []
    for corner in corners:
        if chain and corner[0] - chain[-1][0] < SAME:
            corner = (chain[-1][0], max(corner[1], chain[-1][1]))
            chain.pop()
        while len(chain) > 1 and _turns_left(chain[-2], chain[-1], corner):
            chain.pop()
        chain.append(corner)
    points = np.array(chain)
    return _Front(points[:, 0], points[:, 1])


def _turns_left(first: Point, second: Point, third: Point) -> bool:
    ahead = (second[0] - first[0]) * (third[1] - first[1])
    return ahead >= (second[1] - first[1]) * (third[0] - first[0])


def _edges(metal: NDArray[Any], sweep: Sweep) -> _Edges:
    """Return the edges of polygons; lines and points beside them, where metal only touches the sweep, are left out."""
    parts = shapely.get_parts(metal)
    polygons = parts[shapely.get_dimensions(parts) == 2]
    rings, polygon_of_ring = shapely.get_rings(polygons, return_index=True)
    points, ring_of_point = shapely.get_coordinates(rings, return_index=True)
    ring = ring_of_point[:-1]
    within = ring == ring_of_point[1:]
    along, across = (points - sweep.start) @ sweep.along, (points - sweep.start) @ sweep.across

    # The first ring of a polygon is its outside. It may be written in either sense.
    crosses = across[1:] * along[:-1] - across[:-1] * along[1:]
    turns_left = np.bincount(ring[within], crosses[within], minlength=len(rings)) > 0.0
    is_outside = np.ones(len(rings), np.bool_)
    is_outside[1:] = polygon_of_ring[1:] != polygon_of_ring[:-1]
    sign = np.where(turns_left == is_outside, 1.0, -1.0)
    return _Edges(
        along[:-1][within],
        across[:-1][within],
        along[1:][within],
        across[1:][within],
        sign[ring[within]],
    )


def _divided(edges: _Edges, place: float) -> _Edges:
    """Return edges that end at a place across the line where they cross it."""
    crosses = np.flatnonzero((edges.first_across < place) != (edges.last_across < place))
    if not len(crosses):
        return edges
    first_along, first_across, last_along, last_across, sign = (values[crosses] for values in edges)
    share = (place - first_across) / (last_across - first_across)
    along, across = first_along + share * (last_along - first_along), np.full(len(crosses), place)
    shortened = edges._replace(
        last_along=edges.last_along.copy(), last_across=edges.last_across.copy()
    )
    shortened.last_along[crosses] = along
    shortened.last_across[crosses] = across
    rest = _Edges(along, across, last_along, last_across, sign)
    return _Edges(*(np.concatenate(pair) for pair in zip(shortened, rest, strict=True)))
