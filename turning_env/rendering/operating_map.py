"""The operating map: the plane of cutting speed and feed, what limits leave of it, and where the lathe is and was.

What Figures 3, 6, 7 and 10 of Alaskari and Oraby (2018) show of four moments, here of every interval: contours of the metal
removal rate, and the region that power, force and wear leave, which shrinks as the edge wears. Both axes are logarithmic, so that
contours and limits, which are power laws, are straight lines and the region is a polygon.
"""

import math

from PIL import Image, ImageDraw

from turning_env.physics.parts import MIN_DEPTH
from turning_env.rendering.lane import Lane
from turning_env.rendering.limits import Cut, HalfPlane, Point, border, bound, region, wear_bound
from turning_env.rendering.ruler import Ruler
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
    Box,
    Colour,
    Pixels,
    enlarged,
    length,
    log_ticks,
    mixed,
    put,
    write,
)
from turning_env.scenario import Scenario

_LIMIT_COLOURS: tuple[Colour, ...] = (POWER, FORCE, PURPLE)
_MARGIN = 20.0
"""Room around the machine's ranges, so that a point at their ends is seen whole [enlarged pixels]."""
_CONTOUR: Colour = (186, 191, 188)
_RATES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)
"""Metal removal rates of which contours are drawn [cm3/min]."""


class OperatingMap:
    """Draws the map of a scenario whose controller sets speed and feed."""

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
        self._contours = self._find_contours()

    def draw_axes(self, image: Image.Image, box: Box) -> None:
        """Scales, titles and the key."""
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
        self._draw_key(image, (left - 46, bottom + 39))
        draw.rectangle((left - 1, top - 1, right, bottom), outline=FAINT)

    def _draw_key(self, image: Image.Image, place: tuple[int, int]) -> None:
        draw, limits = ImageDraw.Draw(image), self._scenario.limits
        x, y = place
        entries: list[tuple[str, Colour, int]] = [
            ("allowed now", mixed(ALLOWED, 0.3), 11),
            (f"{limits.power:g} kW", POWER, 3),
            (f"{limits.thrust_force:g} N", FORCE, 3),
            ("wear", PURPLE, 3),
            ("by the models", QUIET, 1),
            ("cm3/min", _CONTOUR, 1),
        ]
        for text, colour, height in entries:
            draw.rectangle((x, y + 8 - height // 2, x + 15, y + 8 - height // 2 + height - 1), fill=colour)
            write(image, (x + 20, y), text, 11, QUIET)
            x += 20 + round(length(text, 11)) + 16

    def _find_contours(self) -> list[tuple[tuple[Point, Point], str]]:
        """The lines of equal removal rate at the nominal depth of cut, with what they stand for."""
        found = []
        for rate in _RATES:
            line = border(self._corners, HalfPlane(1.0, 1.0, math.log(rate / self._depth)))
            if line is not None:
                found.append((line, f"{rate}"))
        return found

    def _limits(self, cut: Cut, wear_factor: float, used_life: float, cutting_time: float) -> list[HalfPlane]:
        material, limits = self._scenario.material, self._scenario.limits
        return [
            bound(material.power, limits.power, cut),
            bound(material.thrust_force, limits.thrust_force, cut),
            wear_bound(self._scenario, cut, wear_factor, used_life, cutting_time),
        ]

    def _pixels(self, points: list[Point]) -> list[tuple[float, float]]:
        return [(self._across(speed), self._up(feed)) for speed, feed in points]

    def draw(self, frame: Pixels, lane: Lane) -> None:
        """The region that is allowed in the metal cut last, and the trail."""
        now = lane.now
        image = self._sheet.copy()
        draw = ImageDraw.Draw(image)
        cut = Cut(max(lane.passes[-1][2], MIN_DEPTH) if lane.passes else lane.depth, lane.hardness, lane.wear)
        limits = self._limits(cut, now["wear_factor"], now["used_life"], now["cutting_time"])
        allowed = region(self._corners, limits)
        if len(allowed) > 2:
            draw.polygon(self._pixels(allowed), fill=mixed(ALLOWED, 0.22))
        for line, _ in self._contours:
            draw.line(self._pixels(list(line)), fill=_CONTOUR, width=2)
        told = self._limits(Cut(self._depth, 1.0, lane.nominal_wear), 1.0, lane.nominal_used_life, now["cutting_time"])
        believed = region(self._corners, told)
        if len(believed) > 2:
            outline = self._pixels(believed)
            draw.line([*outline, outline[0]], fill=mixed(QUIET, 0.75), width=2)
        for limit, colour in zip(limits, _LIMIT_COLOURS, strict=True):
            ends = border(self._corners, limit)
            if ends is not None:
                draw.line(self._pixels(list(ends)), fill=colour, width=5)
        self._draw_trail(draw, lane)
        image = image.reduce(SCALE)
        for line, text in self._contours:
            self._write_rate(image, line, text)
        if len(allowed) < 3:
            write(image, (image.width / 2, image.height / 2), "no speed and feed is allowed", 13, INK, "middle")
        put(frame, image, (self._box[0], self._box[1]))

    def _write_rate(self, image: Image.Image, line: tuple[Point, Point], text: str) -> None:
        """At the contour's upper end, inside the map."""
        upper, lower = sorted(line, key=lambda point: -point[1])
        share = 0.04
        x = self._across(upper[0] + share * (lower[0] - upper[0])) / SCALE
        y = self._up(upper[1] + share * (lower[1] - upper[1])) / SCALE
        write(image, (min(x + 3, image.width - length(text, 11) - 3), y - 3), text, 11, QUIET)

    def _draw_trail(self, draw: ImageDraw.ImageDraw, lane: Lane) -> None:
        points = self._pixels([(math.log(speed), math.log(feed)) for speed, feed in lane.trail])
        parts = self._scenario.control.action == "part"
        count = len(points)
        for number in range(1, count):
            if not parts:
                draw.line((points[number - 1], points[number]), fill=mixed(INK, 0.1 + 0.05 * (12 * number // count)), width=3)
        if parts:
            for x, y in points[: -len(lane.passes) or None]:
                draw.ellipse((x - 5, y - 5, x + 5, y + 5), fill=mixed(INK, 0.25))
            for x, y in points[-len(lane.passes) :] if lane.passes else []:
                draw.ellipse((x - 9, y - 9, x + 9, y + 9), fill=INK, outline=CARD, width=2)
            return
        if points:
            command = [(math.log(lane.now["commanded_cutting_speed"]), math.log(lane.now["commanded_feed"]))]
            ((x, y),) = self._pixels(command)
            draw.ellipse((x - 12, y - 12, x + 12, y + 12), outline=INK, width=3)
            x, y = points[-1]
            draw.ellipse((x - 9, y - 9, x + 9, y + 9), fill=INK, outline=CARD, width=2)
