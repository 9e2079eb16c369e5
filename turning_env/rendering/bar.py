"""The view of the bar: a section along its axis, with the tool at work on it."""

from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw

from turning_env.rendering.fields import Array, BarMetal
from turning_env.rendering.history import History
from turning_env.rendering.theme import (
    ALLOWANCE,
    FAINT,
    HARD_TINT,
    INK,
    INSERT,
    OVER,
    QUIET,
    SCALE,
    SOFT_TINT,
    TITLE,
    Box,
    Pixels,
    Ruler,
    draw_dot,
    enlarged,
    enlarged_sheet,
    length,
    mixed,
    put,
    round_ticks,
    write,
    write_note,
    write_up,
)
from turning_env.scenario import Scenario
from turning_env.scenario.laws import depth_spread

# Pixel columns between which the bar and the chart below it are drawn.
LEFT = 76
RIGHT = 926
_MARGIN = 8  # pixels on either side of the bar that belong to its axis

# Pixel rows of the bar.
_ROOF = 74  # top of the redrawn area
_TOP = 88  # top of the allowance
_SURFACE = 174  # finished surface
_BOTTOM = 206
_AXIS_BOTTOM = 222

_FLOOR = SCALE * (_SURFACE - _ROOF)  # row of the finished surface in an enlarged layer

_SOFT = 0.75  # relative hardness at the soft end of the scale of tints
_HARD = 1.25  # likewise at the hard end
_NUM_PLACES = 212  # along the bar, at which hardness and allowance are computed
_PLACES_PER_DASH = 3  # of the nominal allowance's line
_MAX_NODES = 80
"""Largest number of correlation lengths of hardness shown at a time: more could not be told
apart."""


class _Layer(NamedTuple):
    """Key of the layers of the bar, cut and uncut: the state for which they were drawn."""

    key: tuple[int, int]  # seed and episode
    bar: int
    start: float  # of the stretch in view [mm]


class BarView:
    """A view of the bar that is being turned."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        workpiece = scenario.workpiece
        nominal = max(workpiece.depth_profile, default=workpiece.depth_of_cut)
        spread = depth_spread(workpiece)
        highest = max(1.25 * nominal, nominal + 2.6 * spread)
        self._height = Ruler(start=0.0, end=highest, first=_SURFACE, last=_TOP)
        self._drawn: _Layer | None = None

    def draw_axes(self, image: Image.Image, box: Box) -> None:
        """Draw the scales of allowance and hardness, which never change."""
        draw = ImageDraw.Draw(image)
        title = f"bar of {self._scenario.workpiece.bar_length:.4g} mm"
        write(image, (box.left + 12, box.top + 8), title, size=TITLE)
        place = (box.left + 26 + length(title, TITLE), box.top + 11)
        write_note(image, place, "true allowance and hardness, hidden from the policy")
        write_up(image, (box.left + 8, 0.5 * (_TOP + _SURFACE)), "allowance [mm]")
        for tick in round_ticks(0.0, self._height.end, max_ticks=5):
            y = self._height(tick)
            draw.line((LEFT - 13, y, LEFT - 9, y), fill=FAINT)
            write_note(image, (LEFT - 16, y - 8), f"{tick:g}", anchor="right")

        # The scale of hardness.
        left = RIGHT - 190
        top = box.top + 11
        scale = _tints(np.linspace(_SOFT, _HARD, 90))[np.newaxis].repeat(10, axis=0)
        image.paste(Image.fromarray(scale), (left, top))
        write_note(image, (left - 6, top - 3), f"hardness {_SOFT:g}", anchor="right")
        write_note(image, (left + 96, top - 3), f"{_HARD:g} of nominal")
        write_note(image, (left - 260, top - 3), "dashed: nominal allowance")

    def draw(self, frame: Pixels, history: History) -> None:
        """Draw the bar as it is now: cut on the tool's left, uncut on its right.

        A whole part is drawn as it was, with its passes.
        """
        start, end = self._stretch(history.along)
        across = Ruler(start=start, end=end, first=LEFT, last=RIGHT)
        # Both layers are drawn once per bar; every step only moves the border between them.
        wanted = _Layer(history.key, history.bar, start)
        if wanted != self._drawn:
            self._drawn = wanted
            self._uncut = self._layer(history, across, uncut=True)
            self._cut = self._layer(history, across, uncut=False)
        finished = history.ended == "job finished"
        if history.passes:
            tip = LEFT
        elif finished:
            tip = RIGHT
        else:
            tip = round(across.within(history.along))
        view = frame[_ROOF:_AXIS_BOTTOM, LEFT - _MARGIN : RIGHT + _MARGIN]
        # A whole part is shown uncut under its passes.
        width_of_cut = tip - LEFT + _MARGIN
        view[:] = self._uncut
        view[:, :width_of_cut] = self._cut[:, :width_of_cut]
        if history.passes:
            self._draw_passes(frame, history, across)
        elif not finished:
            self._draw_tool(frame, history, tip)

    def _stretch(self, along: float) -> tuple[float, float]:
        """Return the ends of the stretch of bar [mm] that is shown while the tool is at a place.

        It is the whole bar, or a page of a fine-grained bar.
        """
        workpiece = self._scenario.workpiece
        bar_length = workpiece.bar_length
        size = bar_length
        if workpiece.hardness_along_spread > 0.0:
            size = min(size, _MAX_NODES * workpiece.hardness_correlation_length)
        last_page = int((bar_length - 1e-9) // size)
        page = max(min(int(along // size), last_page), 0)
        room_for_tool = 0.075 * size
        if size == bar_length:
            room_for_tool = max(room_for_tool, workpiece.approach)
        return page * size - room_for_tool, (page + 1) * size + 0.025 * size

    def _layer(self, history: History, across: Ruler, uncut: bool) -> Pixels:
        """Return the stretch in view before or after it is cut, with its axis and margins."""
        start = max(across.start, 0.0)
        # The end of the bar is the start of the next one.
        end = min(across.end, self._scenario.workpiece.bar_length * (1.0 - 1e-9))
        places = np.linspace(start, end, _NUM_PLACES)
        metal = history.fields.along(history.key, history.bar, places)
        left = LEFT - _MARGIN
        sheet = enlarged_sheet(RIGHT + _MARGIN - left, _AXIS_BOTTOM - _ROOF)
        xs = [SCALE * (across(place) - left) for place in places.tolist()]
        self._draw_allowance(sheet, xs, metal=metal, uncut=uncut)
        self._draw_nominal_allowance(sheet, xs, places=places)
        self._draw_body(sheet, xs, metal=metal)
        layer = sheet.reduce(SCALE)
        for tick in round_ticks(start, across.end, max_ticks=9):
            place = (across(tick) - left, _BOTTOM - _ROOF + 1)
            write_note(layer, place, f"{tick:g} mm", anchor="middle")
        return np.asarray(layer)

    def _draw_allowance(
        self, sheet: Image.Image, xs: list[float], metal: BarMetal, uncut: bool
    ) -> None:
        """Draw the profile of the allowance: filled where it is uncut, else as a faint line."""
        draw = ImageDraw.Draw(sheet)
        outline = []
        for x, depth in zip(xs, metal.depth.tolist(), strict=True):
            outline.append((x, SCALE * (self._height.within(depth) - _ROOF)))
        if uncut:
            corners = [(xs[0], _FLOOR), *outline, (xs[-1], _FLOOR)]
            draw.polygon(corners, fill=ALLOWANCE)
            colour = mixed(QUIET, 0.7)
        else:
            colour = mixed(FAINT, 0.5)
        draw.line(outline, fill=colour, width=2)

    def _draw_nominal_allowance(self, sheet: Image.Image, xs: list[float], places: Array) -> None:
        draw = ImageDraw.Draw(sheet)
        depths = self._nominal_depths(places).tolist()
        for i in range(0, len(xs), _PLACES_PER_DASH):
            y = SCALE * (self._height(depths[i]) - _ROOF)
            draw.line((xs[i], y, xs[i] + 12, y), fill=QUIET, width=2)

    def _draw_body(self, sheet: Image.Image, xs: list[float], metal: BarMetal) -> None:
        """Draw the metal below the finished surface in the tints of its hardness."""
        size = (round(xs[-1] - xs[0]), SCALE * (_BOTTOM - _SURFACE))
        tints = Image.fromarray(_tints(metal.hardness)[np.newaxis])
        sheet.paste(tints.resize(size, Image.Resampling.BILINEAR), (round(xs[0]), _FLOOR))
        surface = (xs[0], _FLOOR, xs[-1], _FLOOR)
        ImageDraw.Draw(sheet).line(surface, fill=INK, width=3)

    def _nominal_depths(self, places: Array) -> Array:
        """Return the nominal depths of cut [mm] at places along the bar [mm]."""
        drawn = self._scenario.workpiece.drawn_sections()
        sections = np.searchsorted(drawn.ends, places, side="right")
        depth_at_places: Array = drawn.depths[np.minimum(sections, len(drawn.depths) - 1)]
        return depth_at_places

    def _draw_tool(self, frame: Pixels, history: History, tip: int) -> None:
        """Draw holder, insert and its wear land, or a chipped insert."""
        box = Box(
            left=max(tip - 46, LEFT),
            top=_ROOF,
            right=min(tip + 8, RIGHT),
            bottom=_SURFACE + 2,
        )
        below = Image.fromarray(frame[box.top : box.bottom, box.left : box.right])
        patch = enlarged(below)
        draw = ImageDraw.Draw(patch)
        # Corners count from the tip, at (x, y).
        x = SCALE * (tip - box.left)
        y = SCALE * (_SURFACE - box.top)
        holder = [(x - 62, y - 74), (x - 18, y - 82), (x - 18, 0), (x - 62, 0)]
        draw.polygon(holder, fill=(88, 92, 98))
        insert = [(x + 6, y - 84), (x - 76, y - 92), (x - 82, y - 10)]
        broken = history.now["broken"] > 0.0
        if broken:
            chipped_edge = [(x - 26, y - 4), (x - 16, y - 20), (x - 6, y - 22), (x + 3, y - 40)]
            insert = chipped_edge + insert
        else:
            insert = [(x, y - 2), *insert]
        outline = OVER if broken else INK
        draw.polygon(insert, fill=INSERT, outline=outline, width=2)
        draw_dot(draw, (x - 38, y - 48), radius=12, fill=mixed(INK, 0.6, INSERT))
        worn = min(history.now["wear"] / self._scenario.tool.wear_criterion, 1.0)
        if worn > 0.0 and not broken:
            land = (x + 1, y - 4, x + 4, y - 4 - 60 * worn)
            draw.line(land, fill=INK, width=2 + round(5 * worn))
        put(frame, patch.reduce(SCALE), (box.left, box.top))

    def _draw_passes(self, frame: Pixels, history: History, across: Ruler) -> None:
        """Draw and name each pass of a whole part."""
        image = Image.fromarray(frame[_ROOF:_BOTTOM, LEFT:RIGHT])
        draw = ImageDraw.Draw(image)
        left = across(0.0) - LEFT
        right = across(self._scenario.workpiece.bar_length) - LEFT
        passes_left = len(history.passes)
        for number, cut in enumerate(history.passes, start=1):
            above = self._height.within(passes_left * cut.depth) - _ROOF
            passes_left -= 1
            y = self._height.within(passes_left * cut.depth) - _ROOF
            draw.line((left, y, right, y), fill=INK)
            text = (
                f"pass {number}:  {cut.cutting_speed:.0f} m/min,  {cut.feed:.2f} mm/rev,  "
                f"{cut.depth:.2f} mm"
            )
            place = (0.5 * (left + right), 0.5 * (y + above) - 8)
            write(image, place, text, size=12, anchor="middle")
        put(frame, image, (LEFT, _ROOF))


def _tints(hardness: Array) -> Pixels:
    """Return colours, shape (n, 3), of relative hardnesses, shape (n,)."""
    shares = np.clip((hardness - _SOFT) / (_HARD - _SOFT), 0.0, 1.0)[:, np.newaxis]
    tints = np.rint(shares * HARD_TINT + (1.0 - shares) * SOFT_TINT)
    return tints.astype(np.uint8)
