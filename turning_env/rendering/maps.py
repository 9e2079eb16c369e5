"""The operating map: cutting speed and feed, what limits leave of them, and where the machine is and was.

``OperatingMap`` shows at every step what Figures 3, 6, 7 and 10 of Alaskari and Oraby (2018) show of four moments: contours of
the metal removal rate, and the region that power, force and wear leave, which shrinks as the edge wears. Both axes are
logarithmic, so that contours and limits, which are power laws, are straight lines and the region is a polygon. Where only the
feed is set, ``FeedMap`` shows the feed along the bar, and what limits leave of it there.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from turning_env.physics.parts import MIN_DEPTH
from turning_env.rendering.bar import place_axis, stretch_in_view
from turning_env.rendering.history import History
from turning_env.rendering.limits import Cut, HalfPlane, border, bound, highest_feed, region, wear_bound
from turning_env.rendering.theme import (
    ALLOWED,
    CARD,
    FAINT,
    FORCE,
    INK,
    POWER,
    PURPLE,
    QUIET,
    RULE,
    SCALE,
    SURFACE,
    Box,
    Colour,
    Pixels,
    Point,
    Ruler,
    draw_key,
    enlarged,
    length,
    log_ticks,
    mixed,
    put,
    round_ticks,
    write,
)
from turning_env.scenario import Scenario

_LIMIT_COLOURS: tuple[Colour, ...] = (POWER, FORCE, PURPLE)
_MARGIN = 20.0
"""Room around the machine's ranges, so that a point at their ends is seen whole [enlarged pixels]."""
_CONTOUR: Colour = (186, 191, 188)
_RATES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)
"""Metal removal rates of which contours are drawn [cm3/min]."""
_PLACES = 150
"""Places along the bar at which limits of the feed are computed."""


def _draw_point(draw: ImageDraw.ImageDraw, point: Point) -> None:
    x, y = point
    draw.ellipse((x - 9, y - 9, x + 9, y + 9), fill=INK, outline=CARD, width=2)


class OperatingMap:
    """Draws the map of a scenario whose policy sets cutting speed and feed."""

    def __init__(self, scenario: Scenario, box: Box) -> None:
        self._scenario = scenario
        self._box = (box[0] + 58, box[1] + 34, box[2] - 16, box[3] - 62)
        machine = scenario.machine
        self._ends = [
            tuple(math.log(getattr(machine, f"{name}_{end}")) for end in ("min", "max")) for name in ("cutting_speed", "feed")
        ]
        (slow, fast), (fine, coarse) = self._ends
        self._corners: list[Point] = [(slow, fine), (fast, fine), (fast, coarse), (slow, coarse)]
        left, top, right, bottom = self._box
        self._across = Ruler(slow, fast, _MARGIN, SCALE * (right - left) - 1.0 - _MARGIN)
        self._up = Ruler(fine, coarse, SCALE * (bottom - top) - 1.0 - _MARGIN, _MARGIN)
        self._sheet = enlarged(Image.new("RGB", (right - left, bottom - top), CARD))
        ends = [*self._pixels(self._corners), self._pixels(self._corners)[0]]
        ImageDraw.Draw(self._sheet).line(ends, fill=RULE, width=2)
        self._depth = scenario.workpiece.depth_of_cut
        lines = {f"{rate}": border(self._corners, HalfPlane(1.0, 1.0, math.log(rate / self._depth))) for rate in _RATES}
        self._contours = [(line, text) for text, line in lines.items() if line is not None]

    def draw_axes(self, image: Image.Image, box: Box) -> None:
        """Draw scales, titles and the key."""
        left, top, right, bottom = self._box
        draw = ImageDraw.Draw(image)
        write(image, (box[0] + 12, box[1] + 8), "operating map", 15)
        write(image, (left - 46, top - 3), "mm/rev", 11, QUIET)
        write(image, (right, box[1] + 11), "feed over cutting speed, log scales", 11, FAINT, "right")
        for tick in log_ticks(*(math.exp(end) for end in self._ends[0])):
            x = left + self._across(math.log(tick)) / SCALE
            draw.line((x, bottom, x, bottom + 4), fill=FAINT)
            write(image, (x, bottom + 5), f"{tick:g}", 11, QUIET, "middle")
        for tick in log_ticks(*(math.exp(end) for end in self._ends[1])):
            y = top + self._up(math.log(tick)) / SCALE
            draw.line((left - 4, y, left, y), fill=FAINT)
            if y > top + 14:
                write(image, (left - 8, y - 8), f"{tick:g}", 11, QUIET, "right")
        write(image, (0.5 * (left + right), bottom + 19), "cutting speed [m/min]", 11, QUIET, "middle")
        limits = self._scenario.limits
        entries = [
            ("allowed now", mixed(ALLOWED, 0.3), 11),
            (f"{limits.power:g} kW", POWER, 3),
            (f"{limits.thrust_force:g} N", FORCE, 3),
            ("wear", PURPLE, 3),
            ("by the models", QUIET, 1),
            ("cm3/min", _CONTOUR, 1),
        ]
        draw_key(image, (left - 46, bottom + 39), entries, 16)
        draw.rectangle((left - 1, top - 1, right, bottom), outline=FAINT)

    def _limits(self, cut: Cut, wear_factor: float, used_life: float, cutting_time: float) -> list[HalfPlane]:
        material, limits = self._scenario.material, self._scenario.limits
        return [
            bound(material.power, limits.power, cut),
            bound(material.thrust_force, limits.thrust_force, cut),
            wear_bound(self._scenario, cut, wear_factor, used_life, cutting_time),
        ]

    def _pixels(self, points: list[Point]) -> list[tuple[float, float]]:
        return [(self._across(speed), self._up(feed)) for speed, feed in points]

    def draw(self, frame: Pixels, history: History) -> None:
        """Draw the region that is allowed in the metal cut last, and the trail."""
        now = history.now
        image = self._sheet.copy()
        draw = ImageDraw.Draw(image)
        cut = Cut(max(history.passes[-1][2], MIN_DEPTH) if history.passes else history.depth, history.hardness, history.wear)
        limits = self._limits(cut, now["wear_factor"], now["used_life"], now["cutting_time"])
        allowed = region(self._corners, limits)
        if len(allowed) > 2:
            draw.polygon(self._pixels(allowed), fill=mixed(ALLOWED, 0.22))
        for line, _ in self._contours:
            draw.line(self._pixels(list(line)), fill=_CONTOUR, width=2)
        told = self._limits(Cut(self._depth, 1.0, history.nominal_wear), 1.0, history.nominal_used_life, now["cutting_time"])
        believed = region(self._corners, told)
        if len(believed) > 2:
            outline = self._pixels(believed)
            draw.line([*outline, outline[0]], fill=mixed(QUIET, 0.75), width=2)
        for limit, colour in zip(limits, _LIMIT_COLOURS, strict=True):
            ends = border(self._corners, limit)
            if ends is not None:
                draw.line(self._pixels(list(ends)), fill=colour, width=5)
        self._draw_trail(draw, history)
        image = image.reduce(SCALE)
        for line, text in self._contours:
            self._write_rate(image, line, text)
        if len(allowed) < 3:
            write(image, (image.width / 2, image.height / 2), "no speed and feed is allowed", 13, INK, "middle")
        put(frame, image, (self._box[0], self._box[1]))

    def _write_rate(self, image: Image.Image, line: tuple[Point, Point], text: str) -> None:
        """Write a contour's removal rate at its upper end, inside the map."""
        upper, lower = sorted(line, key=lambda point: -point[1])
        share = 0.04
        x = self._across(upper[0] + share * (lower[0] - upper[0])) / SCALE
        y = self._up(upper[1] + share * (lower[1] - upper[1])) / SCALE
        write(image, (min(x + 3, image.width - length(text, 11) - 3), y - 3), text, 11, QUIET)

    def _draw_trail(self, draw: ImageDraw.ImageDraw, history: History) -> None:
        points = self._pixels([(math.log(speed), math.log(feed)) for speed, feed in history.trail])
        count = len(points)
        if self._scenario.control.action == "part":
            last = count - len(history.passes)
            for x, y in points[:last]:
                draw.ellipse((x - 5, y - 5, x + 5, y + 5), fill=mixed(INK, 0.25))
            for point in points[last:]:
                _draw_point(draw, point)
            return
        for number in range(1, count):
            draw.line((points[number - 1], points[number]), fill=mixed(INK, 0.1 + 0.05 * (12 * number // count)), width=3)
        command = (math.log(history.now["commanded_cutting_speed"]), math.log(history.now["commanded_feed"]))
        ((x, y),) = self._pixels([command])
        draw.ellipse((x - 12, y - 12, x + 12, y + 12), outline=INK, width=3)
        _draw_point(draw, points[-1])


class FeedMap:
    """Draws the map of a scenario whose policy sets a feed override, at a fixed cutting speed."""

    def __init__(self, scenario: Scenario, box: Box) -> None:
        self._scenario = scenario
        self._box = (box[0] + 58, box[1] + 34, box[2] - 48, box[3] - 62)
        left, top, right, bottom = self._box
        control = scenario.control
        self._width = SCALE * (right - left)
        self._up = Ruler(0.0, control.override_max * control.initial_feed, SCALE * (bottom - top) - 1.0, 0.0)
        self._holds_roughness = control.aim == "roughness"
        self._shown: Any = None
        self._trail: list[Point] = []

    def draw_axes(self, image: Image.Image, box: Box) -> None:
        """Draw scales, titles and the key."""
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
        curves = [(f"{limits.power:g} kW", POWER, 3), (f"{limits.thrust_force:g} N", FORCE, 3)]
        if self._holds_roughness:
            curves = [("gives the reference", SURFACE, 3)]
        entries = [("allowed", mixed(ALLOWED, 0.3), 11), *curves, ("feed", INK, 3), ("programmed (100 %)", FAINT, 1)]
        draw_key(image, (left - 46, bottom + 39), entries, 13)
        draw.rectangle((left - 1, top - 1, right, bottom), outline=FAINT)

    def draw(self, frame: Pixels, history: History) -> None:
        """Draw what is allowed along the bar with the edge as it is now, and the feed so far."""
        ends = stretch_in_view(self._scenario, history.along)
        across = Ruler(*ends, 0.0, self._width - 1.0)
        shown = (history.key, history.bars_seen, ends)
        if shown != self._shown:
            self._shown, self._taken, self._trail = shown, 0, []
            self._look_along(history, across)
            self._draw_places(frame, ends)
        height = round(self._up.first) + 1
        image = Image.new("RGB", (self._width, height), CARD)
        draw = ImageDraw.Draw(image)
        curves = self._curves(history)
        allowed = np.minimum.reduce([np.full(len(self._xs), self._up.end), *(feeds for _, feeds in curves)])
        outline = self._pixels(allowed)
        draw.polygon([(outline[0][0], height), *outline, (outline[-1][0], height)], fill=mixed(ALLOWED, 0.22))
        programmed = self._up(self._scenario.control.initial_feed)
        draw.line((0, programmed, self._width, programmed), fill=FAINT, width=2)
        if self._holds_roughness:
            curves = [(SURFACE, self._held_feed(history))]
        for colour, feeds in curves:
            draw.line(self._pixels(np.minimum(feeds, 1.05 * self._up.end)), fill=colour, width=4)
        self._draw_trail(draw, history, across)
        put(frame, image.reduce(SCALE), (self._box[0], self._box[1]))

    def _look_along(self, history: History, across: Ruler) -> None:
        step = (across.end - across.start) / _PLACES
        places = across.start + step * (np.arange(_PLACES) + 0.5)
        places = places[(places > 0.0) & (places < self._scenario.workpiece.bar_length)]
        self._hardness, self._depth = history.fields.along(history.key, history.bar, np.ascontiguousarray(places))
        self._xs = [across(place) for place in places.tolist()]

    def _curves(self, history: History) -> list[tuple[Colour, NDArray[np.float64]]]:
        """Return the feed [mm/rev] at which each limit is reached along the bar."""
        material, limits, speed = self._scenario.material, self._scenario.limits, history.now["cutting_speed"]
        laws = ((POWER, material.power, limits.power), (FORCE, material.thrust_force, limits.thrust_force))
        return [(colour, highest_feed(law, most, speed, self._depth, self._hardness, history.wear)) for colour, law, most in laws]

    def _held_feed(self, history: History) -> NDArray[np.float64]:
        """Return the feed [mm/rev] that gives the reference of roughness along the bar."""
        surface = self._scenario.surface
        force = math.log(history.now["roughness_reference"] / surface.roughness_at_no_force) / surface.roughness_rate
        law, speed = self._scenario.material.thrust_force, history.now["cutting_speed"]
        return highest_feed(law, force, speed, self._depth, self._hardness, history.wear)

    def _pixels(self, feeds: NDArray[np.float64]) -> list[Point]:
        return list(zip(self._xs, map(self._up, feeds.tolist()), strict=True))

    def _draw_trail(self, draw: ImageDraw.ImageDraw, history: History, across: Ruler) -> None:
        for sample in history.along_bar[self._taken :]:
            point = across.within(sample.place), self._up.within(sample.feed)
            last = self._trail[-1] if self._trail else (-math.inf, 0.0)
            # None from before the page, and only points far enough apart to be told apart.
            if sample.place >= across.start and abs(point[0] - last[0]) + abs(point[1] - last[1]) >= 3.0:
                self._trail.append(point)
        self._taken = len(history.along_bar)
        now = across.within(history.along), self._up.within(history.now["feed"])
        if self._trail:
            draw.line([*self._trail, now], fill=INK, width=4)
        _draw_point(draw, now)

    def _draw_places(self, frame: Pixels, ends: tuple[float, float]) -> None:
        left, _, right, bottom = self._box
        below = place_axis(ends, right - left, 34, 7, 1)
        ImageDraw.Draw(below).line((14, 0, right - left + 15, 0), fill=RULE)
        write(below, (below.width / 2, 18), "place along the bar [mm]", 11, QUIET, "middle")
        put(frame, below, (left - 15, bottom))
