"""Gauges of limited and controlled quantities, and readings in numbers."""

from typing import NamedTuple

from PIL import Image, ImageDraw

from turning_env.rendering.history import History
from turning_env.rendering.theme import (
    CARD,
    FORCE,
    INK,
    LAND,
    OVER,
    POWER,
    QUIET,
    RULE,
    SURFACE,
    Box,
    Colour,
    Pixels,
    Ruler,
    length,
    mixed,
    put,
    write,
    write_note,
)
from turning_env.scenario import Scenario

_WIDTH = 400
_HEIGHT = 58  # of a gauge
_TOP = 23  # pixel row at which a gauge's bar begins
_BOTTOM = 37  # pixel row at which it ends
_TITLE_SIZE = 13
_VALUE_SIZE = 17

# The readings, in two columns.
_PADDING = 6  # above the readings, and above their first row
_READINGS_HEIGHT = 118
_ROW_HEIGHT = 22
_COLUMN_PITCH = 208
_COLUMN_WIDTH = 192


class _Gauge(NamedTuple):
    """The quantities of one gauge. A quantity that is held at a reference has no limit."""

    title: str
    unit: str
    decimals: int
    colour: Colour
    value: str  # name in ``quantities.INFO``
    limit: float  # or the highest reference; two thirds of the gauge
    measured: str = ""  # name of the measured value, if there is one
    reference: str = ""  # name of the reference, if there is one

    def text(self, value: float) -> str:
        """Return a value with its unit."""
        return f"{value:.{self.decimals}f} {self.unit}"


def _gauges(scenario: Scenario) -> list[_Gauge]:
    """Return the gauges of what matters in a scenario."""
    wear = _Gauge(
        title="flank wear (hidden)",
        unit="mm",
        decimals=3,
        colour=LAND,
        value="wear",
        limit=scenario.tool.wear_criterion,
    )
    return [_first_gauge(scenario), _force_gauge(scenario), wear]


def _first_gauge(scenario: Scenario) -> _Gauge:
    """Return the gauge of roughness, if it is controlled, else of torque or power."""
    parts = scenario.control.action == "part"
    if scenario.control.aim == "roughness":
        return _Gauge(
            title="roughness Ra",
            unit="um",
            decimals=2,
            colour=SURFACE,
            value="roughness",
            limit=scenario.surface.reference_max,
            reference="roughness_reference",
        )
    if scenario.spindle.reading == "torque" and not parts:
        return _Gauge(
            title="share of available torque",
            unit="",
            decimals=2,
            colour=POWER,
            value="spindle_load",
            limit=scenario.limits.power / scenario.machine.rated_power,
        )
    return _Gauge(
        title="power, mean of last pass" if parts else "power",
        unit="kW",
        decimals=2,
        colour=POWER,
        value="mean_power" if parts else "power",
        limit=scenario.limits.power,
        # Power is measured in a step, not as the mean of a pass.
        measured="" if parts else "measured_power",
    )


def _force_gauge(scenario: Scenario) -> _Gauge:
    parts = scenario.control.action == "part"
    # A dynamometer measures the force of a step; the mean of a pass, which is shown with parts, has
    # no measured counterpart. A sensor of the servo current measures no force.
    senses_force = not parts and scenario.sensors.force == "dynamometer"
    return _Gauge(
        title="force, mean of last pass" if parts else "force",
        unit="N",
        decimals=0,
        colour=FORCE,
        value="mean_thrust_force" if parts else "thrust_force",
        limit=scenario.limits.thrust_force,
        measured="measured_thrust_force" if senses_force else "",
    )


def _picture_of(gauge: _Gauge, now: dict[str, float]) -> Image.Image:
    """Return a gauge at a report's values: a bar with its limit or reference.

    A dark line stands at the measured value.
    """
    image = Image.new("RGB", (_WIDTH, _HEIGHT), CARD)
    draw = ImageDraw.Draw(image)
    # Room beyond the limit, so that an overload shows.
    across = Ruler(start=0.0, end=1.5 * gauge.limit, first=0.0, last=_WIDTH - 1.0)
    value = now[gauge.value]
    write(image, (0, 3), gauge.title, size=_TITLE_SIZE)
    write(image, (_WIDTH, 0), gauge.text(value), size=_VALUE_SIZE, anchor="right")
    draw.rectangle((0, _TOP, _WIDTH, _BOTTOM), fill=RULE)
    if gauge.reference:
        _draw_bar_with_reference(image, gauge, across=across, now=now)
    else:
        _draw_bar_with_limit(image, gauge, across=across, value=value)
    # Before the first step nothing is measured.
    if gauge.measured and now[gauge.measured] > 0.0:
        measured = now[gauge.measured]
        x = across.within(measured)
        draw.line((x, _TOP - 2, x, _BOTTOM + 2), fill=INK, width=2)
        place = (12 + length(gauge.title, _TITLE_SIZE), 5)
        write_note(image, place, f"measured {gauge.text(measured)} (dark line)")
    return image


def _draw_bar_with_reference(
    image: Image.Image, gauge: _Gauge, across: Ruler, now: dict[str, float]
) -> None:
    reference = now[gauge.reference]
    right = across.within(now[gauge.value])
    ImageDraw.Draw(image).rectangle((0, _TOP, right, _BOTTOM), fill=gauge.colour)
    text = f"reference {reference:.2f} {gauge.unit}"
    _draw_mark(image, across.within(reference), colour=INK, text=text)


def _draw_bar_with_limit(image: Image.Image, gauge: _Gauge, across: Ruler, value: float) -> None:
    draw = ImageDraw.Draw(image)
    right = across.within(value)
    limit = across(gauge.limit)
    draw.rectangle((limit, _TOP, _WIDTH, _BOTTOM), fill=mixed(OVER, 0.28))
    draw.rectangle((0, _TOP, min(right, limit), _BOTTOM), fill=gauge.colour)
    if right > limit:
        draw.rectangle((limit, _TOP, right, _BOTTOM), fill=OVER)
    text = f"limit {gauge.limit:.4g} {gauge.unit}"
    _draw_mark(image, limit, colour=OVER, text=text)


def _draw_mark(image: Image.Image, x: float, colour: Colour, text: str) -> None:
    """Draw a line across a gauge's bar with a text below."""
    line = (x, _TOP - 3, x, _BOTTOM + 3)
    ImageDraw.Draw(image).line(line, fill=colour, width=3)
    write_note(image, (x, _BOTTOM + 4), text, anchor="middle")


class _Reading(NamedTuple):
    """A quantity in numbers."""

    name: str
    value: str

    @property
    def is_hidden(self) -> bool:
        """Whether a policy does not see it."""
        return "hidden" in self.name


class Gauges:
    """The gauges one below the other, and the readings in numbers."""

    def __init__(self, scenario: Scenario, box: Box) -> None:
        self._scenario = scenario
        self._left = box.left + 10
        self._top = box.top + 10
        self._gauges = _gauges(scenario)

    def draw(self, frame: Pixels, history: History) -> None:
        """Draw all gauges, and below them the readings, at the values of the last step."""
        top = self._top
        for gauge in self._gauges:
            put(frame, _picture_of(gauge, history.now), (self._left, top))
            top += _HEIGHT
        image = Image.new("RGB", (_WIDTH, _READINGS_HEIGHT), CARD)
        ImageDraw.Draw(image).line((0, 0, _WIDTH, 0), fill=RULE)
        for number, reading in enumerate(self._readings(history)):
            row, column = divmod(number, 2)
            x = _COLUMN_PITCH * column
            y = _PADDING + _ROW_HEIGHT * row
            write(image, (x, y + 1), reading.name, size=12, colour=QUIET)
            write(
                image,
                (x + _COLUMN_WIDTH, y),
                reading.value,
                colour=QUIET if reading.is_hidden else INK,
                anchor="right",
            )
        put(frame, image, (self._left, top + _PADDING))

    def _readings(self, history: History) -> list[_Reading]:
        now = history.now
        edge = [
            _Reading("edge", f"{history.edge + 1}"),
            _Reading("edge strength (hidden)", f"{now['edge_strength']:.0f} N"),
            _Reading("cutting time", f"{now['cutting_time']:.2f} min"),
            _Reading("used life (hidden)", f"{100 * now['used_life']:.0f} %"),
        ]
        if self._scenario.control.action == "part":
            return edge + self._part_readings(history)
        return edge + self._step_readings(history)

    def _part_readings(self, history: History) -> list[_Reading]:
        now = history.now
        readings = [
            _Reading("passes", f"{now['passes']:.0f}"),
            _Reading("part's time", f"{now['time'] / 60.0:.2f} min"),
            _Reading("metal", f"{now['removed']:.0f} cm3"),
            _Reading("edges used", f"{now['edges_used']:.2f}"),
            _Reading("return of the part", f"{history.reward:.0f} s"),
        ]
        if self._scenario.sensors.probe:
            readings.append(_Reading("next blank's probe", f"{now['probed_depth']:.2f} mm"))
        return readings

    def _step_readings(self, history: History) -> list[_Reading]:
        now = history.now
        control = self._scenario.control
        depth = "air"
        hardness = "air"
        if now["cutting"] > 0.0:
            depth = f"{now['depth_of_cut']:.2f} mm"
            hardness = f"{now['hardness']:.2f}"
        removal_rate = now["removed"] / max(now["time"] / 60.0, 1e-9)  # [cm3/min]
        if control.action == "override":
            override = 100 * now["commanded_feed"] / control.initial_feed
            last = _Reading("override", f"{override:.0f} %")
        else:
            last = _Reading("spindle", f"{now['spindle_speed']:.0f} rev/min")
        return [
            _Reading("cutting speed", f"{now['cutting_speed']:.0f} m/min"),
            _Reading("depth of cut (hidden)", depth),
            _Reading("feed", f"{now['feed']:.3f} mm/rev"),
            _Reading("hardness (hidden)", hardness),
            _Reading("removal rate", f"{removal_rate:.0f} cm3/min"),
            last,
        ]
