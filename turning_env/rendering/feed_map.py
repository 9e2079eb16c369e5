"""The operating map where the feed alone is set: the feed along the bar, and what limits leave of it there."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from turning_env.rendering.lane import Lane
from turning_env.rendering.limits import highest_feed
from turning_env.rendering.ruler import Ruler, page_of
from turning_env.rendering.theme import (
    ALLOWED,
    CARD,
    FAINT,
    FORCE,
    INK,
    POWER,
    QUIET,
    RULE,
    SCALE,
    SURFACE,
    Box,
    Colour,
    Pixels,
    length,
    mixed,
    put,
    round_ticks,
    write,
)
from turning_env.scenario import Scenario

_STEPS = 150
"""Places at which the limits are asked."""


class FeedMap:
    """Draws the map of a scenario whose controller sets a feed override, at a fixed cutting speed."""

    def __init__(self, scenario: Scenario, box: Box) -> None:
        self._scenario = scenario
        self._box = (box[0] + 58, box[1] + 34, box[2] - 48, box[3] - 62)
        left, top, right, bottom = self._box
        control = scenario.control
        self._width = SCALE * (right - left)
        self._up = Ruler(0.0, control.override_max * control.initial_feed, SCALE * (bottom - top) - 1.0, 0.0)
        self._holds_roughness = control.aim == "roughness"
        self._shown: Any = None
        self._course_number = -1
        self._trail: list[tuple[float, float]] = []

    def draw_axes(self, image: Image.Image, box: Box) -> None:
        """Scales, titles and the key."""
        left, top, right, bottom = self._box
        draw, limits = ImageDraw.Draw(image), self._scenario.limits
        write(image, (box[0] + 12, box[1] + 8), "operating map", 15)
        write(image, (left - 46, top - 3), "mm/rev", 11, QUIET)
        speed = self._scenario.control.initial_cutting_speed
        write(image, (right, box[1] + 11), f"feed along the bar, at {speed:.0f} m/min", 11, FAINT, "right")
        programmed = self._scenario.control.initial_feed
        for tick in round_ticks(0.0, self._up.end, 7):
            y = top + self._up(tick) / SCALE
            if y > top + 10:
                write(image, (left - 8, y - 8), f"{tick:g}", 11, QUIET, "right")
                draw.line((left - 4, y, left, y), fill=FAINT)
        for tick in round_ticks(0.0, self._up.end / programmed, 6):
            y = top + self._up(tick * programmed) / SCALE
            draw.line((right, y, right + 4, y), fill=FAINT)
            write(image, (right + 7, y - 8), f"{100 * tick:.0f} %", 11, QUIET)
        entries: list[tuple[str, Colour, int]] = [
            ("allowed", mixed(ALLOWED, 0.3), 11),
            (f"{limits.power:g} kW", POWER, 3),
            (f"{limits.thrust_force:g} N", FORCE, 3),
        ]
        if self._holds_roughness:
            entries = [*entries[:1], ("gives the reference", SURFACE, 3)]
        entries += [("feed", INK, 3), ("programmed (100 %)", FAINT, 1)]
        x, y = left - 46, bottom + 39
        for text, colour, height in entries:
            draw.rectangle((x, y + 8 - height // 2, x + 15, y + 8 - height // 2 + height - 1), fill=colour)
            write(image, (x + 20, y), text, 11, QUIET)
            x += 20 + round(length(text, 11)) + 13
        draw.rectangle((left - 1, top - 1, right, bottom), outline=FAINT)

    def draw(self, frame: Pixels, lane: Lane) -> None:
        """What is allowed along the bar with the edge as it is now, and the feed so far."""
        start, end = page_of(self._scenario, lane.along)
        across = Ruler(start, end, 0.0, self._width - 1.0)
        shown = (lane.key, lane.bar, start)
        if shown != self._shown:
            self._shown = shown
            self._look_along(lane, across)
            self._write_places(frame, start, end)
        height = round(self._up.first) + 1
        image = Image.new("RGB", (self._width, height), CARD)
        draw = ImageDraw.Draw(image)
        curves = self._curves(lane)
        allowed = np.minimum.reduce([np.full(len(self._xs), self._up.end), *(feeds for _, feeds in curves)])
        outline = self._pixels(allowed)
        draw.polygon([(outline[0][0], height), *outline, (outline[-1][0], height)], fill=mixed(ALLOWED, 0.22))
        programmed = self._up(self._scenario.control.initial_feed)
        draw.line((0, programmed, self._width, programmed), fill=FAINT, width=2)
        if self._holds_roughness:
            curves = [(SURFACE, self._held_feed(lane))]
        for colour, feeds in curves:
            draw.line(self._pixels(np.minimum(feeds, 1.05 * self._up.end)), fill=colour, width=4)
        self._draw_trail(draw, lane, across)
        put(frame, image.reduce(SCALE), (self._box[0], self._box[1]))

    def _look_along(self, lane: Lane, across: Ruler) -> None:
        step = (across.end - across.start) / _STEPS
        places = across.start + step * (np.arange(_STEPS) + 0.5)
        places = places[(places > 0.0) & (places < self._scenario.workpiece.bar_length)]
        self._hardness, self._depth = lane.fields.along(lane.key, lane.bar, np.ascontiguousarray(places))
        self._xs = [across(place) for place in places.tolist()]

    def _curves(self, lane: Lane) -> list[tuple[Colour, NDArray[np.float64]]]:
        """The feed [mm/rev] at which each limit is reached, of those that can be."""
        material, limits, speed = self._scenario.material, self._scenario.limits, lane.now["cutting_speed"]
        laws = ((POWER, material.power, limits.power), (FORCE, material.thrust_force, limits.thrust_force))
        return [(colour, highest_feed(law, most, speed, self._depth, self._hardness, lane.wear)) for colour, law, most in laws]

    def _held_feed(self, lane: Lane) -> NDArray[np.float64]:
        """The feed [mm/rev] that leaves the reference of roughness."""
        surface = self._scenario.surface
        force = math.log(lane.now["roughness_reference"] / surface.roughness_at_no_force) / surface.roughness_rate
        law, speed = self._scenario.material.thrust_force, lane.now["cutting_speed"]
        return highest_feed(law, force, speed, self._depth, self._hardness, lane.wear)

    def _pixels(self, feeds: NDArray[np.float64]) -> list[tuple[float, float]]:
        return list(zip(self._xs, map(self._up, feeds.tolist()), strict=True))

    def _draw_trail(self, draw: ImageDraw.ImageDraw, lane: Lane, across: Ruler) -> None:
        if lane.course_number != self._course_number:
            self._course_number, self._taken, self._trail = lane.course_number, 0, []
        self._trail += _thinned(lane.course[self._taken :], across, self._up, self._trail)
        self._taken = len(lane.course)
        x, y = across.within(lane.along), self._up.within(lane.now["feed"])
        if self._trail:
            draw.line([*self._trail, (x, y)], fill=INK, width=4)
        draw.ellipse((x - 9, y - 9, x + 9, y + 9), fill=INK, outline=CARD, width=2)

    def _write_places(self, frame: Pixels, start: float, end: float) -> None:
        left, _, right, bottom = self._box
        self._course_number = -1  # the trail begins anew where the page does
        below = Image.new("RGB", (right - left + 30, 34), CARD)
        across = Ruler(start, end, 15, right - left + 15)
        for tick in round_ticks(max(start, 0.0), end, 7):
            ImageDraw.Draw(below).line((across(tick), 1, across(tick), 4), fill=FAINT)
            write(below, (across(tick), 4), f"{tick:g}", 11, QUIET, "middle")
        ImageDraw.Draw(below).line((14, 0, right - left + 15, 0), fill=RULE)
        write(below, (below.width / 2, 18), "place along the bar [mm]", 11, QUIET, "middle")
        put(frame, below, (left - 15, bottom))


def _thinned(
    course: Sequence[tuple[float, ...]], across: Ruler, up: Ruler, before: list[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Points of a course that are far enough apart to be seen, or differ; none from before the page."""
    points: list[tuple[float, float]] = []
    last = before[-1] if before else None
    for place, *_, feed, _ in course:
        if place < across.start:
            continue
        point = across.within(place), up.within(feed)
        if last is None or abs(point[0] - last[0]) + abs(point[1] - last[1]) >= 3.0:
            points.append(point)
            last = point
    return points
