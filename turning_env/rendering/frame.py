"""The whole picture of an environment: cards with a fixed background and moving parts."""

import numpy as np
from PIL import Image, ImageDraw

from turning_env.rendering.bar import BarView
from turning_env.rendering.gauges import Gauges
from turning_env.rendering.history import History
from turning_env.rendering.load_chart import LoadChart
from turning_env.rendering.maps import OperatingMap
from turning_env.rendering.theme import (
    CARD,
    HEIGHT,
    INK,
    OVER,
    PAPER,
    QUIET,
    RULE,
    WIDTH,
    Box,
    Pixels,
    length,
    put,
    write,
)
from turning_env.scenario import Scenario

_BAR = Box(left=16, top=46, right=WIDTH - 16, bottom=306)
_GAUGES = Box(left=16, top=316, right=436, bottom=HEIGHT - 12)
_MAP = Box(left=446, top=316, right=WIDTH - 16, bottom=HEIGHT - 12)
_HEADER = (16, 8)  # its left top corner
_HEADER_HEIGHT = 34
_TITLE_SIZE = 17
_HEADER_SIZE = 14


class Frame:
    """The picture of one environment under a title; only moving parts are redrawn."""

    def __init__(self, scenario: Scenario, title: str) -> None:
        self.scenario = scenario
        self._title = title
        self._bar = BarView(scenario)
        self._chart = LoadChart(scenario)
        self._gauges = Gauges(scenario, _GAUGES)
        self._map = OperatingMap(scenario, _MAP)
        # Fixed parts are drawn once, into the array in which the views redraw the moving ones.
        background = Image.new("RGB", (WIDTH, HEIGHT), PAPER)
        for box in (_BAR, _GAUGES, _MAP):
            ImageDraw.Draw(background).rounded_rectangle(
                (box.left, box.top, box.right - 1, box.bottom - 1),
                radius=8,
                fill=CARD,
                outline=RULE,
            )
        self._bar.draw_axes(background, _BAR)
        self._chart.draw_axes(background, _BAR)
        self._map.draw_axes(background, _MAP)
        self._pixels: Pixels = np.array(background)

    def draw(self, history: History) -> Pixels:
        """Return a new picture of the present state: uint8, shape (HEIGHT, WIDTH, 3)."""
        self._write_header(history)
        self._bar.draw(self._pixels, history)
        self._chart.draw(self._pixels, history)
        self._gauges.draw(self._pixels, history)
        self._map.draw(self._pixels, history)
        return self._pixels.copy()

    def _write_header(self, history: History) -> None:
        image = Image.new("RGB", (WIDTH - 2 * _HEADER[0], _HEADER_HEIGHT), PAPER)
        write(image, (0, 4), self._title, size=_TITLE_SIZE)
        x = length(self._title, _TITLE_SIZE) + 16
        failed = history.state in ("edge broken", "edge worn out")
        colour = OVER if failed else INK
        write(image, (x, 7), history.state, size=_HEADER_SIZE, colour=colour)
        x = x + length(history.state, _HEADER_SIZE) + 14
        write(image, (x, 7), self._bar_number(history), size=_HEADER_SIZE, colour=QUIET)
        write(
            image,
            (image.width, 7),
            "      ".join(self._sums(history)),
            size=_HEADER_SIZE,
            anchor="right",
        )
        put(self._pixels, image, _HEADER)

    def _bar_number(self, history: History) -> str:
        """Return the number of the bar or part, such as "bar 3 of 20"."""
        kind = "part" if self.scenario.control.action == "part" else "bar"
        number = f"{kind} {history.bar + 1}"
        bars = self.scenario.workpiece.bars
        return f"{number} of {bars}" if bars else number

    def _sums(self, history: History) -> list[str]:
        """Return the machine time and, if the whole episode was recorded, metal and return."""
        control = self.scenario.control
        # Episodes of so short steps take seconds.
        if control.interval < 0.1:
            clock = f"{history.time:.1f} s"
        else:
            clock = f"{history.time / 60.0:.1f} min"
        if not history.whole:
            return [clock]
        name = "profit" if control.edge_changes == "commanded" else "return"
        return [clock, f"{history.removed:.0f} cm3", f"{name} {history.total:.1f} s"]
