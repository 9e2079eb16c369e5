"""The operating map: cutting speed and feed, their feasible region, and the machine's path through it.

``OperatingMap`` shows contours of the metal removal rate, and the region that power, force and wear allow, which shrinks as the
edge wears. Figures 3, 6, 7 and 10 of Alaskari and Oraby (2018) show the same at four moments. Both axes are logarithmic, so
that contours and limits, which are power laws, are straight lines and the region is a polygon. If only the feed is set,
``FeedMap`` shows the feed along the bar and its feasible range.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from turning_env.physics.parts import MIN_DEPTH
from turning_env.physics.spindle import capacity_at, idle_power_at
from turning_env.scenario import Scenario
from turning_env.scenario.power_law import PowerLaw
from turning_render import theme as ui
from turning_render.bar import fields_in_view, place_axis, stretch_in_view
from turning_render.fields import Array
from turning_render.history import TRAIL, History

_LIMIT_COLOURS: tuple[ui.Colour, ...] = (ui.POWER, ui.FORCE, ui.PURPLE, ui.POWER)
_MARGIN = 20.0
"""Room around the machine's ranges, so that a point at their ends is seen whole [enlarged pixels]."""
_CONTOUR: ui.Colour = (186, 191, 188)
_RATES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)
"""Metal removal rates of which contours are drawn [cm3/min]."""
_PLACES = 150
"""Places along the bar at which limits of the feed are computed."""


class HalfPlane(NamedTuple):
    """The allowed side of a limit: cutting_speed log vc + feed log f <= room."""

    cutting_speed: float
    feed: float
    room: float


class Cut(NamedTuple):
    """A cut: depth of cut [mm], relative hardness [-] and flank wear [mm]."""

    depth: float
    hardness: float
    wear: float


def bound(law: PowerLaw, limit: float, cut: Cut) -> HalfPlane:
    """Return the half-plane in which a response does not exceed a limit, in its unit."""
    rest = float(law(1.0, 1.0, cut.depth, 1.0, cut.wear, cut.hardness))
    return HalfPlane(law.cutting_speed, law.feed, math.log(limit / rest))


def wear_bound(scenario: Scenario, cut: Cut, wear_factor: float, used_life: float, cutting_time: float) -> HalfPlane:
    """Return the half-plane in which the edge outlasts the next step; see ``turning_env.physics.wear``.

    ``cutting_time`` of the edge is in min.
    """
    law, criterion, minutes = scenario.material.wear, scenario.tool.wear_criterion, scenario.control.interval / 60.0
    if scenario.tool.wear_rule == "equivalent_time":
        left = max(1.0 - used_life, 1e-9)
        limit = criterion * (left / minutes) ** law.time
    else:
        left = max(criterion * (1.0 - used_life**law.time), 1e-9)
        limit = left / ((cutting_time + minutes) ** law.time - cutting_time**law.time)
    return bound(law, limit / wear_factor, Cut(cut.depth, cut.hardness, 1.0))


def _clip(corners: Sequence[ui.Point], limit: HalfPlane) -> tuple[list[ui.Point], list[ui.Point]]:
    """Return the corners of a convex polygon clipped at a limit, and those of them that lie on its line."""
    kept: list[ui.Point] = []
    crossings: list[ui.Point] = []
    for before, after in zip([*corners[-1:], *corners[:-1]], corners, strict=True):
        ours, theirs = (limit.cutting_speed * x + limit.feed * y - limit.room for x, y in (before, after))  # negative within
        if (ours <= 0.0) != (theirs <= 0.0):
            share = ours / (ours - theirs)
            crossings.append((before[0] + share * (after[0] - before[0]), before[1] + share * (after[1] - before[1])))
            kept.append(crossings[-1])
        if theirs <= 0.0:
            kept.append(after)
    return kept, crossings


def region(corners: Sequence[ui.Point], limits: Sequence[HalfPlane]) -> list[ui.Point]:
    """Return the corners of a convex polygon clipped at limits, none if nothing remains (Sutherland and Hodgman 1974)."""
    left = list(corners)
    for limit in limits:
        left, _ = _clip(left, limit)
    return left


def border(corners: Sequence[ui.Point], limit: HalfPlane) -> tuple[ui.Point, ui.Point] | None:
    """Return the points at which the line of a limit enters and leaves a convex polygon, or None if it misses it."""
    _, crossings = _clip(corners, limit)
    return (crossings[0], crossings[1]) if len(crossings) == 2 else None


def _limit_keys(scenario: Scenario) -> list[tuple[str, ui.Colour, int]]:
    """Return the legend's entries for the limits of power and force."""
    limits = scenario.limits
    return [(f"power limit {limits.power:.4g} kW", ui.POWER, 3), (f"force limit {limits.thrust_force:.4g} N", ui.FORCE, 3)]


def _draw_point(draw: ImageDraw.ImageDraw, point: ui.Point) -> None:
    x, y = point
    draw.ellipse((x - 9, y - 9, x + 9, y + 9), fill=ui.INK, outline=ui.CARD, width=2)


class OperatingMap:
    """The map of a scenario whose policy sets cutting speed and feed."""

    def __init__(self, scenario: Scenario, box: ui.Box) -> None:
        self._scenario = scenario
        self._box = (box[0] + 58, box[1] + 34, box[2] - 16, box[3] - 74)
        machine = scenario.machine
        self._ends = [
            tuple(math.log(getattr(machine, f"{name}_{end}")) for end in ("min", "max")) for name in ("cutting_speed", "feed")
        ]
        (slow, fast), (fine, coarse) = self._ends
        self._corners: list[ui.Point] = [(slow, fine), (fast, fine), (fast, coarse), (slow, coarse)]
        left, top, right, bottom = self._box
        self._across = ui.Ruler(slow, fast, _MARGIN, ui.SCALE * (right - left) - 1.0 - _MARGIN)
        self._up = ui.Ruler(fine, coarse, ui.SCALE * (bottom - top) - 1.0 - _MARGIN, _MARGIN)
        self._sheet = ui.enlarged(Image.new("RGB", (right - left, bottom - top), ui.CARD))
        ends = [*self._pixels(self._corners), self._pixels(self._corners)[0]]
        ImageDraw.Draw(self._sheet).line(ends, fill=ui.RULE, width=2)
        self._depth = scenario.workpiece.depth_of_cut
        lines = {f"{rate}": border(self._corners, HalfPlane(1.0, 1.0, math.log(rate / self._depth))) for rate in _RATES}
        self._contours = [(line, text) for text, line in lines.items() if line is not None]

    def draw_axes(self, image: Image.Image, box: ui.Box) -> None:
        """Draw scales, titles and the key."""
        left, top, right, bottom = self._box
        draw = ImageDraw.Draw(image)
        ui.write(image, (box[0] + 12, box[1] + 8), "operating map", 15)
        ui.write_up(image, (box[0] + 8, 0.5 * (top + bottom)), "feed [mm/rev]")
        ui.write(image, (right, box[1] + 11), "feed over cutting speed, log scales", 11, ui.QUIET, "right")
        for tick in ui.log_ticks(*(math.exp(end) for end in self._ends[0])):
            x = left + self._across(math.log(tick)) / ui.SCALE
            draw.line((x, bottom, x, bottom + 4), fill=ui.FAINT)
            ui.write(image, (x, bottom + 5), f"{tick:g}", 11, ui.QUIET, "middle")
        for tick in ui.log_ticks(*(math.exp(end) for end in self._ends[1])):
            y = top + self._up(math.log(tick)) / ui.SCALE
            draw.line((left - 4, y, left, y), fill=ui.FAINT)
            ui.write(image, (left - 8, y - 8), f"{tick:g}", 11, ui.QUIET, "right")
        ui.write(image, (0.5 * (left + right), bottom + 19), "cutting speed [m/min]", 11, ui.QUIET, "middle")
        allowed = [("allowed now", ui.mixed(ui.ALLOWED, 0.3), 11)]
        ui.draw_key(image, (left - 46, bottom + 36), [*allowed, *_limit_keys(self._scenario), ("wear limit", ui.PURPLE, 3)], 14)
        parts = self._scenario.control.action == "part"
        points = "dark: last part's passes" if parts else f"last {TRAIL} steps; ring: command"
        entries = [("allowed by nominal model", ui.QUIET, 1), ("MRR [cm3/min]", _CONTOUR, 1), (points, ui.INK, 7 if parts else 2)]
        ui.draw_key(image, (left - 46, bottom + 52), entries, 14)
        draw.rectangle((left - 1, top - 1, right, bottom), outline=ui.FAINT)

    def _limits(self, cut: Cut, speed: float, wear_factor: float, used_life: float, cutting_time: float) -> list[HalfPlane]:
        material, limits, base_speed = self._scenario.material, self._scenario.limits, self._scenario.base_cutting_speed
        bounds = [
            bound(material.power, limits.power - idle_power_at(self._scenario, speed), cut),
            bound(material.thrust_force, limits.thrust_force, cut),
            wear_bound(self._scenario, cut, wear_factor, used_life, cutting_time),
        ]
        if base_speed > 0.0:  # the torque, which is power over speed
            power = bound(material.power, limits.power / base_speed - idle_power_at(self._scenario, 1.0), cut)
            bounds.append(power._replace(cutting_speed=power.cutting_speed - 1.0))
        return bounds

    def _pixels(self, points: list[ui.Point]) -> list[tuple[float, float]]:
        return [(self._across(speed), self._up(feed)) for speed, feed in points]

    def draw(self, frame: ui.Pixels, history: History) -> None:
        """Draw the region that is allowed in the metal cut last, and the trail."""
        now = history.now
        image = self._sheet.copy()
        draw = ImageDraw.Draw(image)
        cut = Cut(max(history.passes[-1][2], MIN_DEPTH) if history.passes else history.depth, history.hardness, history.wear)
        limits = self._limits(cut, now["cutting_speed"], now["wear_factor"], now["used_life"], now["cutting_time"])
        allowed = region(self._corners, limits)
        if len(allowed) > 2:
            draw.polygon(self._pixels(allowed), fill=ui.mixed(ui.ALLOWED, 0.22))
        for line, _ in self._contours:
            draw.line(self._pixels(list(line)), fill=_CONTOUR, width=2)
        nominal = Cut(self._depth, 1.0, history.nominal_wear)
        nominal_limits = self._limits(nominal, now["cutting_speed"], 1.0, history.nominal_used_life, now["cutting_time"])
        believed = region(self._corners, nominal_limits)
        if len(believed) > 2:
            outline = self._pixels(believed)
            draw.line([*outline, outline[0]], fill=ui.mixed(ui.QUIET, 0.75), width=2)
        for limit, colour in zip(limits, _LIMIT_COLOURS, strict=False):
            ends = border(self._corners, limit)
            if ends is not None:
                draw.line(self._pixels(list(ends)), fill=colour, width=5)
        self._draw_trail(draw, history)
        image = image.reduce(ui.SCALE)
        for line, text in self._contours:  # at its upper end, inside the map
            upper, lower = sorted(line, key=lambda point: -point[1])
            x = self._across(upper[0] + 0.04 * (lower[0] - upper[0])) / ui.SCALE
            y = self._up(upper[1] + 0.04 * (lower[1] - upper[1])) / ui.SCALE
            ui.write(image, (min(x + 3, image.width - ui.length(text, 11) - 3), y - 3), text, 11, ui.QUIET)
        if len(allowed) < 3:
            text = "no speed and feed keeps all limits"
            middle, y, half = image.width // 2, image.height // 2, math.ceil(0.5 * ui.length(text, 13)) + 6
            ImageDraw.Draw(image).rectangle((middle - half, y - 4, middle + half, y + 20), fill=ui.CARD, outline=ui.OVER)
            ui.write(image, (middle, y), text, 13, ui.OVER, "middle")
        ui.put(frame, image, (self._box[0], self._box[1]))

    def _draw_trail(self, draw: ImageDraw.ImageDraw, history: History) -> None:
        points = self._pixels([(math.log(speed), math.log(feed)) for speed, feed in history.trail])
        count = len(points)
        if self._scenario.control.action == "part":
            last = count - len(history.passes)
            for x, y in points[:last]:
                draw.ellipse((x - 5, y - 5, x + 5, y + 5), fill=ui.mixed(ui.INK, 0.25))
            for point in points[last:]:
                _draw_point(draw, point)
            return
        for number in range(1, count):
            draw.line((points[number - 1], points[number]), fill=ui.mixed(ui.INK, 0.1 + 0.05 * (12 * number // count)), width=3)
        command = (math.log(history.now["commanded_cutting_speed"]), math.log(history.now["commanded_feed"]))
        ((x, y),) = self._pixels([command])
        draw.ellipse((x - 12, y - 12, x + 12, y + 12), outline=ui.INK, width=3)
        _draw_point(draw, points[-1])


class FeedMap:
    """The map of a scenario whose policy sets a feed override, at a fixed cutting speed."""

    def __init__(self, scenario: Scenario, box: ui.Box) -> None:
        self._scenario = scenario
        self._box = (box[0] + 58, box[1] + 34, box[2] - 62, box[3] - 74)
        left, top, right, bottom = self._box
        control = scenario.control
        self._width = ui.SCALE * (right - left)
        self._up = ui.Ruler(0.0, control.override_max * control.initial_feed, ui.SCALE * (bottom - top) - 1.0, 0.0)
        self._holds_roughness = control.aim == "roughness"
        self._shown: Any = None
        self._trail: list[ui.Point] = []

    def draw_axes(self, image: Image.Image, box: ui.Box) -> None:
        """Draw scales, titles and the key."""
        left, top, right, bottom = self._box
        draw = ImageDraw.Draw(image)
        ui.write(image, (box[0] + 12, box[1] + 8), "operating map", 15)
        ui.write_up(image, (box[0] + 8, 0.5 * (top + bottom)), "feed [mm/rev]")
        ui.write_up(image, (box[2] - 22, 0.5 * (top + bottom)), "feed override")
        speed = self._scenario.control.initial_cutting_speed
        ui.write(image, (right, box[1] + 11), f"feed along the bar, at {speed:.0f} m/min", 11, ui.QUIET, "right")
        programmed = self._scenario.control.initial_feed
        for tick in ui.round_ticks(0.0, self._up.end, 7):
            y = top + self._up(tick) / ui.SCALE
            ui.write(image, (left - 8, min(y - 8, bottom - 13)), f"{tick:g}", 11, ui.QUIET, "right")
            draw.line((left - 4, y, left, y), fill=ui.FAINT)
        for tick in ui.round_ticks(0.0, self._up.end / programmed, 6):
            y = top + self._up(tick * programmed) / ui.SCALE
            draw.line((right, y, right + 4, y), fill=ui.FAINT)
            ui.write(image, (right + 7, min(y - 8, bottom - 13)), f"{100 * tick:.0f} %", 11, ui.QUIET)
        curves = _limit_keys(self._scenario)
        if self._holds_roughness:
            curves = [("feed that gives the reference roughness", ui.SURFACE, 3)]
        entries = [("allowed", ui.mixed(ui.ALLOWED, 0.3), 11), *curves]
        ui.draw_key(image, (left - 46, bottom + 36), entries, 14)
        ui.draw_key(image, (left - 46, bottom + 52), [("feed so far", ui.INK, 3), ("programmed feed (100 %)", ui.FAINT, 1)], 14)
        draw.rectangle((left - 1, top - 1, right, bottom), outline=ui.FAINT)

    def draw(self, frame: ui.Pixels, history: History) -> None:
        """Draw the allowed feeds along the bar with the edge as it is now, and the feed so far."""
        ends = stretch_in_view(self._scenario, history.along)
        across = ui.Ruler(*ends, 0.0, self._width - 1.0)
        shown = (history.key, history.bars_seen, ends)
        if shown != self._shown:
            self._shown, self._taken, self._trail = shown, 0, []
            self._xs, self._hardness, self._depth = fields_in_view(self._scenario, history, across, _PLACES)
            self._draw_places(frame, ends)
        height = round(self._up.first) + 1
        image = Image.new("RGB", (self._width, height), ui.CARD)
        draw = ImageDraw.Draw(image)
        material, limits, surface = self._scenario.material, self._scenario.limits, self._scenario.surface
        speed = history.now["cutting_speed"]
        power = limits.power * capacity_at(self._scenario, speed) - idle_power_at(self._scenario, speed)
        laws = ((ui.POWER, material.power, power), (ui.FORCE, material.thrust_force, limits.thrust_force))
        curves = [(colour, self._highest_feed(history, law, limit)) for colour, law, limit in laws]
        allowed = np.minimum.reduce([np.full(len(self._xs), self._up.end), *(feeds for _, feeds in curves)])
        outline = self._pixels(allowed)
        draw.polygon([(outline[0][0], height), *outline, (outline[-1][0], height)], fill=ui.mixed(ui.ALLOWED, 0.22))
        programmed = self._up(self._scenario.control.initial_feed)
        draw.line((0, programmed, self._width, programmed), fill=ui.FAINT, width=2)
        if self._holds_roughness:
            force = math.log(history.now["roughness_reference"] / surface.roughness_at_no_force) / surface.roughness_rate
            curves = [(ui.SURFACE, self._highest_feed(history, material.thrust_force, force))]
        for colour, feeds in curves:
            draw.line(self._pixels(np.minimum(feeds, 1.05 * self._up.end)), fill=colour, width=4)
        self._draw_trail(draw, history, across)
        ui.put(frame, image.reduce(ui.SCALE), (self._box[0], self._box[1]))

    def _highest_feed(self, history: History, law: PowerLaw, limit: float) -> Array:
        """Return the feed [mm/rev] at which a response reaches a limit along the bar; infinite if none does."""
        if law.feed <= 0.0:
            return np.full(self._depth.shape, np.inf)
        rest = law(history.now["cutting_speed"], 1.0, self._depth, 1.0, history.wear, self._hardness)
        return np.asarray((limit / rest) ** (1.0 / law.feed))

    def _pixels(self, feeds: Array) -> list[ui.Point]:
        return list(zip(self._xs, map(self._up, feeds.tolist()), strict=True))

    def _draw_trail(self, draw: ImageDraw.ImageDraw, history: History, across: ui.Ruler) -> None:
        for sample in history.along_bar[self._taken :]:
            point = across.within(sample.place), self._up.within(sample.feed)
            last = self._trail[-1] if self._trail else (-math.inf, 0.0)
            # None from before the page, and only points far enough apart to be distinguished.
            if sample.place >= across.start and abs(point[0] - last[0]) + abs(point[1] - last[1]) >= 3.0:
                self._trail.append(point)
        self._taken = len(history.along_bar)
        now = across.within(history.along), self._up.within(history.now["feed"])
        if self._trail:
            draw.line([*self._trail, now], fill=ui.INK, width=4)
        _draw_point(draw, now)

    def _draw_places(self, frame: ui.Pixels, ends: tuple[float, float]) -> None:
        left, _, right, bottom = self._box
        below = place_axis(ends, right - left, 34, 7, 1)
        ImageDraw.Draw(below).line((14, 0, right - left + 15, 0), fill=ui.RULE)
        ui.write(below, (below.width / 2, 18), "place along the bar [mm]", 11, ui.QUIET, "middle")
        ui.put(frame, below, (left - 15, bottom))
