"""Marks of cuts on a map, and the texts beside them, which cover no other text or mark.

A text is placed once the layout is final, since only then its size is known on the map.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox
from numpy.typing import NDArray
from turning_shop.allowed import theoretical_roughness
from turning_shop.units import Units, short
from turning_shop.whatif import Cuts

from turning_env.rendering.plot_style import GREY

DISTANCES = (-30.0, 12.0, 30.0, 60.0, 110.0)  # of a text from its mark, across or up [pt]
# What a crossed area and a distance of 1 pt count as much as, in covered area [pixels squared].
CROSSING = 5000.0
NEARNESS = 10.0
PADDING = 5.0  # around a text, which its frame covers [pixels at 100 dpi]
MARK_SIZE = 9.0  # [pt]
MIN_LINE = 20.0  # length of a line from a mark to its text, below which there is none [pt]


class Look(NamedTuple):
    """The look of a mark."""

    label: str
    marker: str
    face: str


ADVISED = Look("advised, least cost", "o", "black")
HIGHEST = Look("highest removal rate within the limits", "D", "white")
BOTH = Look(f"{ADVISED.label}, and {HIGHEST.label}", "D", "black")
SAME_CUT = 1e-3  # relative difference of speed or feed, up to which two marks are one [-]


class CutMark(NamedTuple):
    """A cut to mark."""

    look: Look
    cut: Cuts
    star: str  # " *" if the cut extrapolates


class Place(NamedTuple):
    """A place of a text beside its mark."""

    x: float  # offset [pt]
    y: float  # offset [pt]
    horizontal: Literal["left", "right"]  # end of the text that is there
    vertical: Literal["top", "bottom"]


class Callout(NamedTuple):
    """A text beside a mark."""

    axes: Axes
    text: Annotation
    mark: Line2D


def draw_marks(
    axes: Axes, marks: Sequence[CutMark], nose_radius: float, units: Units
) -> list[Callout]:
    """Draw marks with their texts, and return what ``place`` puts right.

    ``nose_radius`` [mm] gives the roughness, 0 if it is unknown; axes and texts are in ``units``.
    """
    callouts = []
    for look, cut, star in marks:
        speed = float(cut.cutting_speed)
        feed = float(cut.feed)
        point = (units.unit("m/min").factor * speed, units.unit("mm/rev").factor * feed)
        (line,) = axes.plot(
            *point,
            marker=look.marker,
            markersize=MARK_SIZE,
            markerfacecolor=look.face,
            color="black",
            linestyle="none",
            clip_on=False,
            zorder=5,
        )
        tool_life = short(float(cut.tool_life))
        settings = f"{speed:.0f} m/min, {feed:.3g} mm/rev"
        results = f"{cut.removal_rate:.0f} cm3/min, tool life {tool_life} min{star}"
        if nose_radius:
            results += f"\nRt {theoretical_roughness(feed, nose_radius):.0f} um"
        results = units.text(results).replace("3/min", "³/min").replace(" um", " µm")
        text = axes.annotate(
            f"{units.text(settings)}:\n{results}",
            point,
            xytext=(0, 0),
            textcoords="offset points",
            bbox={"boxstyle": "round", "facecolor": "white", "edgecolor": GREY, "alpha": 0.95},
            zorder=6,
        )
        callouts.append(Callout(axes, text, line))
    return callouts


def handles(marks: Sequence[CutMark]) -> list[Line2D]:
    """Return the legend handles of marks."""
    lines = []
    for look, _, _ in marks:
        lines.append(
            Line2D(
                [],
                [],
                color="black",
                marker=look.marker,
                markerfacecolor=look.face,
                linestyle="none",
                label=look.label,
            )
        )
    return lines


def place(figure: Figure, callouts: Sequence[Callout]) -> None:
    """Move the texts of callouts to where they cover no label, mark or other callout.

    Labels of lines that an edge of the map would cut off move inside.
    """
    figure.draw_without_rendering()
    for axes in {callout.axes for callout in callouts}:
        callouts_here = [callout for callout in callouts if callout.axes is axes]
        movable = [callout.text for callout in callouts_here]
        taken = []
        for text in axes.texts:
            if text not in movable:
                _move_inside(text, axes.get_window_extent())
                taken.append(text.get_window_extent())
        for callout in callouts_here:
            taken.append(_extent(callout.mark))
        for callout in callouts_here:
            area = _placed(callout, taken)
            taken.append(area)


def _move_inside(text: Text, within: Bbox) -> None:
    """Move the label of a line to where no edge of the map cuts it off."""
    area = text.get_window_extent()
    below = np.maximum(np.asarray(within.min) - area.min, 0.0)
    above = np.maximum(np.asarray(area.max) - within.max, 0.0)
    transform = text.get_transform()
    place = transform.transform(text.get_position()) + below - above
    x, y = transform.inverted().transform(place)
    text.set_position((float(x), float(y)))


def _dpi(mark: Line2D) -> float:
    """Return the resolution of the figure that a mark is drawn on [pixels/inch]."""
    figure = mark.get_figure(root=True)
    assert figure is not None
    return float(figure.dpi)


def _extent(mark: Line2D) -> Bbox:
    """Return the area of a mark on the page [pixels]."""
    centre = mark.get_transform().transform(mark.get_xydata())[0]
    half = 0.5 * MARK_SIZE * _dpi(mark) / 72.0
    return Bbox([centre - half, centre + half])


def _placed(callout: Callout, taken: Sequence[Bbox]) -> Bbox:
    """Move a text to the place that disturbs least, and return the area that it takes."""
    within = callout.axes.get_window_extent()
    best = Place(0.0, 0.0, "left", "bottom")
    least = math.inf
    for place in _places(callout, within):
        area = _put(callout, place)
        beyond = area.width * area.height - _common(area, within)
        covered = beyond + sum(_common(area, other) for other in taken)
        crossed = sum(_crosses(callout, area, other) for other in taken)
        distance = math.hypot(place.x, place.y)
        disturbance = covered + CROSSING * crossed + NEARNESS * distance
        if disturbance < least:
            least = disturbance
            best = place
    area = _put(callout, best)
    _draw_line(callout, area)
    return area


def _draw_line(callout: Callout, area: Bbox) -> None:
    """Draw the line from a mark to its text, if they are apart."""
    start, end = _line(callout, area)
    points = (end - start) * 72.0 / _dpi(callout.mark)
    if math.hypot(*points) > MIN_LINE:
        callout.axes.annotate(
            "",
            callout.text.xy,
            xytext=tuple(points),
            textcoords="offset points",
            arrowprops={"arrowstyle": "-", "color": GREY, "shrinkA": 0.0, "shrinkB": 0.0},
            annotation_clip=False,
        )


def _line(callout: Callout, area: Bbox) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centre of a mark, and the nearest point of the area of its text [pixels]."""
    mark = _extent(callout.mark)
    lowest = np.asarray(mark.min)
    highest = np.asarray(mark.max)
    centre = 0.5 * (lowest + highest)
    nearest = np.clip(centre, area.min, area.max)
    return centre, nearest


def _crosses(callout: Callout, area: Bbox, taken: Bbox) -> bool:
    """Return whether the line from a mark to its text runs through an area that is taken."""
    start, end = _line(callout, area)
    if taken.contains(*start):
        return False  # the mark itself
    return bool(Path([start, end]).intersects_bbox(taken, filled=False))


def _places(callout: Callout, within: Bbox) -> Iterator[Place]:
    """Yield the places of a text that are tried, the likeliest first.

    A text extends from the mark towards the middle of the map, if there is room.
    """
    x, y = _extent(callout.mark).min
    middle_x = 0.5 * (within.x0 + within.x1)
    middle_y = 0.5 * (within.y0 + within.y1)
    sides = (-1.0, 1.0) if x > middle_x else (1.0, -1.0)
    heights = (-1.0, 1.0) if y > middle_y else (1.0, -1.0)
    for across, up, side, height in itertools.product(DISTANCES, DISTANCES, sides, heights):
        yield Place(
            x=side * across,
            y=height * up,
            horizontal="right" if side < 0 else "left",
            vertical="top" if height < 0 else "bottom",
        )


def _put(callout: Callout, place: Place) -> Bbox:
    """Move a text, and return the area that it takes with its frame [pixels]."""
    callout.text.xyann = (place.x, place.y)
    callout.text.set_horizontalalignment(place.horizontal)
    callout.text.set_verticalalignment(place.vertical)
    # That of the text alone, without the line to its mark.
    return Text.get_window_extent(callout.text).padded(PADDING)


def _common(area: Bbox, other: Bbox) -> float:
    """Return the size of what two areas have in common [pixels squared]."""
    both = Bbox.intersection(area, other)
    return float(both.width * both.height) if both is not None else 0.0
