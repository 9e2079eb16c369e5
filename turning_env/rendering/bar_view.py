"""The bar in section, with its allowance and hardness, and the tool and chip at work on it."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from turning_env.rendering.lane import Lane
from turning_env.rendering.ruler import Ruler, page_of
from turning_env.rendering.theme import (
    ALLOWANCE,
    CARD,
    CHIP,
    FAINT,
    HARD_TINT,
    INK,
    INSERT,
    OVER,
    QUIET,
    SCALE,
    SOFT_TINT,
    Box,
    Pixels,
    enlarged,
    length,
    mixed,
    put,
    round_ticks,
    write,
)
from turning_env.scenario import Scenario

LEFT, RIGHT = 76, 926
"""Between which pixels everything along the bar is drawn."""
_ROOF, _TOP, _SURFACE, _BOTTOM = 74, 88, 174, 208
"""Of all that is drawn anew, of the allowance, of the finished surface and of the bar's part that is shown [pixel]."""
_SOFT, _HARD = 0.75, 1.25
"""Relative hardness at the ends of the scale of tints."""
_CHIP_LENGTH = 13.0
"""Of path on which a chip grows, before it breaks off [mm] (made up)."""
_STEPS = 212
"""Places at which the bar is looked at."""
_PATCH = (-70, 46, 8)
"""What the tool and the chip take up around the tool's tip: left, right and below the surface [pixels]."""


class BarView:
    """Draws the bar that is being turned."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        workpiece = scenario.workpiece
        nominal = max(workpiece.depth_profile, default=workpiece.depth_of_cut)
        spread = math.hypot(workpiece.depth_bar_spread, workpiece.depth_along_spread)
        self._height = Ruler(0.0, max(1.25 * nominal, nominal + 2.6 * spread), _SURFACE, _TOP)
        self._shown: Any = None

    def draw_axes(self, image: Image.Image, box: Box) -> None:
        """What never changes: the scale of the allowance and that of hardness."""
        draw = ImageDraw.Draw(image)
        write(image, (box[0] + 12, box[1] + 8), f"bar of {self._scenario.workpiece.bar_length:g} mm", 15)
        write(image, (box[0] + 22, _TOP - 6), "mm", 11, QUIET)
        for tick in round_ticks(0.0, self._height.end, 5):
            y = self._height(tick)
            if tick and y < _TOP + 10:
                continue
            draw.line((LEFT - 8, y, LEFT - 4, y), fill=FAINT)
            write(image, (LEFT - 11, y - 8), f"{tick:g}", 11, QUIET, "right")
        left, top = RIGHT - 190, box[1] + 11
        scale = _tints(np.linspace(_SOFT, _HARD, 90)).tolist()
        for x in range(90):
            draw.line((left + x, top, left + x, top + 9), fill=tuple(scale[x]))
        write(image, (left - 6, top - 3), f"hardness {_SOFT:g}", 11, QUIET, "right")
        write(image, (left + 96, top - 3), f"{_HARD:g} of nominal", 11, QUIET)
        note = "allowance and tints are true, and hidden from the controller"
        write(image, (left - 92 - length(note, 11), top - 3), note, 11, FAINT)

    def draw(self, frame: Pixels, lane: Lane) -> None:
        """The bar as it is now, what is cut of it on the tool's left."""
        start, end = page_of(self._scenario, lane.along)
        across = Ruler(start, end, LEFT, RIGHT)
        shown = (lane.key, lane.bar, start, bool(lane.passes))
        if shown != self._shown:
            self._shown = shown
            self._uncut, self._cut = self._layers(lane, across)
        turned = bool(lane.passes) or lane.ended == "job finished"
        tip = RIGHT if turned else round(across.within(lane.along))
        view = frame[_ROOF:_BOTTOM, LEFT:RIGHT]
        view[:, : tip - LEFT] = self._cut[:, : tip - LEFT]
        view[:, tip - LEFT :] = self._uncut[:, tip - LEFT :]
        if lane.passes:
            self._name_passes(frame, lane, across)
        elif not turned:
            self._draw_tool(frame, lane, tip)

    def _layers(self, lane: Lane, across: Ruler) -> tuple[Pixels, Pixels]:
        """The stretch in view before and after it is cut."""
        workpiece, height = self._scenario.workpiece, self._height
        step = (across.end - across.start) / _STEPS
        places = across.start + step * (np.arange(_STEPS) + 0.5)
        inside = (places > 0.0) & (places < workpiece.bar_length)
        hardness, depth = lane.fields.along(lane.key, lane.bar, np.ascontiguousarray(places[inside]))
        xs = [SCALE * (across(place) - LEFT) for place in places[inside].tolist()]
        ends = [SCALE * (across.within(place) - LEFT) for place in (0.0, workpiece.bar_length)]
        xs[0], xs[-1] = ends
        tops = [SCALE * (height.within(each) - _ROOF) for each in depth.tolist()]
        floor = SCALE * (_SURFACE - _ROOF)
        uncut = Image.new("RGB", (SCALE * (RIGHT - LEFT), floor + SCALE), CARD)
        # Tints have no borders that would need to be smoothed.
        tints = Image.fromarray(_tints(hardness)[np.newaxis])
        first, last = (round(end / SCALE) for end in ends)
        body = np.full((_BOTTOM - _SURFACE - 1, RIGHT - LEFT, 3), CARD, np.uint8)
        body[:, first:last] = np.asarray(tints.resize((last - first, 1), Image.Resampling.BILINEAR))
        # A whole part is shown as it was before, with its passes: it has no stretch that is cut.
        cut = None if lane.passes else uncut.copy()
        outline = list(zip(xs, tops, strict=True))
        ImageDraw.Draw(uncut).polygon([(xs[0], floor), *outline, (xs[-1], floor)], fill=ALLOWANCE)
        ImageDraw.Draw(uncut).line(outline, fill=mixed(QUIET, 0.7), width=2)
        if cut is not None:
            ImageDraw.Draw(cut).line(outline, fill=mixed(FAINT, 0.5), width=2)
        for image in filter(None, (uncut, cut)):
            draw = ImageDraw.Draw(image)
            draw.line((ends[0], floor, ends[1], floor), fill=INK, width=3)
            for x in range(round(ends[0]), round(ends[1]), 24):  # the drawing's depth, dashed
                nominal = self._nominal_depth((x - ends[0]) / (ends[1] - ends[0]), across)
                y = SCALE * (height(nominal) - _ROOF)
                draw.line((x, y, x + 12, y), fill=QUIET, width=2)
        before = np.concatenate([np.asarray(uncut.reduce(SCALE)), body])
        return before, before if cut is None else np.concatenate([np.asarray(cut.reduce(SCALE)), body])

    def _nominal_depth(self, share: float, across: Ruler) -> float:
        """What the drawing has [mm] at a share of the metal in view."""
        workpiece = self._scenario.workpiece
        if not workpiece.depth_profile:
            return workpiece.depth_of_cut
        first, last = max(across.start, 0.0), min(across.end, workpiece.bar_length)
        section = int((first + share * (last - first)) / workpiece.bar_length * len(workpiece.depth_profile))
        return workpiece.depth_profile[min(section, len(workpiece.depth_profile) - 1)]

    def _draw_tool(self, frame: Pixels, lane: Lane, tip: int) -> None:
        left, right, below = _PATCH
        box = (max(tip + left, LEFT), _ROOF, min(tip + right, RIGHT), _SURFACE + below)
        patch = enlarged(Image.fromarray(frame[box[1] : box[3], box[0] : box[2]]))
        draw = ImageDraw.Draw(patch)
        x, y = SCALE * (tip - box[0]), SCALE * (_SURFACE - box[1])
        cuts = lane.now["cutting"] > 0.0 and lane.now["depth_of_cut"] > 0.0
        if cuts:
            thickness = max(2, round(10.0 * lane.now["feed"]))
            depth = SCALE * (_SURFACE - self._height.within(lane.depth))
            _draw_chip(draw, (x, y - 0.5 * depth), thickness, lane.now["path"])
        draw.polygon([(x - 62, y - 74), (x - 18, y - 82), (x - 18, 0), (x - 62, 0)], fill=(88, 92, 98))
        corners = [(x, y - 2), (x + 6, y - 84), (x - 76, y - 92), (x - 82, y - 10)]
        if lane.now["broken"] > 0.0:
            corners[:1] = [(x - 26, y - 4), (x - 16, y - 20), (x - 6, y - 22), (x + 3, y - 40)]
        draw.polygon(corners, fill=INSERT, outline=INK, width=2)
        draw.ellipse((x - 50, y - 60, x - 26, y - 36), fill=mixed(INK, 0.6, INSERT))
        worn = min(lane.now["wear"] / self._scenario.tool.wear_criterion, 1.0)
        if worn > 0.0 and not lane.now["broken"]:
            draw.line((x + 1, y - 4, x + 4, y - 4 - 60 * worn), fill=INK, width=2 + round(5 * worn))
        if lane.now["broken"] > 0.0:
            for angle in range(-60, 100, 40):
                dx, dy = math.cos(math.radians(angle)), -math.sin(math.radians(angle))
                draw.line((x + 10 * dx, y - 20 + 10 * dy, x + 34 * dx, y - 20 + 34 * dy), fill=OVER, width=4)
        put(frame, patch.reduce(SCALE), (box[0], box[1]))

    def _name_passes(self, frame: Pixels, lane: Lane, across: Ruler) -> None:
        """Where each pass of a whole part ran, and how."""
        image = Image.fromarray(frame[_ROOF:_BOTTOM, LEFT:RIGHT])
        draw = ImageDraw.Draw(image)
        count = len(lane.passes)
        left, right = (across(place) - LEFT for place in (0.0, self._scenario.workpiece.bar_length))
        for number, (speed, feed, depth) in enumerate(lane.passes):
            y = self._height.within((count - 1 - number) * depth) - _ROOF
            above = self._height.within((count - number) * depth) - _ROOF
            draw.line((left, y, right, y), fill=INK)
            text = f"pass {number + 1}:  {speed:.0f} m/min,  {feed:.2f} mm/rev,  {depth:.2f} mm"
            write(image, (0.5 * (left + right), 0.5 * (y + above) - 8), text, 12, INK, "middle")
        put(frame, image, (LEFT, _ROOF))


def _tints(hardness: NDArray[np.float64]) -> Pixels:
    """Colours, shape (n, 3), of hardnesses, shape (n,)."""
    shares = np.clip((hardness - _SOFT) / (_HARD - _SOFT), 0.0, 1.0)[:, np.newaxis]
    tints: Pixels = np.rint(shares * HARD_TINT + (1.0 - shares) * SOFT_TINT).astype(np.uint8)
    return tints


def _draw_chip(draw: ImageDraw.ImageDraw, place: tuple[float, float], thickness: int, path: float) -> None:
    """A curl in front of the tool, as thick as the chip, which grows as the tool goes on, and breaks off."""
    turns = 0.8 + 1.4 * (path / _CHIP_LENGTH % 1.0)
    radius = 17.0 + 4.0 * turns
    points = [place]
    for step in range(28):
        share = step / 27
        angle = math.pi * (1.0 + 2.0 * turns * share)
        here = radius * (1.0 - 0.32 * turns * share)
        points.append((place[0] + 10 + radius + here * math.cos(angle), place[1] - 14 + here * math.sin(angle)))
    draw.line(points, fill=CHIP, width=thickness, joint="curve")
