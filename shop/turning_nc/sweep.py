"""A convex tool that moves along a straight line through metal: how much it has removed so far.

Let ``s`` be the distance after which the tool's front reaches a point of the metal, and ``c`` the
point's distance across the line. In these coordinates the metal keeps its area, and the tool has
removed, after a distance, the part with a lower ``s``. Area and first moment of that part are
integrals along the metal's boundary (Green's theorem). They are exact, because the boundary and
the tool's front consist of straight lines.

This module knows one move; ``removal`` runs the moves of a program.
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

# Distance [mm] below which two corners of a tool stand behind each other, or both ends of an edge
# are level.
SAME = 1e-9
PROBES = 24  # places that a round of a search tries at once


class Sweep:
    """A convex tool that moves along a straight line."""

    def __init__(self, shape: Values, start: Point, end: Point) -> None:
        """Sweep a shape from one place of its tip to another.

        Args:
            shape: corners relative to the tip, Z and radius [mm], shape (corners, 2).
            start: first place of the tip [mm].
            end: last place of the tip [mm]; it is not the first one.
        """
        self.shape = shape
        self.start = start
        self.length = math.dist(start, end)
        dz = (end[0] - start[0]) / self.length
        dx = (end[1] - start[1]) / self.length
        self.along = np.array((dz, dx))
        self.across = np.array((-dx, dz))

        # The tool is convex, so the swept area is the hull of its first and its last place.
        corners = np.concatenate((shape + start, shape + end))
        self.area = shapely.convex_hull(shapely.linestrings(corners))


class Removed:
    """Area and first moment of removed metal, by the distance along the line of a sweep."""

    def __init__(self, sweep: Sweep, metal: NDArray[Any]) -> None:
        """Take the polygons of metal within the sweep."""
        front = _front(sweep)
        edges = _edges(metal, sweep)
        inner_corners = front.across[1:-1]
        for place in inner_corners:
            edges = _divided(edges, float(place))

        # Now each edge lies in one band: before one straight piece of the front.
        middle = 0.5 * (edges.first_across + edges.last_across)
        band = np.searchsorted(inner_corners, middle)
        first_front = np.interp(edges.first_across, front.across, front.along)
        last_front = np.interp(edges.last_across, front.across, front.along)
        self._sign = edges.sign
        self._first = edges.first_along - first_front
        self._last = edges.last_along - last_front
        self._across = edges.first_across
        rise = self._last - self._first
        level = abs(rise) < SAME
        width = edges.last_across - edges.first_across
        divisor = np.where(level, 1.0, rise)
        self._slope = np.where(level, 0.0, width / divisor)

        # The front is f(c) = along + tilt * (c - across) in each band. Its integral over c goes on
        # from band to band.
        start_along = front.along[:-1]
        widths = front.across[1:] - front.across[:-1]
        heights = front.along[1:] - start_along
        tilts = heights / widths
        areas = widths * (start_along + 0.5 * heights)
        integrals = np.concatenate(([0.0], np.cumsum(areas)))
        self._band_across = front.across[band, np.newaxis]
        self._band_along = front.along[band, np.newaxis]
        self._band_tilt = tilts[band, np.newaxis]
        self._band_integral = integrals[band, np.newaxis]
        self._start_x = sweep.start[1]
        self._along_x = float(sweep.along[1])
        self._across_x = float(sweep.across[1])

    def areas(self, distances: Values) -> Values:
        """Return the area removed after each distance [mm2]."""
        part = self._below(distances)
        mean_across = 0.5 * (part.low_across + part.high_across)
        area_of_edges = mean_across * (part.high - part.low)
        return -self._sign @ area_of_edges

    def moments(self, distances: Values) -> Values:
        """Return the first moment about the axis of the area removed after each distance [mm3]."""
        part = self._below(distances)
        middle = 0.5 * (part.low + part.high)
        middle_across = 0.5 * (part.low_across + part.high_across)
        at_middle = self._moment_density(middle, middle_across)
        at_low = self._moment_density(part.low, part.low_across)
        at_high = self._moment_density(part.high, part.high_across)

        # Simpson's rule is exact for cubics, and the density is a square along a straight edge.
        mean = (at_low + at_high + 4.0 * at_middle) / 6.0
        moment_of_edges = mean * (part.high - part.low)
        return -self._sign @ moment_of_edges

    def first_steps(self, areas: Values, step: float, count: int) -> NDArray[np.int64]:
        """Return the first step along the line after which more than each area is removed.

        Args:
            areas: areas to exceed [mm2].
            step: length of a step [mm].
            count: number of steps; it is returned where no step exceeds the area.
        """
        rows = np.arange(len(areas))
        low = np.zeros(len(areas), np.int64)
        high = np.full(len(areas), count)
        shares = np.arange(1.0, PROBES + 1.0) / (PROBES + 1.0)

        # The removed area only grows, so each round divides the range in which a step is sought.
        # Many probes at once need few calls of NumPy.
        while (low < high).any():
            ranges = (high - low)[:, np.newaxis]
            offsets = (ranges * shares).astype(np.int64)
            probes = low[:, np.newaxis] + offsets
            distances = step * probes.ravel().astype(np.float64)
            removed = self.areas(distances).reshape(probes.shape)
            is_below = removed <= areas[:, np.newaxis]
            below = is_below.sum(axis=1)  # probes before the step
            first_beyond = probes[rows, np.minimum(below, PROBES - 1)]
            last_below = probes[rows, below - 1]
            high = np.where(below < PROBES, first_beyond, high)
            after_last = np.minimum(last_below + 1, high)
            low = np.where(below > 0, after_last, low)
        return low

    def _below(self, distances: Values) -> "_Below":
        """Return the part of every edge (rows) below each distance (columns)."""
        first = self._first[:, np.newaxis]
        last = self._last[:, np.newaxis]
        across = self._across[:, np.newaxis]
        slope = self._slope[:, np.newaxis]
        low = np.minimum(first, distances)
        high = np.minimum(last, distances)
        low_across = across + slope * (low - first)
        high_across = across + slope * (high - first)
        return _Below(low, high, low_across=low_across, high_across=high_across)

    def _moment_density(self, s: Values, c: Values) -> Values:
        """Return the integral of the radius over c, from 0 to c, at s.

        The radius at (s, c) is ``start_x + along_x * (s + front(c)) + across_x * c``.
        """
        beside = c - self._band_across
        mean_front = self._band_along + 0.5 * self._band_tilt * beside
        front = self._band_integral + beside * mean_front
        at_start = (self._start_x + self._along_x * s) * c
        return at_start + self._along_x * front + 0.5 * self._across_x * c * c


class _Below(NamedTuple):
    """The part of edges below some distances: s and c of both ends."""

    low: Values
    high: Values
    low_across: Values
    high_across: Values


class _Front(NamedTuple):
    """Corners of the front of a tool: places along its line over places across."""

    across: Values
    along: Values


class _Edges(NamedTuple):
    """Edges of polygons, by their places along and across a line."""

    first_along: Values
    first_across: Values
    last_along: Values
    last_across: Values
    sign: Values  # 1 if the metal lies to the left of the edge, otherwise -1


class _Corner(NamedTuple):
    """A corner of a tool, by its distances across and along a line."""

    across: float  # [mm]
    along: float  # [mm]


def _front(sweep: Sweep) -> _Front:
    """Return the corners of a tool that lead, in their order across the line.

    They are the upper convex hull of all corners (Andrew's monotone chain).
    """
    across = (sweep.shape @ sweep.across).tolist()
    along = (sweep.shape @ sweep.along).tolist()
    corners = sorted(map(_Corner, across, along))
    chain: list[_Corner] = []
    for corner in corners:
        if chain and corner.across - chain[-1].across < SAME:
            behind = chain.pop()
            farthest = max(corner.along, behind.along)
            corner = _Corner(behind.across, farthest)
        while len(chain) > 1 and _turns_left(chain[-2], chain[-1], corner):
            chain.pop()
        chain.append(corner)
    points = np.array(chain)
    return _Front(across=points[:, 0], along=points[:, 1])


def _turns_left(first: _Corner, second: _Corner, third: _Corner) -> bool:
    """Return whether the path through three corners turns left or is straight."""
    second_across = second.across - first.across
    second_along = second.along - first.along
    third_across = third.across - first.across
    third_along = third.along - first.along
    return second_across * third_along >= second_along * third_across


def _edges(metal: NDArray[Any], sweep: Sweep) -> _Edges:
    """Return the edges of polygons, in distances along the sweep and across it.

    Lines and points beside them, where metal only touches the sweep, are left out.
    """
    parts = shapely.get_parts(metal)
    has_area = shapely.get_dimensions(parts) == 2
    rings, polygon_of_ring = shapely.get_rings(parts[has_area], return_index=True)
    points, ring_of_point = shapely.get_coordinates(rings, return_index=True)
    from_start = points - sweep.start
    along = from_start @ sweep.along
    across = from_start @ sweep.across
    first_along = along[:-1]
    first_across = across[:-1]
    last_along = along[1:]
    last_across = across[1:]

    # All rings are written one after another; a step from one ring to the next is no edge.
    ring = ring_of_point[:-1]
    within = ring == ring_of_point[1:]

    # The first ring of a polygon is its outside. It may be written in either sense.
    crosses = last_across * first_along - first_across * last_along
    areas = np.bincount(ring[within], crosses[within], minlength=len(rings))
    turns_left = areas > 0.0
    is_outside = np.ones(len(rings), np.bool_)
    is_outside[1:] = polygon_of_ring[1:] != polygon_of_ring[:-1]
    sign = np.where(turns_left == is_outside, 1.0, -1.0)
    return _Edges(
        first_along=first_along[within],
        first_across=first_across[within],
        last_along=last_along[within],
        last_across=last_across[within],
        sign=sign[ring[within]],
    )


def _divided(edges: _Edges, place: float) -> _Edges:
    """Return edges that end at a place across the line where they cross it."""
    begins_below = edges.first_across < place
    ends_below = edges.last_across < place
    crossing = np.flatnonzero(begins_below != ends_below)
    if not len(crossing):
        return edges
    whole = _Edges(*(values[crossing] for values in edges))
    share = (place - whole.first_across) / (whole.last_across - whole.first_across)
    along = whole.first_along + share * (whole.last_along - whole.first_along)
    across = np.full(len(crossing), place)

    # The first part of an edge replaces it, and its rest is put behind all edges.
    shortened_along = edges.last_along.copy()
    shortened_across = edges.last_across.copy()
    shortened_along[crossing] = along
    shortened_across[crossing] = across
    return _Edges(
        first_along=np.concatenate((edges.first_along, along)),
        first_across=np.concatenate((edges.first_across, across)),
        last_along=np.concatenate((shortened_along, whole.last_along)),
        last_across=np.concatenate((shortened_across, whole.last_across)),
        sign=np.concatenate((edges.sign, whole.sign)),
    )
