"""Dials of limited and controlled quantities, the edge with its wear land, and readings in numbers."""

import math
from typing import NamedTuple

from PIL import Image, ImageDraw

from turning_env.scenario import Scenario
from turning_render import theme as ui
from turning_render.history import History

_WIDTH, _HEIGHT = 200, 138
_RADIUS, _BAND = 74, 12
_CENTRE = (ui.SCALE * _WIDTH // 2, ui.SCALE * (_RADIUS + 12))
_ARC = tuple(middle + side * ui.SCALE * _RADIUS for side in (-1, 1) for middle in _CENTRE)
"""Centre of the enlarged dial, and the box around its circle."""


class _Dial(NamedTuple):
    """The quantities of one dial: names of ``quantities.INFO``, empty if absent; a quantity held at a reference has no limit."""

    title: str
    unit: str
    decimals: int
    colour: ui.Colour
    value: str
    measured: str
    end: float
    limit: float | None
    reference: str = ""


def _dials(scenario: Scenario) -> tuple[_Dial, _Dial]:
    """Return the two dials that matter in a scenario."""
    limits, parts = scenario.limits, scenario.control.action == "part"
    prefix, of_pass = ("mean_", ", mean of last pass") if parts else ("", "")
    sensed = "" if parts or scenario.sensors.force == "servo_current" else "measured_thrust_force"
    most = limits.thrust_force
    force = _Dial(f"force{of_pass}", "N", 0, ui.FORCE, f"{prefix}thrust_force", sensed, 1.5 * most, most)
    if scenario.control.aim == "roughness":
        most = 1.5 * scenario.surface.reference_max
        return _Dial("roughness Ra", "um", 2, ui.SURFACE, "roughness", "", most, None, "roughness_reference"), force
    if scenario.spindle.reading == "torque" and not parts:
        most = round(limits.power / scenario.machine.rated_power, 3)
        return _Dial("share of available torque", "", 2, ui.POWER, "spindle_load", "", 1.5 * most, most), force
    sensed = "" if parts else "measured_power"
    return _Dial(f"power{of_pass}", "kW", 2, ui.POWER, f"{prefix}power", sensed, 1.5 * limits.power, limits.power), force


def _face(dial: _Dial) -> Image.Image:
    """Return the fixed background: the arc, enlarged."""
    face = ui.enlarged(Image.new("RGB", (_WIDTH, _HEIGHT), ui.CARD))
    draw = ImageDraw.Draw(face)
    draw.arc(_ARC, 180, 360, fill=ui.RULE, width=ui.SCALE * _BAND)
    if dial.limit is not None:
        draw.arc(_ARC, 180 + 180 * dial.limit / dial.end, 360, fill=ui.mixed(ui.OVER, 0.28), width=ui.SCALE * _BAND)
        draw.line(_ray(dial.limit / dial.end, _RADIUS - _BAND - 3, _RADIUS + 3), fill=ui.OVER, width=4)
    return face


def _with_needle(dial: _Dial, face: Image.Image, now: dict[str, float]) -> Image.Image:
    """Return the dial with its needle at a report's value."""
    value, mark = now[dial.value], dial.limit
    share = min(max(value / dial.end, 0.0), 1.0)
    image = face.copy()
    draw = ImageDraw.Draw(image)
    if share > 0.002:
        draw.arc(_ARC, 180, 180 + 180 * min(share, mark / dial.end if mark else 1.0), fill=dial.colour, width=ui.SCALE * _BAND)
    if mark is not None and value > mark:
        draw.arc(_ARC, 180 + 180 * mark / dial.end, 180 + 180 * share, fill=ui.OVER, width=ui.SCALE * _BAND)
    if dial.reference:
        draw.line(_ray(min(now[dial.reference] / dial.end, 1.0), _RADIUS - _BAND - 4, _RADIUS + 5), fill=ui.INK, width=6)
    if dial.measured and now[dial.measured] > 0.0:
        _draw_pointer(draw, min(now[dial.measured] / dial.end, 1.0))
    draw.line(_ray(share, 45, _RADIUS - _BAND - 4), fill=ui.INK, width=5)
    image = image.reduce(ui.SCALE)
    middle, base = _WIDTH // 2, _RADIUS + 12
    ui.write(image, (middle, base - 22), f"{value:.{dial.decimals}f} {dial.unit}", 17, ui.INK, "middle")
    ui.write(image, (middle, base + 4), dial.title, 13, ui.INK, "middle")
    _write_marks(image, base + 21, dial, now)
    return image


def _write_marks(image: Image.Image, y: int, dial: _Dial, now: dict[str, float]) -> None:
    """Write the legend of the marks on the arc, each text behind a small copy of its mark."""
    if dial.reference:
        entries = [("reference", f"reference {now[dial.reference]:.{dial.decimals}f} {dial.unit}")]
    else:
        entries = [("limit", f"limit {dial.limit:.4g} {dial.unit}")]
    if dial.measured:
        entries.append(("measured", f"measured {now[dial.measured]:.{dial.decimals}f}"))
    elif now["measured_servo_current"] > 0.0 and dial.unit == "N":
        entries.append(("", f"servo current {now['measured_servo_current']:.2f} A"))
    draw = ImageDraw.Draw(image)
    x = round(0.5 * (image.width + 10 - sum(ui.length(text, 11) + (12 if mark else 4) + 10 for mark, text in entries)))
    for mark, text in entries:
        if mark == "measured":
            draw.polygon([(x, y + 4), (x + 8, y + 4), (x + 4, y + 12)], fill=ui.QUIET)
        elif mark:
            colour, width = (ui.OVER, 2) if mark == "limit" else (ui.INK, 3)
            draw.line((x + 4, y + 2, x + 4, y + 13), fill=colour, width=width)
        x += 12 if mark else 4
        ui.write(image, (x, y), text, 11, ui.QUIET)
        x += round(ui.length(text, 11)) + 10


def _ray(share: float, inner: float, outer: float) -> tuple[float, float, float, float]:
    """Return a line from one radius [pixels] to another at a share of the enlarged dial's arc."""
    angle = math.pi * (1.0 - share)
    middle, base = _CENTRE
    cosine, sine = ui.SCALE * math.cos(angle), ui.SCALE * math.sin(angle)
    return middle + inner * cosine, base - inner * sine, middle + outer * cosine, base - outer * sine


def _draw_pointer(draw: ImageDraw.ImageDraw, share: float) -> None:
    """Draw a triangle from outside, which points at the measured value."""
    tip, left, right = (_ray(share + turn, radius, radius)[:2] for turn, radius in ((0, 72), (-0.018, 82), (0.018, 82)))
    draw.polygon([tip, left, right], fill=ui.QUIET)


class Gauges:
    """Two dials side by side, the edge below them, and the readings in numbers."""

    def __init__(self, scenario: Scenario, box: ui.Box) -> None:
        self._scenario = scenario
        self._left, self._top = box[:2]
        self._dials = [(dial, _face(dial)) for dial in _dials(scenario)]

    def draw(self, frame: ui.Pixels, history: History) -> None:
        """Draw all as it is now."""
        for number, (dial, face) in enumerate(self._dials):
            ui.put(frame, _with_needle(dial, face, history.now), (self._left + 4 + 208 * number, self._top + 6))
        self._draw_edge(frame, history)
        self._write_readings(frame, history)

    def _draw_edge(self, frame: ui.Pixels, history: History) -> None:
        """Draw the edge with its wear land, and how much of its life is used."""
        now, criterion = history.now, self._scenario.tool.wear_criterion
        image = Image.new("RGB", (400, 86), ui.CARD)
        large = Image.new("RGB", (184, 172), ui.CARD)
        draw = ImageDraw.Draw(large)
        broken = now["broken"] > 0.0
        draw.polygon([(20, 18), (164, 18), (150, 160), (34, 160)], fill=ui.INSERT, outline=ui.INK, width=2)
        land = 84.0 * min(now["wear"] / criterion, 1.25)
        if land > 1.0:  # a ragged border, as worn lands have
            ragged = [(24 + 0.12 * land + 4.7 * k, 18 + land * (0.86 + 0.14 * math.sin(2.3 * k))) for k in range(28)]
            draw.polygon([(20, 18), (164, 18), *reversed(ragged)], fill=ui.LAND)
        draw.line((20, 18, 164, 18), fill=ui.INK, width=4)
        for x in range(14, 176, 14):
            draw.line((x, 102, x + 8, 102), fill=ui.OVER, width=3)
        if broken:
            draw.polygon([(110, 10), (176, 10), (176, 92), (150, 70), (142, 44), (122, 38)], fill=ui.CARD)
            draw.line([(110, 18), (122, 38), (142, 44), (150, 70), (160, 86)], fill=ui.OVER, width=4, joint="curve")
        share = min(now["used_life"], 1.0)
        image.paste(large.reduce(ui.SCALE))
        draw = ImageDraw.Draw(image)
        draw.rectangle((100, 65, 390, 73), fill=ui.RULE)
        if share > 0.0:
            colour = ui.OVER if broken or share >= 1.0 else ui.GREEN
            draw.rectangle((100, 65, 100 + 290 * share, 73), fill=colour)
        title = "edge" if self._scenario.control.edge_changes == "end" else f"edge {history.edge + 1}"
        ui.write(image, (100, 2), f"{title}: true state, hidden", 13)
        ui.write(image, (100, 22), f"flank wear {now['wear']:.3f} mm, worn out at {criterion:g} mm (dashes)", 12)
        ui.write(image, (100, 43), f"life used {100 * now['used_life']:.0f} %", 12)
        strength = f"{'broke' if broken else 'breaks'} at {now['edge_strength']:.0f} N"
        ui.write(image, (390, 2), strength, 11, ui.OVER if broken else ui.QUIET, "right")
        ui.write(image, (390, 43), f"cutting for {now['cutting_time']:.2f} min", 12, ui.QUIET, "right")
        ui.put(frame, image, (self._left + 8, self._top + 146))

    def _write_readings(self, frame: ui.Pixels, history: History) -> None:
        """Write the settings and the responses in numbers."""
        image = Image.new("RGB", (400, 78), ui.CARD)
        ImageDraw.Draw(image).line((8, 0, 392, 0), fill=ui.RULE)
        for number, (name, value, observed) in enumerate(self._values(history)):
            row, column = divmod(number, 2)
            left, y = 8 + 200 * column, 6 + 23 * row
            ui.write(image, (left, y + 1), name, 12, ui.QUIET)
            ui.write(image, (left + 184, y), value, 13, ui.INK if observed else ui.QUIET, "right")
        ui.put(frame, image, (self._left + 8, self._top + 234))

    def _values(self, history: History) -> list[tuple[str, str, bool]]:
        """Return the name and value of each reading, and whether the policy observes it."""
        now = history.now
        if self._scenario.control.action == "part":
            values = [
                ("passes", f"{now['passes']:.0f}", True),
                ("part's time", f"{now['time'] / 60.0:.2f} min", True),
                ("metal", f"{now['removed']:.0f} cm3", True),
                ("edges used", f"{now['edges_used']:.2f}", True),
            ]
            if self._scenario.sensors.probe:
                values.append(("next blank's probe", f"{now['probed_depth']:.2f} mm", True))
            return [*values, ("return of the part", f"{history.reward:.0f} s", True)]
        override = self._scenario.control.action == "override"
        in_metal = now["cutting"] > 0.0
        return [
            ("cutting speed", f"{now['cutting_speed']:.0f} m/min", True),
            ("depth of cut (hidden)", f"{now['depth_of_cut']:.2f} mm" if in_metal else "air", False),
            ("feed", f"{now['feed']:.3f} mm/rev", True),
            ("hardness (hidden)", f"{now['hardness']:.2f}" if in_metal else "air", False),
            ("removal rate", f"{now['removed'] / max(now['time'] / 60.0, 1e-9):.0f} cm3/min", True),
            ("override", f"{100 * now['commanded_feed'] / self._scenario.control.initial_feed:.0f} %", True)
            if override
            else ("spindle", f"{now['spindle_speed']:.0f} rev/min", True),
        ]
