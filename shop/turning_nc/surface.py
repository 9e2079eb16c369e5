"""Which cuts leave the surface of the finished part.

A cut leaves a surface on both sides of its sweep: along its tip, and along the corner of the tool
farthest from it. Where such a line lies on the boundary of the part after the last move, nothing
has cut deeper since, so that this feed makes the roughness there. The front of a tool leaves a
surface, too, where a cut ends; but its feed does not make it.
"""

from typing import Any

import numpy as np
from turning_nc.metal import lengths_within
from turning_shop import Values

from turning_env.extras import needed

with needed():
    import shapely

TOLERANCE = 1e-3  # distance of a line from the boundary that counts as none [mm]


def final_surface(shape: Values, starts: Values, ends: Values, part: Any) -> Values:
    """Return the length of the part's surface that straight cuts of a tool leave [mm].

    Args:
        shape: corners of the tool relative to its tip, Z and radius [mm], shape (corners, 2).
        starts: Z and radius of the tip at the starts of the cuts [mm], shape (cuts, 2).
        ends: the same at their ends.
        part: polygon of the part after the last move.
    """
    steps = ends - starts
    across = np.stack((-steps[:, 1], steps[:, 0]), axis=1)
    places = across @ shape.T  # of each corner across each cut
    edge = shapely.buffer(shapely.boundary(part), TOLERANCE)
    lengths = np.zeros(len(starts))
    for corner in (places.argmin(axis=1), places.argmax(axis=1)):
        offset = shape[corner]
        ends_of_lines = np.stack((starts + offset, ends + offset), axis=1)
        lengths += lengths_within(shapely.linestrings(ends_of_lines), edge)
    return lengths
