"""What the bar has cost so far: force and power over their limits along it, or the roughness that was left."""

from typing import Any

from PIL import Image, ImageDraw

from turning_env.rendering.bar_view import LEFT, RIGHT
from turning_env.rendering.lane import Lane
from turning_env.rendering.ruler import Ruler, page_of
from turning_env.rendering.theme import (
    CARD,
    FAINT,
    FORCE,
    INK,
    OVER,
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

_TOP, _BOTTOM = 216, 273
_MAX_LOAD = 1.5
"""Beyond which nothing is shown [limits]."""


class LoadStrip:
    """Draws one line for each load, along the bar; with parts, from part to part."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._parts = scenario.control.action == "part"
        self._holds_roughness = scenario.control.aim == "roughness"
        most = 1.5 * scenario.surface.reference_max if self._holds_roughness else _MAX_LOAD
        self._height = Ruler(0.0, most, SCALE * (_BOTTOM - _TOP), 0.0)
        self._lines: list[tuple[int, str, Colour]] = [(2, "power", POWER), (1, "force", FORCE)]
        if self._holds_roughness:
            self._lines = [(4, "reference", INK), (3, "roughness Ra", SURFACE)]
        self._shown: Any = None

    def draw_axes(self, image: Image.Image, box: Box) -> None:
        """The loads' scale and which line is which."""
        write(image, (box[0] + 22, _TOP - 3), "um" if self._holds_roughness else "%", 11, QUIET)
        for tick in round_ticks(0.0, self._height.end, 5):
            y = _TOP + self._height(tick) / SCALE
            if not tick:
                continue
            write(image, (LEFT - 11, y - 8), f"{tick:g}" if self._holds_roughness else f"{100 * tick:.0f}", 11, QUIET, "right")
        x = RIGHT
        for _, name, colour in self._lines:
            text = name if self._holds_roughness else f"{name} over its limit"
            x -= round(length(text, 11))
            write(image, (x, _BOTTOM + 15), text, 11, QUIET)
            ImageDraw.Draw(image).line((x - 22, _BOTTOM + 23, x - 6, _BOTTOM + 23), fill=colour, width=3)
            x -= 36

    def draw(self, frame: Pixels, lane: Lane) -> None:
        """Go on with the lines from where they had come to."""
        start, end = page_of(self._scenario, lane.along)
        if self._parts:
            start, end = 0.5, self._scenario.workpiece.bars + 0.5
        across = Ruler(start, end, 0.0, SCALE * (RIGHT - LEFT))
        shown = (lane.key, lane.course_number, start)
        if shown != self._shown:
            self._shown, self._drawn = shown, 0
            self._sheet = self._blank()
            self._write_places(frame, start, end)
        draw = ImageDraw.Draw(self._sheet)
        for after in range(max(self._drawn, 1), len(lane.course)):
            before, now = lane.course[after - 1], lane.course[after]
            if now[-1] <= 0.0 or before[-1] <= 0.0:
                continue
            for number, _, colour in self._lines:
                line = tuple(
                    coordinate
                    for point in (before, now)
                    for coordinate in (across.within(point[0]), self._height.within(point[number]))
                )
                draw.line(line, fill=colour, width=3)
        self._drawn = len(lane.course)
        put(frame, self._sheet.reduce(SCALE), (LEFT, _TOP))

    def _blank(self) -> Image.Image:
        sheet = Image.new("RGB", (SCALE * (RIGHT - LEFT), SCALE * (_BOTTOM - _TOP)), CARD)
        draw = ImageDraw.Draw(sheet)
        bottom = sheet.height - 1
        if not self._holds_roughness:
            limit = self._height(1.0)
            draw.rectangle((0, 0, sheet.width, limit), fill=mixed(OVER, 0.07))
            draw.line((0, limit, sheet.width, limit), fill=mixed(OVER, 0.7), width=2)
        draw.line((0, bottom, sheet.width, bottom), fill=FAINT, width=2)
        draw.line((0, 0, 0, bottom), fill=RULE, width=2)
        return sheet

    def _write_places(self, frame: Pixels, start: float, end: float) -> None:
        below = Image.new("RGB", (RIGHT - LEFT + 30, 15), CARD)
        across = Ruler(start, end, 15, RIGHT - LEFT + 15)
        for tick in round_ticks(max(start, 0.0), end, 9):
            ImageDraw.Draw(below).line((across(tick), 0, across(tick), 3), fill=FAINT)
            write(below, (across(tick), 2), f"{tick:g}", 11, QUIET, "middle")
        put(frame, below, (LEFT - 15, _BOTTOM))
        label = Image.new("RGB", (260, 15), CARD)
        write(label, (130, 0), "part" if self._parts else "place along the bar [mm]", 11, QUIET, "middle")
        put(frame, label, ((LEFT + RIGHT) // 2 - 130, _BOTTOM + 15))
