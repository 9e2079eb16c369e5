"""Gauges of limited and controlled quantities, and readings in numbers."""

from typing import NamedTuple

from PIL import Image, ImageDraw

from turning_env.rendering import theme as ui
from turning_env.rendering.history import History
from turning_env.scenario import Scenario

_WIDTH, _HEIGHT = 400, 58
_TOP, _BOTTOM = 23, 37  # pixel rows of a gauge's bar


class _Gauge(NamedTuple):
    """The quantities of one gauge: names of ``quantities.INFO``, empty if absent; a quantity held at a reference has no limit."""

    title: str
    unit: str
    decimals: int
    colour: ui.Colour
    value: str
    limit: float
    measured: str = ""
    reference: str = ""


def _gauges(scenario: Scenario) -> list[_Gauge]:
    """Return the gauges of what matters in a scenario."""
    limits, parts = scenario.limits, scenario.control.action == "part"
    prefix, of_pass = ("mean_", ", mean of last pass") if parts else ("", "")
    power = _Gauge(
        f"power{of_pass}",
        "kW",
        2,
        ui.POWER,
        f"{prefix}power",
        limits.power,
        "" if parts else "measured_power",
    )
    if scenario.spindle.reading == "torque" and not parts:
        share = limits.power / scenario.machine.rated_power
        power = _Gauge("share of available torque", "", 2, ui.POWER, "spindle_load", share)
    if scenario.control.aim == "roughness":
        most = scenario.surface.reference_max
        power = _Gauge(
            "roughness Ra", "um", 2, ui.SURFACE, "roughness", most, reference="roughness_reference"
        )
    sensed = "" if parts or scenario.sensors.force == "servo_current" else "measured_thrust_force"
    force = _Gauge(
        f"force{of_pass}", "N", 0, ui.FORCE, f"{prefix}thrust_force", limits.thrust_force, sensed
    )
    return [
        power,
        force,
        _Gauge("flank wear (hidden)", "mm", 3, ui.LAND, "wear", scenario.tool.wear_criterion),
    ]


def _drawn(gauge: _Gauge, now: dict[str, float]) -> Image.Image:
    """Return a gauge at a report's values: a bar with its limit or reference, and a dark line at the measured value."""
    image = Image.new("RGB", (_WIDTH, _HEIGHT), ui.CARD)
    draw = ImageDraw.Draw(image)
    across = ui.Ruler(0.0, 1.5 * gauge.limit, 0.0, _WIDTH - 1.0)
    value, limit = across.within(now[gauge.value]), across(gauge.limit)
    ui.write(image, (0, 3), gauge.title)
    ui.write(
        image,
        (_WIDTH, 0),
        f"{now[gauge.value]:.{gauge.decimals}f} {gauge.unit}",
        17,
        ui.INK,
        "right",
    )
    draw.rectangle((0, _TOP, _WIDTH, _BOTTOM), fill=ui.RULE)
    if gauge.reference:
        mark, colour, text = (
            across.within(now[gauge.reference]),
            ui.INK,
            f"reference {now[gauge.reference]:.2f} {gauge.unit}",
        )
        draw.rectangle((0, _TOP, value, _BOTTOM), fill=gauge.colour)
    else:
        mark, colour, text = limit, ui.OVER, f"limit {gauge.limit:.4g} {gauge.unit}"
        draw.rectangle((limit, _TOP, _WIDTH, _BOTTOM), fill=ui.mixed(ui.OVER, 0.28))
        draw.rectangle((0, _TOP, min(value, limit), _BOTTOM), fill=gauge.colour)
        if value > limit:
            draw.rectangle((limit, _TOP, value, _BOTTOM), fill=ui.OVER)
    draw.line((mark, _TOP - 3, mark, _BOTTOM + 3), fill=colour, width=3)
    ui.write(image, (mark, _BOTTOM + 4), text, 11, ui.QUIET, "middle")
    if gauge.measured and now[gauge.measured] > 0.0:
        x = across.within(now[gauge.measured])
        draw.line((x, _TOP - 2, x, _BOTTOM + 2), fill=ui.INK, width=2)
        measured = f"measured {now[gauge.measured]:.{gauge.decimals}f} {gauge.unit} (dark line)"
        ui.write(image, (12 + ui.length(gauge.title, 13), 5), measured, 11, ui.QUIET)
    return image


class Gauges:
    """The gauges one below the other, and the readings in numbers."""

    def __init__(self, scenario: Scenario, box: ui.Box) -> None:
        self._scenario = scenario
        self._left, self._top = box[0] + 10, box[1] + 10
        self._gauges = _gauges(scenario)

    def draw(self, frame: ui.Pixels, history: History) -> None:
        """Draw all as it is now."""
        for number, gauge in enumerate(self._gauges):
            ui.put(frame, _drawn(gauge, history.now), (self._left, self._top + _HEIGHT * number))
        image = Image.new("RGB", (_WIDTH, 118), ui.CARD)
        ImageDraw.Draw(image).line((0, 0, _WIDTH, 0), fill=ui.RULE)
        for number, (name, value) in enumerate(self._readings(history)):
            row, column = divmod(number, 2)
            left, y = 208 * column, 6 + 22 * row
            ui.write(image, (left, y + 1), name, 12, ui.QUIET)
            ui.write(
                image, (left + 192, y), value, 13, ui.QUIET if "hidden" in name else ui.INK, "right"
            )
        ui.put(frame, image, (self._left, self._top + 3 * _HEIGHT + 6))

    def _readings(self, history: History) -> list[tuple[str, str]]:
        """Return names and values."""
        now, control = history.now, self._scenario.control
        edge = [
            ("edge", f"{history.edge + 1}"),
            ("edge strength (hidden)", f"{now['edge_strength']:.0f} N"),
            ("cutting time", f"{now['cutting_time']:.2f} min"),
            ("used life (hidden)", f"{100 * now['used_life']:.0f} %"),
        ]
        if control.action == "part":
            part = [
                ("passes", f"{now['passes']:.0f}"),
                ("part's time", f"{now['time'] / 60.0:.2f} min"),
            ]
            part += [
                ("metal", f"{now['removed']:.0f} cm3"),
                ("edges used", f"{now['edges_used']:.2f}"),
            ]
            probe = (
                [("next blank's probe", f"{now['probed_depth']:.2f} mm")]
                if self._scenario.sensors.probe
                else []
            )
            return [*edge, *part, ("return of the part", f"{history.reward:.0f} s"), *probe]
        in_metal = now["cutting"] > 0.0
        override = f"{100 * now['commanded_feed'] / control.initial_feed:.0f} %"
        return [
            *edge,
            ("cutting speed", f"{now['cutting_speed']:.0f} m/min"),
            ("depth of cut (hidden)", f"{now['depth_of_cut']:.2f} mm" if in_metal else "air"),
            ("feed", f"{now['feed']:.3f} mm/rev"),
            ("hardness (hidden)", f"{now['hardness']:.2f}" if in_metal else "air"),
            ("removal rate", f"{now['removed'] / max(now['time'] / 60.0, 1e-9):.0f} cm3/min"),
            ("override", override)
            if control.action == "override"
            else ("spindle", f"{now['spindle_speed']:.0f} rev/min"),
        ]
