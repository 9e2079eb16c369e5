"""The bar in section with the tool at work on it, and below it the loads, or the roughness, along the bar."""

import math
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from turning_env.scenario import Scenario
from turning_render import theme as ui
from turning_render.fields import Array
from turning_render.history import History, along

LEFT, RIGHT = 76, 926
"""Pixels between which everything along the bar is drawn."""
_ROOF, _TOP, _SURFACE, _BOTTOM = 74, 88, 174, 208
"""Pixel rows: top of the redrawn area, top of the allowance, finished surface, and bottom of the bar."""
_STRIP_TOP, _STRIP_BOTTOM = 216, 273
_MAX_LOAD = 1.5
"""Highest load shown, over its limit [-]."""
_SOFT, _HARD = 0.75, 1.25
"""Relative hardness at the ends of the scale of tints."""
_CHIP_LENGTH = 13.0
"""Path on which a chip grows before it breaks off [mm] (assumption)."""
_PLACES = 212
"""Number of places along the bar at which hardness and allowance are computed."""
_PATCH = (-70, 46, 8)
"""Extent of the tool and the chip around the tool's tip: left, right and below the surface [pixels]."""
_NODES_IN_VIEW = 80
"""Number of correlation lengths of hardness shown at a time: more could not be distinguished."""
_ALONG = {"place": "place along the bar [mm]", "time": "machine time [min]", "part": "number of the part"}
"""Labels of the horizontal axis of loads."""


def stretch_in_view(scenario: Scenario, along: float) -> tuple[float, float]:
    """Return the stretch of bar [mm] shown while the tool is at a place along it: all, or a page of a fine-grained bar."""
    workpiece = scenario.workpiece
    size = workpiece.bar_length
    if workpiece.hardness_along_spread > 0.0:
        size = min(size, _NODES_IN_VIEW * workpiece.hardness_correlation_length)
    page = max(min(int(along // size), int((workpiece.bar_length - 1e-9) // size)), 0)
    before = max(0.075 * size, workpiece.approach if size == workpiece.bar_length else 0.0)  # room for the tool
    return page * size - before, (page + 1) * size + 0.025 * size


def place_axis(ends: tuple[float, float], width: int, height: int, most: int, top: int) -> Image.Image:
    """Return an axis of places between two ends [mm], ``width`` long, with 15 pixels on its left and right.

    It has at most ``most`` numbers; its ticks begin at ``top`` [pixels].
    """
    image = Image.new("RGB", (width + 30, height), ui.CARD)
    across = ui.Ruler(*ends, 15, width + 15)
    for tick in ui.round_ticks(max(ends[0], 0.0), ends[1], most):
        ImageDraw.Draw(image).line((across(tick), top, across(tick), top + 3), fill=ui.FAINT)
        ui.write(image, (across(tick), 2 + 2 * top), f"{tick:g}", 11, ui.QUIET, "middle")
    return image


def fields_in_view(scenario: Scenario, history: History, across: ui.Ruler, count: int) -> tuple[list[float], Array, Array]:
    """Return pixels, hardness [-] and allowance [mm] of those of ``count`` places along a ruler [mm] that lie in the bar."""
    step = (across.end - across.start) / count
    places = across.start + step * (np.arange(count) + 0.5)
    inside = np.asarray(places[(places > 0.0) & (places < scenario.workpiece.bar_length)], np.float64)
    return [across(place) for place in inside.tolist()], *history.fields.along(history.key, history.bar, inside)


class BarView:
    """A view of the bar that is being turned."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        workpiece = scenario.workpiece
        nominal = max(workpiece.depth_profile, default=workpiece.depth_of_cut)
        spread = math.hypot(workpiece.depth_bar_spread, workpiece.depth_along_spread)
        self._height = ui.Ruler(0.0, max(1.25 * nominal, nominal + 2.6 * spread), _SURFACE, _TOP)
        self._shown: Any = None

    def draw_axes(self, image: Image.Image, box: ui.Box) -> None:
        """Draw the scales of allowance and hardness, which never change."""
        draw = ImageDraw.Draw(image)
        title = f"bar of {self._scenario.workpiece.bar_length:.4g} mm"
        ui.write(image, (box[0] + 12, box[1] + 8), title, 15)
        note = "true allowance and hardness, hidden from the policy"
        ui.write(image, (box[0] + 26 + ui.length(title, 15), box[1] + 11), note, 11, ui.QUIET)
        ui.write_up(image, (box[0] + 8, 0.5 * (_TOP + _SURFACE)), "allowance [mm]")
        for tick in ui.round_ticks(0.0, self._height.end, 5):
            y = self._height(tick)
            draw.line((LEFT - 8, y, LEFT - 4, y), fill=ui.FAINT)
            ui.write(image, (LEFT - 11, y - 8), f"{tick:g}", 11, ui.QUIET, "right")
        left, top = RIGHT - 190, box[1] + 11
        scale = _tints(np.linspace(_SOFT, _HARD, 90))[np.newaxis].repeat(10, axis=0)
        image.paste(Image.fromarray(scale), (left, top))
        ui.write(image, (left - 6, top - 3), f"hardness {_SOFT:g}", 11, ui.QUIET, "right")
        ui.write(image, (left + 96, top - 3), f"{_HARD:g} of nominal", 11, ui.QUIET)
        for x in range(left - 230, left - 206, 9):  # as the drawing's depth is dashed
            draw.line((x, top + 5, x + 5, top + 5), fill=ui.QUIET)
        ui.write(image, (left - 199, top - 3), "nominal allowance", 11, ui.QUIET)

    def draw(self, frame: ui.Pixels, history: History) -> None:
        """Draw the bar as it is now: cut on the tool's left, uncut on its right."""
        start, end = stretch_in_view(self._scenario, history.along)
        across = ui.Ruler(start, end, LEFT, RIGHT)
        shown = (history.key, history.bar, start, bool(history.passes))
        if shown != self._shown:
            self._shown = shown
            self._uncut, self._cut = self._layers(history, across)
        turned = bool(history.passes) or history.ended == "job finished"
        tip = RIGHT if turned else round(across.within(history.along))
        view = frame[_ROOF:_BOTTOM, LEFT:RIGHT]
        view[:, : tip - LEFT] = self._cut[:, : tip - LEFT]
        view[:, tip - LEFT :] = self._uncut[:, tip - LEFT :]
        if history.passes:
            self._name_passes(frame, history, across)
        elif not turned:
            self._draw_tool(frame, history, tip)

    def _layers(self, history: History, across: ui.Ruler) -> tuple[ui.Pixels, ui.Pixels]:
        """Return the stretch in view before and after it is cut."""
        workpiece, height = self._scenario.workpiece, self._height
        pixels, hardness, depth = fields_in_view(self._scenario, history, across, _PLACES)
        xs = [ui.SCALE * (pixel - LEFT) for pixel in pixels]
        ends = [ui.SCALE * (across.within(place) - LEFT) for place in (0.0, workpiece.bar_length)]
        xs[0], xs[-1] = ends
        tops = [ui.SCALE * (height.within(each) - _ROOF) for each in depth.tolist()]
        floor = ui.SCALE * (_SURFACE - _ROOF)
        uncut = Image.new("RGB", (ui.SCALE * (RIGHT - LEFT), floor + ui.SCALE), ui.CARD)
        # Tints have no borders that would need to be smoothed.
        tints = Image.fromarray(_tints(hardness)[np.newaxis])
        first, last = (round(end / ui.SCALE) for end in ends)
        body = np.full((_BOTTOM - _SURFACE - 1, RIGHT - LEFT, 3), ui.CARD, np.uint8)
        body[:, first:last] = np.asarray(tints.resize((last - first, 1), Image.Resampling.BILINEAR))
        # A whole part is shown as it was before, with its passes: it has no stretch that is cut.
        cut = None if history.passes else uncut.copy()
        outline = list(zip(xs, tops, strict=True))
        ImageDraw.Draw(uncut).polygon([(xs[0], floor), *outline, (xs[-1], floor)], fill=ui.ALLOWANCE)
        ImageDraw.Draw(uncut).line(outline, fill=ui.mixed(ui.QUIET, 0.7), width=2)
        if cut is not None:
            ImageDraw.Draw(cut).line(outline, fill=ui.mixed(ui.FAINT, 0.5), width=2)
        for image in filter(None, (uncut, cut)):
            draw = ImageDraw.Draw(image)
            draw.line((ends[0], floor, ends[1], floor), fill=ui.INK, width=3)
            for x in range(round(ends[0]), round(ends[1]), 24):  # the drawing's depth, dashed
                nominal = self._nominal_depth((x - ends[0]) / (ends[1] - ends[0]), across)
                y = ui.SCALE * (height(nominal) - _ROOF)
                draw.line((x, y, x + 12, y), fill=ui.QUIET, width=2)
        before = np.concatenate([np.asarray(uncut.reduce(ui.SCALE)), body])
        return before, before if cut is None else np.concatenate([np.asarray(cut.reduce(ui.SCALE)), body])

    def _nominal_depth(self, share: float, across: ui.Ruler) -> float:
        """Return the nominal depth of cut [mm] at a share, 0 to 1, of the metal in view."""
        workpiece = self._scenario.workpiece
        if not workpiece.depth_profile:
            return workpiece.depth_of_cut
        first, last = max(across.start, 0.0), min(across.end, workpiece.bar_length)
        place = first + share * (last - first)
        section = int(place / workpiece.bar_length * len(workpiece.depth_profile))
        if workpiece.section_lengths:
            section = int(np.searchsorted(np.cumsum(workpiece.section_lengths), place, "right"))
        return workpiece.depth_profile[min(section, len(workpiece.depth_profile) - 1)]

    def _draw_tool(self, frame: ui.Pixels, history: History, tip: int) -> None:
        left, right, below = _PATCH
        box = (max(tip + left, LEFT), _ROOF, min(tip + right, RIGHT), _SURFACE + below)
        patch = ui.enlarged(Image.fromarray(frame[box[1] : box[3], box[0] : box[2]]))
        draw = ImageDraw.Draw(patch)
        x, y = ui.SCALE * (tip - box[0]), ui.SCALE * (_SURFACE - box[1])
        broken = history.now["broken"] > 0.0
        if history.now["cutting"] > 0.0 and history.now["depth_of_cut"] > 0.0:
            thickness = max(2, round(10.0 * history.now["feed"]))
            depth = ui.SCALE * (_SURFACE - self._height.within(history.depth))
            _draw_chip(draw, (x, y - 0.5 * depth), thickness, history.now["path"])
        draw.polygon([(x - 62, y - 74), (x - 18, y - 82), (x - 18, 0), (x - 62, 0)], fill=(88, 92, 98))
        corners = [(x, y - 2), (x + 6, y - 84), (x - 76, y - 92), (x - 82, y - 10)]
        if broken:
            corners[:1] = [(x - 26, y - 4), (x - 16, y - 20), (x - 6, y - 22), (x + 3, y - 40)]
        draw.polygon(corners, fill=ui.INSERT, outline=ui.INK, width=2)
        draw.ellipse((x - 50, y - 60, x - 26, y - 36), fill=ui.mixed(ui.INK, 0.6, ui.INSERT))
        worn = min(history.now["wear"] / self._scenario.tool.wear_criterion, 1.0)
        if worn > 0.0 and not broken:
            draw.line((x + 1, y - 4, x + 4, y - 4 - 60 * worn), fill=ui.INK, width=2 + round(5 * worn))
        if broken:
            for angle in range(-60, 100, 40):
                dx, dy = math.cos(math.radians(angle)), -math.sin(math.radians(angle))
                draw.line((x + 10 * dx, y - 20 + 10 * dy, x + 34 * dx, y - 20 + 34 * dy), fill=ui.OVER, width=4)
        ui.put(frame, patch.reduce(ui.SCALE), (box[0], box[1]))

    def _name_passes(self, frame: ui.Pixels, history: History, across: ui.Ruler) -> None:
        """Draw and name each pass of a whole part."""
        image = Image.fromarray(frame[_ROOF:_BOTTOM, LEFT:RIGHT])
        draw = ImageDraw.Draw(image)
        count = len(history.passes)
        left, right = (across(place) - LEFT for place in (0.0, self._scenario.workpiece.bar_length))
        for number, (speed, feed, depth) in enumerate(history.passes):
            y = self._height.within((count - 1 - number) * depth) - _ROOF
            above = self._height.within((count - number) * depth) - _ROOF
            draw.line((left, y, right, y), fill=ui.INK)
            text = f"pass {number + 1}:  {speed:.0f} m/min,  {feed:.2f} mm/rev,  {depth:.2f} mm"
            # Many thin passes are named in two columns, on a ground that no line crosses.
            middle = left + (right - left) * (0.5 if count <= 4 else 0.25 if number % 2 == 0 else 0.75)
            top, half = round(0.5 * (y + above) - 8), 0.5 * ui.length(text, 12) + 6
            bottom = min(top + 15, _SURFACE - _ROOF - 1)
            draw.rectangle((middle - half, top + 2, middle + half, bottom), fill=ui.ALLOWANCE)
            ui.write(image, (middle, top), text, 12, ui.INK, "middle")
        ui.put(frame, image, (LEFT, _ROOF))


class LoadStrip:
    """A chart of force and power over their limits, or the roughness and its reference, along the bar, over time or by part."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._along = along(scenario)
        self._holds_roughness = scenario.control.aim == "roughness"
        most = 1.5 * scenario.surface.reference_max if self._holds_roughness else _MAX_LOAD
        self._height = ui.Ruler(0.0, most, ui.SCALE * (_STRIP_BOTTOM - _STRIP_TOP), 0.0)
        self._lines = [("power", "power / limit", ui.POWER), ("force", "force / limit", ui.FORCE)]
        if self._holds_roughness:
            self._lines = [("reference", "reference", ui.INK), ("roughness", "roughness Ra", ui.SURFACE)]
        self._shown: Any = None

    def draw_axes(self, image: Image.Image, box: ui.Box) -> None:
        """Draw the scale and the legend."""
        label = "Ra [um]" if self._holds_roughness else "% of limit"
        ui.write_up(image, (box[0] + 8, 0.5 * (_STRIP_TOP + _STRIP_BOTTOM)), label)
        for tick in filter(None, ui.round_ticks(0.0, self._height.end, 4)):
            y = _STRIP_TOP + self._height(tick) / ui.SCALE
            text = f"{tick:g}" if self._holds_roughness else f"{100 * tick:.0f}"
            ui.write(image, (LEFT - 11, y - 8), text, 11, ui.QUIET, "right")
        x = RIGHT
        for _, text, colour in self._lines:
            x -= round(ui.length(text, 11))
            ui.write(image, (x, _STRIP_BOTTOM + 15), text, 11, ui.QUIET)
            ImageDraw.Draw(image).line((x - 22, _STRIP_BOTTOM + 23, x - 6, _STRIP_BOTTOM + 23), fill=colour, width=3)
            x -= 36

    def draw(self, frame: ui.Pixels, history: History) -> None:
        """Extend the lines from their ends."""
        ends = stretch_in_view(self._scenario, history.along)
        if self._along == "part":
            ends = 0.5, self._scenario.workpiece.bars + 0.5
        elif self._along == "time":
            limit = self._scenario.control.time_limit
            ends = -0.075 * limit, 1.025 * limit
        across = ui.Ruler(*ends, 0.0, ui.SCALE * (RIGHT - LEFT))
        shown = (history.key, history.bars_seen, ends)
        if shown != self._shown:
            self._shown, self._drawn = shown, 0
            self._start_sheet(frame, ends)
        draw = ImageDraw.Draw(self._sheet)
        for sample in history.along_bar[self._drawn :] if self._along == "part" else ():  # the first part has no line yet
            for name, _, colour in self._lines:
                x, y = across.within(sample.place), self._height.within(getattr(sample, name))
                draw.ellipse((x - 5, y - 5, x + 5, y + 5), fill=colour)
        for after in range(max(self._drawn, 1), len(history.along_bar)):
            before, now = history.along_bar[after - 1], history.along_bar[after]
            if not (now.cutting and before.cutting):
                continue
            for name, _, colour in self._lines:
                points = [(across.within(one.place), self._height.within(getattr(one, name))) for one in (before, now)]
                draw.line(points, fill=colour, width=3)
        self._drawn = len(history.along_bar)
        ui.put(frame, self._sheet.reduce(ui.SCALE), (LEFT, _STRIP_TOP))

    def _start_sheet(self, frame: ui.Pixels, ends: tuple[float, float]) -> None:
        self._sheet = sheet = Image.new("RGB", (ui.SCALE * (RIGHT - LEFT), ui.SCALE * (_STRIP_BOTTOM - _STRIP_TOP)), ui.CARD)
        draw = ImageDraw.Draw(sheet)
        bottom = sheet.height - 1
        if not self._holds_roughness:
            limit = self._height(1.0)
            draw.rectangle((0, 0, sheet.width, limit), fill=ui.mixed(ui.OVER, 0.07))
            draw.line((0, limit, sheet.width, limit), fill=ui.mixed(ui.OVER, 0.7), width=2)
            ui.write(sheet, (10, 6), "overload", 11 * ui.SCALE, ui.OVER)
        draw.line((0, bottom, sheet.width, bottom), fill=ui.FAINT, width=2)
        draw.line((0, 0, 0, bottom), fill=ui.RULE, width=2)
        ui.put(frame, place_axis(ends, RIGHT - LEFT, 15, 9, 0), (LEFT - 15, _STRIP_BOTTOM))
        label = Image.new("RGB", (260, 15), ui.CARD)
        ui.write(label, (130, 0), _ALONG[self._along], 11, ui.QUIET, "middle")
        ui.put(frame, label, ((LEFT + RIGHT) // 2 - 130, _STRIP_BOTTOM + 15))


def _tints(hardness: Array) -> ui.Pixels:
    """Return colours, shape (n, 3), of relative hardnesses, shape (n,)."""
    shares = np.clip((hardness - _SOFT) / (_HARD - _SOFT), 0.0, 1.0)[:, np.newaxis]
    tints: ui.Pixels = np.rint(shares * ui.HARD_TINT + (1.0 - shares) * ui.SOFT_TINT).astype(np.uint8)
    return tints


def _draw_chip(draw: ImageDraw.ImageDraw, place: ui.Point, thickness: int, path: float) -> None:
    """Draw the chip as a curl in front of the tool, which grows with the path [mm] and breaks off."""
    turns = 0.8 + 1.4 * (path / _CHIP_LENGTH % 1.0)
    radius = 17.0 + 4.0 * turns
    points = [place]
    for step in range(28):
        share = step / 27
        angle = math.pi * (1.0 + 2.0 * turns * share)
        here = radius * (1.0 - 0.32 * turns * share)
        points.append((place[0] + 10 + radius + here * math.cos(angle), place[1] - 14 + here * math.sin(angle)))
    draw.line(points, fill=ui.CHIP, width=thickness, joint="curve")
