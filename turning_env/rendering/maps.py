"""The operating map: cutting speed and feed, their feasible region, and the path of the commands.

``OperatingMap`` shows contours of the metal removal rate, and the region that power, force and wear
allow, which shrinks as the edge wears. Figures 3, 6, 7 and 10 of Alaskari and Oraby (2018) show the
same at four moments. Both axes are logarithmic, so that contours and limits, which are power laws,
are straight lines and the region is a polygon.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

from PIL import Image, ImageDraw

from turning_env.physics.parts import MIN_DEPTH
from turning_env.rendering.history import History, Sample
from turning_env.rendering.theme import (
    ALLOWED,
    CARD,
    FAINT,
    FORCE,
    INK,
    OVER,
    POWER,
    QUIET,
    RULE,
    SCALE,
    SMALL,
    SURFACE,
    TITLE,
    Box,
    Colour,
    KeyEntry,
    Pixels,
    Point,
    Ruler,
    draw_dot,
    draw_key,
    enlarged_sheet,
    length,
    log_ticks,
    mixed,
    put,
    write,
    write_note,
    write_up,
)
from turning_env.scenario import Scenario
from turning_env.scenario.laws import idle_power_at
from turning_env.scenario.power_law import PowerLaw

_TRAIL = 90  # past steps that the map shows
_SHADES = 12  # of the trail, darker towards the present
_MARGIN = 20.0
"""Room around the machine's ranges, so that a point at their ends is seen whole [enlarged
pixels]."""
_CONTOUR: Colour = (186, 191, 188)
_MARK_RADIUS = 8  # of marks, with a margin [pixels]
_RATES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)  # of contours [cm3/min]


class HalfPlane(NamedTuple):
    """The allowed side of a limit: cutting_speed log vc + feed log f <= room."""

    cutting_speed: float
    feed: float
    room: float

    def excess(self, point: Point) -> float:
        """Return how far a point (log vc, log f) lies beyond the limit; negative within."""
        log_speed, log_feed = point
        return self.cutting_speed * log_speed + self.feed * log_feed - self.room


class PresentCut(NamedTuple):
    """The metal and the edge that cuts it."""

    depth: float  # depth of cut [mm]
    hardness: float  # relative hardness [-]
    wear: float  # flank wear [mm]


class DrawnLimit(NamedTuple):
    """A limit and its colour."""

    half_plane: HalfPlane
    colour: Colour


class Clipped(NamedTuple):
    """A convex polygon that was clipped at a line."""

    corners: list[Point]
    crossings: list[Point]  # corners on the line, two or none


class Contour(NamedTuple):
    """A line of one removal rate."""

    ends: list[Point]
    text: str


def bound(law: PowerLaw, limit: float, cut: PresentCut) -> HalfPlane:
    """Return the half-plane in which a response does not exceed a limit, in its unit."""
    response = float(law(1.0, 1.0, cut.depth, time=1.0, wear=cut.wear, hardness=cut.hardness))
    return HalfPlane(law.cutting_speed, law.feed, room=math.log(limit / response))


def wear_bound(
    scenario: Scenario,
    cut: PresentCut,
    wear_factor: float,
    used_life: float,
    cutting_time: float,
) -> HalfPlane:
    """Return the half-plane in which the edge outlasts the next step; see ``physics/wear.py``.

    Args:
        scenario: scenario with the wear law.
        cut: the metal that is cut.
        wear_factor: wear of the insert over that of the law [-].
        used_life: used share of the edge's life [-].
        cutting_time: cutting time of the edge [min].
    """
    law = scenario.material.wear
    criterion = scenario.tool.wear_criterion
    minutes = scenario.control.interval / 60.0
    if scenario.tool.wear_rule == "equivalent_time":
        # W = K t^n reaches the criterion in the step if K is larger than this limit.
        life_left = max(1.0 - used_life, 1e-9)
        limit = criterion * (life_left / minutes) ** law.time
    else:
        wear_left = max(criterion * (1.0 - used_life**law.time), 1e-9)
        # The published rule: wear grows by K ((t + dt)^n - t^n), whatever was cut before.
        end = cutting_time + minutes
        limit = wear_left / (end**law.time - cutting_time**law.time)
    return bound(law, limit / wear_factor, PresentCut(cut.depth, cut.hardness, wear=1.0))


def clip(corners: Sequence[Point], limit: HalfPlane) -> Clipped:
    """Return a convex polygon clipped at a limit (Sutherland and Hodgman 1974)."""
    clipped = Clipped([], [])
    for before, after in pairwise([*corners[-1:], *corners]):
        excess_before = limit.excess(before)
        excess_after = limit.excess(after)
        if (excess_before <= 0.0) != (excess_after <= 0.0):
            share = excess_before / (excess_before - excess_after)
            crossing = _between(before, after, share)
            clipped.crossings.append(crossing)
            clipped.corners.append(crossing)
        if excess_after <= 0.0:
            clipped.corners.append(after)
    return clipped


def _between(start: Point, end: Point, share: float) -> Point:
    """Return the point at a share of the way from one point to another."""
    x = start[0] + share * (end[0] - start[0])
    y = start[1] + share * (end[1] - start[1])
    return x, y


class OperatingMap:
    """The map of a scenario."""

    def __init__(self, scenario: Scenario, box: Box) -> None:
        self._scenario = scenario
        self._nominal_depth = scenario.workpiece.depth_of_cut
        self._box = Box(
            left=box.left + 58,
            top=box.top + 34,
            right=box.right - 16,
            bottom=box.bottom - 74,
        )
        width = self._box.right - self._box.left
        height = self._box.bottom - self._box.top
        machine = scenario.machine
        slow = math.log(machine.cutting_speed_min)
        fast = math.log(machine.cutting_speed_max)
        fine = math.log(machine.feed_min)
        coarse = math.log(machine.feed_max)
        self._across = Ruler(
            start=slow,
            end=fast,
            first=_MARGIN,
            last=SCALE * width - 1.0 - _MARGIN,
        )
        self._up = Ruler(
            start=fine,
            end=coarse,
            first=SCALE * height - 1.0 - _MARGIN,
            last=_MARGIN,
        )
        self._corners: list[Point] = [(slow, fine), (fast, fine), (fast, coarse), (slow, coarse)]
        self._contours = self._removal_rate_contours()
        self._sheet = enlarged_sheet(width, height)
        self._draw_outline(ImageDraw.Draw(self._sheet), self._corners, colour=RULE)

    def _removal_rate_contours(self) -> list[Contour]:
        """Return the lines of round removal rates at the nominal depth that cross the map."""
        contours = []
        for rate in _RATES:
            # The removal rate is speed times feed times depth.
            half_plane = HalfPlane(1.0, 1.0, room=math.log(rate / self._nominal_depth))
            ends = clip(self._corners, half_plane).crossings
            if len(ends) == 2:
                contours.append(Contour(ends, f"{rate}"))
        return contours

    def draw_axes(self, image: Image.Image, box: Box) -> None:
        """Draw scales, titles and the key."""
        left, top, right, bottom = self._box
        write(image, (box.left + 12, box.top + 8), "operating map", size=TITLE)
        note = "feed over cutting speed, log scales"
        write_note(image, (right, box.top + 11), note, anchor="right")
        write_up(image, (box.left + 8, 0.5 * (top + bottom)), "feed [mm/rev]")
        place = (0.5 * (left + right), bottom + 19)
        write_note(image, place, "cutting speed [m/min]", anchor="middle")

        draw = ImageDraw.Draw(image)
        for tick in log_ticks(math.exp(self._across.start), math.exp(self._across.end)):
            x = left + self._across(math.log(tick)) / SCALE
            draw.line((x, bottom, x, bottom + 4), fill=FAINT)
            write_note(image, (x, bottom + 5), f"{tick:g}", anchor="middle")
        for tick in log_ticks(math.exp(self._up.start), math.exp(self._up.end)):
            y = top + self._up(math.log(tick)) / SCALE
            draw.line((left - 4, y, left, y), fill=FAINT)
            write_note(image, (left - 8, y - 8), f"{tick:g}", anchor="right")
        self._draw_keys(image)
        draw.rectangle((left - 1, top - 1, right, bottom), outline=FAINT)

    def _draw_keys(self, image: Image.Image) -> None:
        limits = self._scenario.limits
        control = self._scenario.control
        surface = "reference Ra" if control.aim == "roughness" else "wear limit"
        of_limits = [
            KeyEntry("allowed now", mixed(ALLOWED, 0.3), height=11),
            KeyEntry(f"power limit {limits.power:.4g} kW", POWER, height=3),
            KeyEntry(f"force limit {limits.thrust_force:.4g} N", FORCE, height=3),
            KeyEntry(surface, SURFACE, height=3),
        ]
        if control.action == "part":
            points = KeyEntry("dark: last part's passes", INK, height=7)
        else:
            points = KeyEntry(f"last {_TRAIL} steps; ring: command", INK, height=2)
        of_others = [
            KeyEntry("allowed by nominal model", QUIET, height=1),
            KeyEntry("MRR [cm3/min]", _CONTOUR, height=1),
            points,
        ]
        left = self._box.left - 46
        draw_key(image, (left, self._box.bottom + 36), of_limits)
        draw_key(image, (left, self._box.bottom + 52), of_others)

    def _limits(
        self, cut: PresentCut, wear_factor: float, used_life: float, now: dict[str, float]
    ) -> list[DrawnLimit]:
        """Return the limits at the present speed and cutting time."""
        scenario = self._scenario
        material = scenario.material
        base_speed = scenario.base_cutting_speed
        power = scenario.limits.power - idle_power_at(scenario, now["cutting_speed"])
        limits = [
            DrawnLimit(bound(material.power, power, cut), POWER),
            DrawnLimit(bound(material.thrust_force, scenario.limits.thrust_force, cut), FORCE),
            DrawnLimit(
                wear_bound(
                    scenario,
                    cut,
                    wear_factor=wear_factor,
                    used_life=used_life,
                    cutting_time=now["cutting_time"],
                ),
                SURFACE,
            ),
        ]
        if base_speed > 0.0:
            # Below the base speed the torque is limited, which is power over speed [kW min/m]. So
            # the exponent of speed is 1 less. Idle power is proportional to speed.
            torque = scenario.limits.power / base_speed - idle_power_at(scenario, 1.0)
            half_plane = bound(material.power, torque, cut)
            half_plane = half_plane._replace(cutting_speed=half_plane.cutting_speed - 1.0)
            limits.append(DrawnLimit(half_plane, POWER))
        return limits

    def _reference_line(self, cut: PresentCut, now: dict[str, float]) -> DrawnLimit:
        """Return the line on which the force gives the reference of roughness."""
        surface = self._scenario.surface
        # Ra = a exp(b F)
        force = (
            math.log(now["roughness_reference"] / surface.roughness_at_no_force)
            / surface.roughness_rate
        )
        return DrawnLimit(bound(self._scenario.material.thrust_force, force, cut), SURFACE)

    def _region(self, limits: list[DrawnLimit]) -> list[Point]:
        """Return the corners of the part of the machine's ranges within the limits, or none."""
        corners = self._corners
        for limit in limits:
            corners = clip(corners, limit.half_plane).corners
        return corners

    def _pixels(self, points: Sequence[Point]) -> list[Point]:
        return [(self._across(speed), self._up(feed)) for speed, feed in points]

    def _draw_outline(
        self, draw: ImageDraw.ImageDraw, corners: list[Point], colour: Colour
    ) -> None:
        outline = self._pixels([*corners, corners[0]])
        draw.line(outline, fill=colour, width=2)

    def draw(self, frame: Pixels, history: History) -> None:
        """Draw the region that is allowed in the metal cut last, and the trail."""
        now = history.now
        sheet = self._sheet.copy()
        draw = ImageDraw.Draw(sheet)
        depth = history.depth
        if history.passes:
            depth = max(history.passes[-1].depth, MIN_DEPTH)
        # Limits are those of the edge as it is; they close in as it wears.
        cut = PresentCut(depth, history.hardness, history.wear)
        limits = self._limits(cut, now["wear_factor"], used_life=now["used_life"], now=now)
        allowed = self._region(limits)
        # A polygon of fewer corners is empty.
        if len(allowed) > 2:
            draw.polygon(self._pixels(allowed), fill=mixed(ALLOWED, 0.22))
        for contour in self._contours:
            draw.line(self._pixels(contour.ends), fill=_CONTOUR, width=2)
        self._draw_nominal_region(draw, history)
        if self._scenario.control.aim == "roughness":
            limits.append(self._reference_line(cut, now))
        for limit in limits:
            ends = clip(self._corners, limit.half_plane).crossings
            if len(ends) == 2:
                draw.line(self._pixels(ends), fill=limit.colour, width=5)
        if self._scenario.control.action == "part":
            marks = self._draw_parts(draw, history)
        else:
            marks = self._draw_trail(draw, history)
        image = sheet.reduce(SCALE)
        self._write_rates(image, marks)
        if len(allowed) <= 2:
            write(
                image,
                (image.width / 2, image.height / 2),
                "no speed and feed keeps all limits",
                colour=OVER,
                anchor="middle",
            )
        put(frame, image, (self._box.left, self._box.top))

    def _draw_nominal_region(self, draw: ImageDraw.ImageDraw, history: History) -> None:
        """Draw the outline of the region that is allowed by the nominal model."""
        cut = PresentCut(self._nominal_depth, hardness=1.0, wear=history.nominal_wear)
        limits = self._limits(
            cut, wear_factor=1.0, used_life=history.nominal_used_life, now=history.now
        )
        region = self._region(limits)
        if len(region) > 2:
            self._draw_outline(draw, region, colour=mixed(QUIET, 0.75))

    def _write_rates(self, image: Image.Image, marks: Sequence[Point]) -> None:
        """Write the removal rate of each contour at its upper end, inside the map.

        A rate under one of the ``marks`` is left out.
        """
        for contour in self._contours:
            upper, lower = sorted(contour.ends, key=lambda point: -point[1])
            ((x, y),) = self._pixels([_between(upper, lower, 0.04)])
            width = length(contour.text, SMALL)
            left = min(x / SCALE + 3, image.width - width - 3)
            top = y / SCALE - 3
            middle = (left + width / 2, top + SMALL / 2)
            if all(_is_clear(middle, mark, width) for mark in marks):
                write_note(image, (left, top), contour.text)

    def _draw_parts(self, draw: ImageDraw.ImageDraw, history: History) -> list[Point]:
        """Draw a point for each of the last parts, and the passes of the last one.

        Return the pixels of the passes.
        """
        for point in self._trail(history)[:-1]:
            draw_dot(draw, point, radius=5, fill=mixed(INK, 0.25))
        marks = self._pixels(
            [(math.log(cut.cutting_speed), math.log(cut.feed)) for cut in history.passes]
        )
        for mark in marks:
            _draw_marker(draw, mark)
        return marks

    def _draw_trail(self, draw: ImageDraw.ImageDraw, history: History) -> list[Point]:
        """Draw speed and feed of the last steps, and a ring at the command.

        Return the pixels of the ring and of the last step.
        """
        points = self._trail(history)
        for number, ends in enumerate(pairwise(points)):
            shade = _SHADES * number // len(points)
            draw.line(ends, fill=mixed(INK, 0.1 + 0.05 * shade), width=3)
        command = (
            math.log(history.now["commanded_cutting_speed"]),
            math.log(history.now["commanded_feed"]),
        )
        (ring,) = self._pixels([command])
        draw_dot(draw, ring, radius=12, outline=INK, width=3)
        for point in points[-1:]:
            _draw_marker(draw, point)
        return [ring, *points[-1:]]

    def _trail(self, history: History) -> list[Point]:
        """Return the pixels of the last steps or parts."""
        samples: list[Sample] = list(history.samples)[-_TRAIL:]
        return self._pixels(
            [(math.log(sample.cutting_speed), math.log(sample.feed)) for sample in samples]
        )


def _draw_marker(draw: ImageDraw.ImageDraw, point: Point) -> None:
    draw_dot(draw, point, radius=9, fill=INK, outline=CARD, width=2)


def _is_clear(middle: Point, mark: Point, width: float) -> bool:
    """Return whether a label of a width about a point [pixels] does not touch a mark of the map."""
    across = abs(middle[0] - mark[0] / SCALE)
    down = abs(middle[1] - mark[1] / SCALE)
    return across > width / 2 + _MARK_RADIUS or down > SMALL / 2 + _MARK_RADIUS
