"""The bar in section with the tool at work on it, and below it the loads, or the roughness, of the last steps."""

import math
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from turning_env.rendering import theme as ui
from turning_env.rendering.fields import Array
from turning_env.rendering.history import STEPS, History
from turning_env.scenario import Scenario

_LEFT, _RIGHT = 76, 926  # pixels between which the bar and the chart are drawn
_ROOF, _TOP, _SURFACE, _BOTTOM, _AXIS = 74, 88, 174, 206, 16
"""Pixel rows: top of the redrawn area, top of the allowance, finished surface, and bottom of the bar; height of its axis."""
_CHART_TOP, _CHART_BOTTOM = 230, 287
_MAX_LOAD = 1.5  # highest load shown, over its limit [-]
_SOFT, _HARD = 0.75, 1.25  # relative hardness at the ends of the scale of tints
_PLACES = 212  # along the bar, at which hardness and allowance are computed
_MARGIN = 8  # pixels on either side of the bar that belong to its axis
_NODES_IN_VIEW = (
    80  # number of correlation lengths of hardness shown at a time: more could not be distinguished
)


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
            draw.line((_LEFT - 13, y, _LEFT - 9, y), fill=ui.FAINT)
            ui.write(image, (_LEFT - 16, y - 8), f"{tick:g}", 11, ui.QUIET, "right")
        left, top = _RIGHT - 190, box[1] + 11
        scale = _tints(np.linspace(_SOFT, _HARD, 90))[np.newaxis].repeat(10, axis=0)
        image.paste(Image.fromarray(scale), (left, top))
        ui.write(image, (left - 6, top - 3), f"hardness {_SOFT:g}", 11, ui.QUIET, "right")
        ui.write(image, (left + 96, top - 3), f"{_HARD:g} of nominal", 11, ui.QUIET)
        ui.write(image, (left - 260, top - 3), "dashed: nominal allowance", 11, ui.QUIET)

    def draw(self, frame: ui.Pixels, history: History) -> None:
        """Draw the bar as it is now: cut on the tool's left, uncut on its right; a whole part as it was, with its passes."""
        start, end = self._stretch(history.along)
        across = ui.Ruler(start, end, _LEFT, _RIGHT)
        shown = (history.key, history.bar, start)
        if shown != self._shown:
            self._shown = shown
            self._uncut, self._cut = (
                self._layer(history, across, uncut) for uncut in (True, False)
            )
        finished = history.ended == "job finished"
        tip = (
            _LEFT if history.passes else _RIGHT if finished else round(across.within(history.along))
        )
        view = frame[_ROOF : _BOTTOM + _AXIS, _LEFT - _MARGIN : _RIGHT + _MARGIN]
        view[:] = self._uncut
        view[:, : tip - _LEFT + _MARGIN] = self._cut[:, : tip - _LEFT + _MARGIN]
        if history.passes:
            self._name_passes(frame, history, across)
        elif not finished:
            self._draw_tool(frame, history, tip)

    def _stretch(self, along: float) -> tuple[float, float]:
        """Return the stretch of bar [mm] shown while the tool is at a place along it: all, or a page of a fine-grained bar."""
        workpiece = self._scenario.workpiece
        size = workpiece.bar_length
        if workpiece.hardness_along_spread > 0.0:
            size = min(size, _NODES_IN_VIEW * workpiece.hardness_correlation_length)
        page = max(min(int(along // size), int((workpiece.bar_length - 1e-9) // size)), 0)
        before = max(
            0.075 * size, workpiece.approach if size == workpiece.bar_length else 0.0
        )  # room for the tool
        return page * size - before, (page + 1) * size + 0.025 * size

    def _layer(self, history: History, across: ui.Ruler, uncut: bool) -> ui.Pixels:
        """Return the stretch in view before or after it is cut, with its axis and margins."""
        height, length = self._height, self._scenario.workpiece.bar_length
        left = _LEFT - _MARGIN
        places = np.linspace(
            max(across.start, 0.0), min(across.end, length * (1.0 - 1e-9)), _PLACES
        )
        hardness, depth = history.fields.along(history.key, history.bar, places)
        xs = [ui.SCALE * (across(place) - left) for place in places.tolist()]
        floor = ui.SCALE * (_SURFACE - _ROOF)
        sheet = Image.new(
            "RGB",
            (ui.SCALE * (_RIGHT + _MARGIN - left), ui.SCALE * (_BOTTOM + _AXIS - _ROOF)),
            ui.CARD,
        )
        draw = ImageDraw.Draw(sheet)
        outline = [
            (x, ui.SCALE * (height.within(each) - _ROOF))
            for x, each in zip(xs, depth.tolist(), strict=True)
        ]
        if uncut:
            draw.polygon([(xs[0], floor), *outline, (xs[-1], floor)], fill=ui.ALLOWANCE)
        draw.line(
            outline, fill=ui.mixed(ui.QUIET, 0.7) if uncut else ui.mixed(ui.FAINT, 0.5), width=2
        )
        for x, nominal in list(zip(xs, self._nominal_depths(places).tolist(), strict=True))[::3]:
            y = ui.SCALE * (height(nominal) - _ROOF)
            draw.line((x, y, x + 12, y), fill=ui.QUIET, width=2)
        tints = Image.fromarray(_tints(hardness)[np.newaxis])
        body = tints.resize(
            (round(xs[-1] - xs[0]), ui.SCALE * (_BOTTOM - _SURFACE)), Image.Resampling.BILINEAR
        )
        sheet.paste(body, (round(xs[0]), floor))
        draw.line((xs[0], floor, xs[-1], floor), fill=ui.INK, width=3)
        layer = sheet.reduce(ui.SCALE)
        for tick in ui.round_ticks(max(across.start, 0.0), across.end, 9):
            ui.write(
                layer,
                (across(tick) - left, _BOTTOM - _ROOF + 1),
                f"{tick:g} mm",
                11,
                ui.QUIET,
                "middle",
            )
        return np.asarray(layer)

    def _nominal_depths(self, places: Array) -> Array:
        """Return the nominal depths of cut [mm] at places along the bar [mm]."""
        workpiece = self._scenario.workpiece
        depths = np.array(workpiece.depth_profile or (workpiece.depth_of_cut,))
        lengths = workpiece.section_lengths or np.full(
            len(depths), workpiece.bar_length / len(depths)
        )
        sections: Array = depths[
            np.minimum(np.searchsorted(np.cumsum(lengths), places, "right"), len(depths) - 1)
        ]
        return sections

    def _draw_tool(self, frame: ui.Pixels, history: History, tip: int) -> None:
        box = (max(tip - 46, _LEFT), _ROOF, min(tip + 8, _RIGHT), _SURFACE + 2)
        patch = ui.enlarged(Image.fromarray(frame[box[1] : box[3], box[0] : box[2]]))
        draw = ImageDraw.Draw(patch)
        x, y = ui.SCALE * (tip - box[0]), ui.SCALE * (_SURFACE - box[1])
        draw.polygon(
            [(x - 62, y - 74), (x - 18, y - 82), (x - 18, 0), (x - 62, 0)], fill=(88, 92, 98)
        )
        corners = [(x, y - 2), (x + 6, y - 84), (x - 76, y - 92), (x - 82, y - 10)]
        broken = history.now["broken"] > 0.0
        if broken:
            corners[:1] = [(x - 26, y - 4), (x - 16, y - 20), (x - 6, y - 22), (x + 3, y - 40)]
        draw.polygon(corners, fill=ui.INSERT, outline=ui.OVER if broken else ui.INK, width=2)
        draw.ellipse((x - 50, y - 60, x - 26, y - 36), fill=ui.mixed(ui.INK, 0.6, ui.INSERT))
        worn = min(history.now["wear"] / self._scenario.tool.wear_criterion, 1.0)
        if worn > 0.0 and not broken:
            draw.line(
                (x + 1, y - 4, x + 4, y - 4 - 60 * worn), fill=ui.INK, width=2 + round(5 * worn)
            )
        ui.put(frame, patch.reduce(ui.SCALE), (box[0], box[1]))

    def _name_passes(self, frame: ui.Pixels, history: History, across: ui.Ruler) -> None:
        """Draw and name each pass of a whole part."""
        image = Image.fromarray(frame[_ROOF:_BOTTOM, _LEFT:_RIGHT])
        draw = ImageDraw.Draw(image)
        count = len(history.passes)
        left, right = (
            across(place) - _LEFT for place in (0.0, self._scenario.workpiece.bar_length)
        )
        for number, (speed, feed, depth) in enumerate(history.passes):
            y = self._height.within((count - 1 - number) * depth) - _ROOF
            above = self._height.within((count - number) * depth) - _ROOF
            draw.line((left, y, right, y), fill=ui.INK)
            text = f"pass {number + 1}:  {speed:.0f} m/min,  {feed:.2f} mm/rev,  {depth:.2f} mm"
            ui.write(
                image, (0.5 * (left + right), 0.5 * (y + above) - 8), text, 12, ui.INK, "middle"
            )
        ui.put(frame, image, (_LEFT, _ROOF))


class LoadChart:
    """A chart of force and power over their limits, or the roughness and its reference, in the last steps or parts."""

    def __init__(self, scenario: Scenario) -> None:
        self._parts, bars = scenario.control.action == "part", scenario.workpiece.bars
        self._steps = bars if self._parts else STEPS
        self._holds_roughness = scenario.control.aim == "roughness"
        most = 1.5 * scenario.surface.reference_max if self._holds_roughness else _MAX_LOAD
        self._height = ui.Ruler(0.0, most, ui.SCALE * (_CHART_BOTTOM - _CHART_TOP), 0.0)
        self._lines = [("power", "power / limit", ui.POWER), ("force", "force / limit", ui.FORCE)]
        if self._holds_roughness:
            self._lines = [
                ("reference", "reference", ui.INK),
                ("roughness", "roughness Ra", ui.SURFACE),
            ]
        self._sheet = sheet = Image.new(
            "RGB", (ui.SCALE * (_RIGHT - _LEFT), ui.SCALE * (_CHART_BOTTOM - _CHART_TOP)), ui.CARD
        )
        draw, bottom = ImageDraw.Draw(sheet), sheet.height - 1
        if not self._holds_roughness:
            limit = self._height(1.0)
            draw.rectangle((0, 0, sheet.width, limit), fill=ui.mixed(ui.OVER, 0.07))
            draw.line((0, limit, sheet.width, limit), fill=ui.mixed(ui.OVER, 0.7), width=2)
            ui.write(sheet, (10, 6), "overload", 11 * ui.SCALE, ui.OVER)
        draw.line([(0, 0), (0, bottom), (sheet.width, bottom)], fill=ui.FAINT, width=2)

    def draw_axes(self, image: Image.Image, box: ui.Box) -> None:
        """Draw the scale and the legend."""
        label = "Ra [um]" if self._holds_roughness else "% of limit"
        ui.write_up(image, (box[0] + 8, 0.5 * (_CHART_TOP + _CHART_BOTTOM)), label)
        for tick in filter(None, ui.round_ticks(0.0, self._height.end, 4)):
            y = _CHART_TOP + self._height(tick) / ui.SCALE
            text = f"{tick:g}" if self._holds_roughness else f"{100 * tick:.0f}"
            ui.write(image, (_LEFT - 11, y - 8), text, 11, ui.QUIET, "right")
        ui.write(
            image,
            (_LEFT, _CHART_BOTTOM + 2),
            "parts" if self._parts else f"last {self._steps} steps",
            11,
            ui.QUIET,
        )
        ui.draw_key(
            image,
            (_RIGHT - 230, _CHART_BOTTOM + 2),
            [(text, colour, 3) for _, text, colour in self._lines],
            14,
        )

    def draw(self, frame: ui.Pixels, history: History) -> None:
        """Draw the lines, which are interrupted in air."""
        sheet = self._sheet.copy()
        draw = ImageDraw.Draw(sheet)
        across = ui.Ruler(0.0, self._steps, 0.0, sheet.width)
        for name, _, colour in self._lines:
            line: list[ui.Point] = []
            for number, sample in enumerate(history.samples):
                if not sample.cutting:
                    draw.line(line, fill=colour, width=3)
                    line = []
                    continue
                x, y = across(number + 0.5), self._height.within(getattr(sample, name))
                line.append((x, y))
                if self._parts:  # the first has no line yet
                    draw.ellipse((x - 5, y - 5, x + 5, y + 5), fill=colour)
            draw.line(line, fill=colour, width=3)
        ui.put(frame, sheet.reduce(ui.SCALE), (_LEFT, _CHART_TOP))


def _tints(hardness: Array) -> ui.Pixels:
    """Return colours, shape (n, 3), of relative hardnesses, shape (n,)."""
    shares = np.clip((hardness - _SOFT) / (_HARD - _SOFT), 0.0, 1.0)[:, np.newaxis]
    tints: ui.Pixels = np.rint(shares * ui.HARD_TINT + (1.0 - shares) * ui.SOFT_TINT).astype(
        np.uint8
    )
    return tints
