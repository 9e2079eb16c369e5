"""The operating map: cutting speed and feed, their feasible region, and the machine's path through it.

``OperatingMap`` shows contours of the metal removal rate, and the region that power, force and wear allow, which shrinks as the
edge wears. Figures 3, 6, 7 and 10 of Alaskari and Oraby (2018) show the same at four moments. Both axes are logarithmic, so
that contours and limits, which are power laws, are straight lines and the region is a polygon.
"""

import math
from collections.abc import Sequence
from functools import reduce
from itertools import pairwise
from typing import NamedTuple

from PIL import Image, ImageDraw

from turning_env.physics.parts import MIN_DEPTH
from turning_env.physics.spindle import idle_power_at
from turning_env.rendering import theme as ui
from turning_env.rendering.history import History
from turning_env.scenario import Scenario
from turning_env.scenario.power_law import PowerLaw

_TRAIL = 90  # past steps that the map shows
_MARGIN = 20.0  # room around the machine's ranges, so that a point at their ends is seen whole [enlarged pixels]
_CONTOUR: ui.Colour = (186, 191, 188)
_RATES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000)  # of contours [cm3/min]


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


def wear_bound(
    scenario: Scenario, cut: Cut, wear_factor: float, used_life: float, cutting_time: float
) -> HalfPlane:
    """Return the half-plane in which the edge outlasts the next step; see ``turning_env.physics.wear``.

    ``cutting_time`` of the edge is in min.
    """
    law, criterion, minutes = (
        scenario.material.wear,
        scenario.tool.wear_criterion,
        scenario.control.interval / 60.0,
    )
    if scenario.tool.wear_rule == "equivalent_time":
        left = max(1.0 - used_life, 1e-9)
        limit = criterion * (left / minutes) ** law.time
    else:
        left = max(criterion * (1.0 - used_life**law.time), 1e-9)
        limit = left / ((cutting_time + minutes) ** law.time - cutting_time**law.time)
    return bound(law, limit / wear_factor, Cut(cut.depth, cut.hardness, 1.0))


def clip(corners: Sequence[ui.Point], limit: HalfPlane) -> tuple[list[ui.Point], list[ui.Point]]:
    """Return the corners of a convex polygon clipped at a limit, and those on its line (Sutherland and Hodgman 1974)."""
    kept: list[ui.Point] = []
    crossings: list[ui.Point] = []
    for before, after in zip([*corners[-1:], *corners[:-1]], corners, strict=True):
        ours, theirs = (
            limit.cutting_speed * x + limit.feed * y - limit.room for x, y in (before, after)
        )  # negative within
        if (ours <= 0.0) != (theirs <= 0.0):
            share = ours / (ours - theirs)
            crossings.append(
                (
                    before[0] + share * (after[0] - before[0]),
                    before[1] + share * (after[1] - before[1]),
                )
            )
            kept.append(crossings[-1])
        if theirs <= 0.0:
            kept.append(after)
    return kept, crossings


class OperatingMap:
    """The map of a scenario."""

    def __init__(self, scenario: Scenario, box: ui.Box) -> None:
        self._scenario = scenario
        self._box = (box[0] + 58, box[1] + 34, box[2] - 16, box[3] - 74)
        machine = scenario.machine
        self._ends = [
            tuple(math.log(getattr(machine, f"{name}_{end}")) for end in ("min", "max"))
            for name in ("cutting_speed", "feed")
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
        lines = (
            (clip(self._corners, HalfPlane(1.0, 1.0, math.log(rate / self._depth)))[1], f"{rate}")
            for rate in _RATES
        )
        self._contours = [(line, text) for line, text in lines if len(line) == 2]

    def draw_axes(self, image: Image.Image, box: ui.Box) -> None:
        """Draw scales, titles and the key."""
        left, top, right, bottom = self._box
        draw = ImageDraw.Draw(image)
        ui.write(image, (box[0] + 12, box[1] + 8), "operating map", 15)
        ui.write_up(image, (box[0] + 8, 0.5 * (top + bottom)), "feed [mm/rev]")
        ui.write(
            image,
            (right, box[1] + 11),
            "feed over cutting speed, log scales",
            11,
            ui.QUIET,
            "right",
        )
        for tick in ui.log_ticks(*(math.exp(end) for end in self._ends[0])):
            x = left + self._across(math.log(tick)) / ui.SCALE
            draw.line((x, bottom, x, bottom + 4), fill=ui.FAINT)
            ui.write(image, (x, bottom + 5), f"{tick:g}", 11, ui.QUIET, "middle")
        for tick in ui.log_ticks(*(math.exp(end) for end in self._ends[1])):
            y = top + self._up(math.log(tick)) / ui.SCALE
            draw.line((left - 4, y, left, y), fill=ui.FAINT)
            ui.write(image, (left - 8, y - 8), f"{tick:g}", 11, ui.QUIET, "right")
        ui.write(
            image,
            (0.5 * (left + right), bottom + 19),
            "cutting speed [m/min]",
            11,
            ui.QUIET,
            "middle",
        )
        limits, aim = self._scenario.limits, self._scenario.control.aim
        entries = [
            ("allowed now", ui.mixed(ui.ALLOWED, 0.3), 11),
            (f"power limit {limits.power:.4g} kW", ui.POWER, 3),
        ]
        purple = "reference Ra" if aim == "roughness" else "wear limit"
        entries += [
            (f"force limit {limits.thrust_force:.4g} N", ui.FORCE, 3),
            (purple, ui.SURFACE, 3),
        ]
        ui.draw_key(image, (left - 46, bottom + 36), entries, 14)
        parts = self._scenario.control.action == "part"
        points = "dark: last part's passes" if parts else f"last {_TRAIL} steps; ring: command"
        entries = [
            ("allowed by nominal model", ui.QUIET, 1),
            ("MRR [cm3/min]", _CONTOUR, 1),
            (points, ui.INK, 7 if parts else 2),
        ]
        ui.draw_key(image, (left - 46, bottom + 52), entries, 14)
        draw.rectangle((left - 1, top - 1, right, bottom), outline=ui.FAINT)

    def _limits(
        self, cut: Cut, wear_factor: float, used_life: float, now: dict[str, float]
    ) -> list[tuple[HalfPlane, ui.Colour]]:
        """Return the limits at the present speed and cutting time, with their colours."""
        material, limits, base_speed = (
            self._scenario.material,
            self._scenario.limits,
            self._scenario.base_cutting_speed,
        )
        bounds = [
            (
                bound(
                    material.power,
                    limits.power - idle_power_at(self._scenario, now["cutting_speed"]),
                    cut,
                ),
                ui.POWER,
            ),
            (bound(material.thrust_force, limits.thrust_force, cut), ui.FORCE),
            (
                wear_bound(self._scenario, cut, wear_factor, used_life, now["cutting_time"]),
                ui.SURFACE,
            ),
        ]
        if base_speed > 0.0:  # the torque, which is power over speed
            power = bound(
                material.power, limits.power / base_speed - idle_power_at(self._scenario, 1.0), cut
            )
            bounds.append((power._replace(cutting_speed=power.cutting_speed - 1.0), ui.POWER))
        return bounds

    def _region(self, limits: list[tuple[HalfPlane, ui.Colour]]) -> list[ui.Point]:
        """Return the corners of what limits leave of the machine's ranges, none if nothing remains."""
        return reduce(lambda left, limit: clip(left, limit[0])[0], limits, self._corners)

    def _pixels(self, points: list[ui.Point]) -> list[tuple[float, float]]:
        return [(self._across(speed), self._up(feed)) for speed, feed in points]

    def draw(self, frame: ui.Pixels, history: History) -> None:
        """Draw the region that is allowed in the metal cut last, and the trail."""
        now, surface = history.now, self._scenario.surface
        image = self._sheet.copy()
        draw = ImageDraw.Draw(image)
        cut = Cut(
            max(history.passes[-1][2], MIN_DEPTH) if history.passes else history.depth,
            history.hardness,
            history.wear,
        )
        limits = self._limits(cut, now["wear_factor"], now["used_life"], now)
        allowed = self._region(limits)
        if len(allowed) > 2:
            draw.polygon(self._pixels(allowed), fill=ui.mixed(ui.ALLOWED, 0.22))
        for line, _ in self._contours:
            draw.line(self._pixels(line), fill=_CONTOUR, width=2)
        nominal = Cut(self._depth, 1.0, history.nominal_wear)
        believed = self._region(self._limits(nominal, 1.0, history.nominal_used_life, now))
        if len(believed) > 2:
            outline = self._pixels(believed)
            draw.line([*outline, outline[0]], fill=ui.mixed(ui.QUIET, 0.75), width=2)
        if self._scenario.control.aim == "roughness":
            force = (
                math.log(now["roughness_reference"] / surface.roughness_at_no_force)
                / surface.roughness_rate
            )
            limits.append((bound(self._scenario.material.thrust_force, force, cut), ui.SURFACE))
        for limit, colour in limits:
            if len(ends := clip(self._corners, limit)[1]) == 2:
                draw.line(self._pixels(ends), fill=colour, width=5)
        self._draw_trail(draw, history)
        image = image.reduce(ui.SCALE)
        for line, text in self._contours:  # at its upper end, inside the map
            upper, lower = sorted(line, key=lambda point: -point[1])
            x = self._across(upper[0] + 0.04 * (lower[0] - upper[0])) / ui.SCALE
            y = self._up(upper[1] + 0.04 * (lower[1] - upper[1])) / ui.SCALE
            ui.write(
                image,
                (min(x + 3, image.width - ui.length(text, 11) - 3), y - 3),
                text,
                11,
                ui.QUIET,
            )
        if len(allowed) < 3:
            ui.write(
                image,
                (image.width / 2, image.height / 2),
                "no speed and feed keeps all limits",
                13,
                ui.OVER,
                "middle",
            )
        ui.put(frame, image, (self._box[0], self._box[1]))

    def _draw_trail(self, draw: ImageDraw.ImageDraw, history: History) -> None:
        trail = list(history.samples)[-_TRAIL:]
        points = self._pixels(
            [(math.log(sample.cutting_speed), math.log(sample.feed)) for sample in trail]
        )
        if self._scenario.control.action == "part":
            for x, y in points[:-1]:
                draw.ellipse((x - 5, y - 5, x + 5, y + 5), fill=ui.mixed(ui.INK, 0.25))
            marked = self._pixels(
                [(math.log(speed), math.log(feed)) for speed, feed, _ in history.passes]
            )
        else:
            for number, ends in enumerate(pairwise(points)):
                draw.line(
                    ends, fill=ui.mixed(ui.INK, 0.1 + 0.05 * (12 * number // len(points))), width=3
                )
            command = (
                math.log(history.now["commanded_cutting_speed"]),
                math.log(history.now["commanded_feed"]),
            )
            ((x, y),) = self._pixels([command])
            draw.ellipse((x - 12, y - 12, x + 12, y + 12), outline=ui.INK, width=3)
            marked = points[-1:]
        for x, y in marked:
            draw.ellipse((x - 9, y - 9, x + 9, y + 9), fill=ui.INK, outline=ui.CARD, width=2)
