"""The chart of the loads of the last steps, or of roughness if it is controlled."""

from typing import NamedTuple

from PIL import Image, ImageDraw

from turning_env.rendering.bar import LEFT, RIGHT
from turning_env.rendering.history import STEPS, History
from turning_env.rendering.theme import (
    FAINT,
    FORCE,
    INK,
    OVER,
    POWER,
    SCALE,
    SMALL,
    SURFACE,
    Box,
    Colour,
    KeyEntry,
    Pixels,
    Point,
    Ruler,
    draw_dot,
    draw_key,
    enlarged_sheet,
    mixed,
    put,
    round_ticks,
    write,
    write_note,
    write_up,
)
from turning_env.scenario import Scenario

# Pixel rows of the chart.
_TOP = 230
_BOTTOM = 287

_MAX_LOAD = 1.5  # highest load shown, over its limit [-]


class _Line(NamedTuple):
    """A line of the chart."""

    field: str  # of ``Sample``
    title: str
    colour: Colour


_LOADS = (
    _Line("power", "power / limit", POWER),
    _Line("force", "force / limit", FORCE),
)
_ROUGHNESS = (
    _Line("reference", "reference", INK),
    _Line("roughness", "roughness Ra", SURFACE),
)


class LoadChart:
    """A chart of force and power over their limits in the last steps or parts.

    If roughness is controlled, it shows roughness and reference instead.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._parts = scenario.control.action == "part"
        self._steps = scenario.workpiece.bars if self._parts else STEPS
        self._shows_roughness = scenario.control.aim == "roughness"
        self._lines = _ROUGHNESS if self._shows_roughness else _LOADS
        highest = 1.5 * scenario.surface.reference_max if self._shows_roughness else _MAX_LOAD
        height = _BOTTOM - _TOP
        self._height = Ruler(start=0.0, end=highest, first=SCALE * height, last=0.0)
        self._sheet = enlarged_sheet(RIGHT - LEFT, height)
        self._draw_background()

    def _draw_background(self) -> None:
        sheet = self._sheet
        draw = ImageDraw.Draw(sheet)
        if not self._shows_roughness:
            limit = self._height(1.0)
            draw.rectangle((0, 0, sheet.width, limit), fill=mixed(OVER, 0.07))
            line = (0, limit, sheet.width, limit)
            draw.line(line, fill=mixed(OVER, 0.7), width=2)
            size = SMALL * SCALE
            write(sheet, (10, 6), "overload", size=size, colour=OVER)
        bottom = sheet.height - 1
        axes = [(0, 0), (0, bottom), (sheet.width, bottom)]
        draw.line(axes, fill=FAINT, width=2)

    def draw_axes(self, image: Image.Image, box: Box) -> None:
        """Draw the scale and the legend."""
        label = "Ra [um]" if self._shows_roughness else "% of limit"
        write_up(image, (box.left + 8, 0.5 * (_TOP + _BOTTOM)), label)
        for tick in round_ticks(0.0, self._height.end, max_ticks=4):
            if tick == 0.0:
                continue
            y = _TOP + self._height(tick) / SCALE
            text = f"{tick:g}" if self._shows_roughness else f"{100 * tick:.0f}"
            write_note(image, (LEFT - 11, y - 8), text, anchor="right")
        caption = "parts" if self._parts else f"last {self._steps} steps"
        write_note(image, (LEFT, _BOTTOM + 2), caption)
        key = [KeyEntry(line.title, line.colour, height=3) for line in self._lines]
        draw_key(image, (RIGHT - 230, _BOTTOM + 2), key)

    def draw(self, frame: Pixels, history: History) -> None:
        """Draw the lines, which are interrupted in air."""
        sheet = self._sheet.copy()
        draw = ImageDraw.Draw(sheet)
        for line in self._lines:
            for stretch in self._stretches(line.field, history):
                draw.line(stretch, fill=line.colour, width=3)
                if self._parts:  # the first has no line yet
                    for point in stretch:
                        draw_dot(draw, point, radius=5, fill=line.colour)
        put(frame, sheet.reduce(SCALE), (LEFT, _TOP))

    def _stretches(self, field: str, history: History) -> list[list[Point]]:
        """Return the points of a quantity in each stretch of metal."""
        across = Ruler(start=0.0, end=self._steps, first=0.0, last=self._sheet.width)
        stretches: list[list[Point]] = [[]]
        for number, sample in enumerate(history.samples):
            if sample.cutting:
                y = self._height.within(getattr(sample, field))
                stretches[-1].append((across(number + 0.5), y))
            elif stretches[-1]:
                stretches.append([])
        return stretches
