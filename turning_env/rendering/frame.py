"""One frame: the cards, what stands still on them, and what moves."""

import numpy as np
from PIL import Image

from turning_env.rendering.bar_view import BarView
from turning_env.rendering.dials import Dials
from turning_env.rendering.edge_view import EdgeView
from turning_env.rendering.feed_map import FeedMap
from turning_env.rendering.lane import Lane
from turning_env.rendering.load_strip import LoadStrip
from turning_env.rendering.operating_map import OperatingMap
from turning_env.rendering.readings import Readings
from turning_env.rendering.theme import HEIGHT, INK, OVER, PAPER, QUIET, WIDTH, Box, Pixels, card, length, put, write
from turning_env.scenario import Scenario

_BAR: Box = (16, 46, WIDTH - 16, 306)
_DIALS: Box = (16, 316, 436, HEIGHT - 12)
_MAP: Box = (446, 316, WIDTH - 16, HEIGHT - 12)
_HEADER = (16, 8)


class Frame:
    """The picture of one lathe, drawn anew only where something moves.

    Args:
        scenario: what is played.
        title: what stands at the top.
    """

    def __init__(self, scenario: Scenario, title: str) -> None:
        self._scenario, self._title = scenario, title
        self._bar, self._strip = BarView(scenario), LoadStrip(scenario)
        self._map = (FeedMap if scenario.control.action == "override" else OperatingMap)(scenario, _MAP)
        views = (Dials(scenario, _DIALS), EdgeView(scenario, _DIALS), Readings(scenario, _DIALS))
        self._views = (self._bar, self._strip, *views, self._map)
        image = Image.new("RGB", (WIDTH, HEIGHT), PAPER)
        for box in (_BAR, _DIALS, _MAP):
            card(image, box)
        self._bar.draw_axes(image, _BAR)
        self._strip.draw_axes(image, _BAR)
        self._map.draw_axes(image, _MAP)
        self._pixels: Pixels = np.array(image)

    def draw(self, lane: Lane) -> Pixels:
        """The lathe as it is now: uint8, shape (HEIGHT, WIDTH, 3), which is the caller's own."""
        self._write_header(lane)
        for view in self._views:
            view.draw(self._pixels, lane)
        return self._pixels.copy()

    def _write_header(self, lane: Lane) -> None:
        scenario, workpiece = self._scenario, self._scenario.workpiece
        image = Image.new("RGB", (WIDTH - 2 * _HEADER[0], 34), PAPER)
        write(image, (0, 4), self._title, 17)
        x = length(self._title, 17) + 16
        bad = lane.state in ("edge broken", "edge worn out")
        number = f"{lane.bar + 1} of {workpiece.bars}" if workpiece.bars else f"{lane.bar + 1}"
        what = "part" if scenario.control.action == "part" else "bar"
        write(image, (x, 7), lane.state, 14, OVER if bad else INK)
        write(image, (x + length(lane.state, 14) + 14, 7), f"{what} {number}", 14, QUIET)
        limit = scenario.control.time_limit
        if limit < 2.0:
            clock = f"{lane.time:.1f} of {60 * limit:.0f} s"
        elif scenario.control.interval < 0.1:
            clock = f"{lane.time:.1f} s"
        elif scenario.control.action == "part":
            clock = f"{lane.time / 60.0:.1f} min"
        else:
            clock = f"{lane.time / 60.0:.1f} of {limit:g} min"
        name = "profit" if scenario.control.edge_changes == "commanded" else "return"
        texts = [f"{name} {lane.total:.1f} s", f"{lane.removed:.0f} cm3", clock]
        if scenario.control.edge_changes != "end":
            broken = f" ({lane.broken:.0f} broken)" if lane.broken else ""
            texts.insert(1, f"{lane.edges:.1f} edges used{broken}")
        right = float(image.width)
        for text in texts:
            write(image, (right, 7), text, 14, INK, "right")
            right -= length(text, 14) + 22
        put(self._pixels, image, _HEADER)
