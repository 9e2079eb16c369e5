"""Frames: their cards with a fixed background and moving parts."""

import numpy as np
from PIL import Image, ImageDraw

from turning_env.rendering.bar import BarView, LoadChart
from turning_env.rendering.gauges import Gauges
from turning_env.rendering.history import History
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

_BAR: Box = (16, 46, WIDTH - 16, 306)
_GAUGES: Box = (16, 316, 436, HEIGHT - 12)
_MAP: Box = (446, 316, WIDTH - 16, HEIGHT - 12)
_HEADER = (16, 8)


class Frame:
    """The picture of one environment under a title; only moving parts are redrawn."""

    def __init__(self, scenario: Scenario, title: str) -> None:
        self.scenario, self._title = scenario, title
        bar, chart, operating_map = (
            BarView(scenario),
            LoadChart(scenario),
            OperatingMap(scenario, _MAP),
        )
        self._views = (bar, chart, Gauges(scenario, _GAUGES), operating_map)
        image = Image.new("RGB", (WIDTH, HEIGHT), PAPER)
        for box in (_BAR, _GAUGES, _MAP):
            left, top, right, bottom = box
            ImageDraw.Draw(image).rounded_rectangle(
                (left, top, right - 1, bottom - 1), 8, fill=CARD, outline=RULE
            )
        bar.draw_axes(image, _BAR)
        chart.draw_axes(image, _BAR)
        operating_map.draw_axes(image, _MAP)
        self._pixels: Pixels = np.array(image)

    def draw(self, history: History) -> Pixels:
        """Return a picture of the present state, the caller's own: uint8, shape (HEIGHT, WIDTH, 3)."""
        self._write_header(history)
        for view in self._views:
            view.draw(self._pixels, history)
        return self._pixels.copy()

    def _write_header(self, history: History) -> None:
        scenario, workpiece = self.scenario, self.scenario.workpiece
        image = Image.new("RGB", (WIDTH - 2 * _HEADER[0], 34), PAPER)
        write(image, (0, 4), self._title, 17)
        x = length(self._title, 17) + 16
        bad = history.state in ("edge broken", "edge worn out")
        number = (
            f"{history.bar + 1} of {workpiece.bars}" if workpiece.bars else f"{history.bar + 1}"
        )
        what = "part" if scenario.control.action == "part" else "bar"
        write(image, (x, 7), history.state, 14, OVER if bad else INK)
        write(image, (x + length(history.state, 14) + 14, 7), f"{what} {number}", 14, QUIET)
        clock = (
            f"{history.time:.1f} s"
            if scenario.control.interval < 0.1
            else f"{history.time / 60.0:.1f} min"
        )
        name = "profit" if scenario.control.edge_changes == "commanded" else "return"
        sums = (
            [f"{history.removed:.0f} cm3", f"{name} {history.total:.1f} s"] if history.whole else []
        )  # otherwise not known
        write(image, (image.width, 7), "      ".join([clock, *sums]), 14, INK, "right")
        put(self._pixels, image, _HEADER)
