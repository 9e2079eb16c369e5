"""Frames: their cards with a fixed background and moving parts."""

import numpy as np
from PIL import Image, ImageDraw

from turning_env.scenario import Scenario
from turning_render.bar import BarView, LoadStrip
from turning_render.gauges import Gauges
from turning_render.history import History
from turning_render.maps import FeedMap, OperatingMap
from turning_render.theme import CARD, HEIGHT, INK, OVER, PAPER, QUIET, RULE, WIDTH, Box, Pixels, length, put, write

_BAR: Box = (16, 46, WIDTH - 16, 306)
_DIALS: Box = (16, 316, 436, HEIGHT - 12)
_MAP: Box = (446, 316, WIDTH - 16, HEIGHT - 12)
_HEADER = (16, 8)


class Frame:
    """The picture of one environment; only moving parts are redrawn.

    Args:
        scenario: scenario of the environment.
        title: title at the top.
    """

    def __init__(self, scenario: Scenario, title: str) -> None:
        self._scenario, self._title = scenario, title
        self._bar, self._strip = BarView(scenario), LoadStrip(scenario)
        self._map = (FeedMap if scenario.control.action == "override" else OperatingMap)(scenario, _MAP)
        self._views = (self._bar, self._strip, Gauges(scenario, _DIALS), self._map)
        image = Image.new("RGB", (WIDTH, HEIGHT), PAPER)
        for box in (_BAR, _DIALS, _MAP):
            left, top, right, bottom = box
            ImageDraw.Draw(image).rounded_rectangle((left, top, right - 1, bottom - 1), 8, fill=CARD, outline=RULE)
        self._bar.draw_axes(image, _BAR)
        self._strip.draw_axes(image, _BAR)
        self._map.draw_axes(image, _MAP)
        self._pixels: Pixels = np.array(image)

    def draw(self, history: History) -> Pixels:
        """Return a picture of the present state, the caller's own: uint8, shape (HEIGHT, WIDTH, 3)."""
        self._write_header(history)
        for view in self._views:
            view.draw(self._pixels, history)
        return self._pixels.copy()

    def _write_header(self, history: History) -> None:
        scenario, workpiece = self._scenario, self._scenario.workpiece
        image = Image.new("RGB", (WIDTH - 2 * _HEADER[0], 34), PAPER)
        write(image, (0, 4), self._title, 17)
        x = length(self._title, 17) + 16
        bad = history.state in ("edge broken", "edge worn out")
        number = f"{history.bar + 1} of {workpiece.bars}" if workpiece.bars else f"{history.bar + 1}"
        what = "part" if scenario.control.action == "part" else "bar"
        write(image, (x, 7), history.state, 14, OVER if bad else INK)
        write(image, (x + length(history.state, 14) + 14, 7), f"{what} {number}", 14, QUIET)
        limit = scenario.control.time_limit
        if limit < 2.0:
            clock = f"{history.time:.1f} of {60 * limit:.0f} s"
        elif scenario.control.interval < 0.1:
            clock = f"{history.time:.1f} s"
        elif scenario.control.action == "part":
            clock = f"{history.time / 60.0:.1f} min"
        else:
            clock = f"{history.time / 60.0:.1f} of {limit:.4g} min"
        name = "profit" if scenario.control.edge_changes == "commanded" else "return"
        texts = [clock]
        if history.whole:  # otherwise they are not known
            texts = [f"{name} {history.total:.1f} s", f"{history.removed:.0f} cm3", clock]
            if scenario.control.edge_changes != "end":
                broken = f" ({history.broken:.0f} broken)" if history.broken else ""
                texts.insert(1, f"{history.edges:.1f} edges used{broken}")
        right = float(image.width)
        for text in texts:
            write(image, (right, 7), text, 14, INK, "right")
            right -= length(text, 14) + 22
        put(self._pixels, image, _HEADER)
