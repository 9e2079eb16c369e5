"""Dials of what is limited or held."""

import math
from dataclasses import dataclass

from PIL import Image, ImageDraw

from turning_env.rendering.lane import Lane
from turning_env.rendering.theme import (
    CARD,
    FORCE,
    INK,
    OVER,
    POWER,
    QUIET,
    RULE,
    SCALE,
    SURFACE,
    Box,
    Colour,
    Pixels,
    enlarged,
    mixed,
    put,
    write,
)
from turning_env.scenario import Scenario

_WIDTH, _HEIGHT = 200, 138
_RADIUS, _BAND = 74, 12


@dataclass(frozen=True)
class Dial:
    """One dial: what it shows, in which unit, and up to where.

    Attributes:
        value, measured: names of ``REPORT_FIELDS``; ``measured`` is empty where nothing is sensed.
        mark: what it must not exceed, or None where it is held at ``reference``, the name of a field.
    """

    title: str
    unit: str
    decimals: int
    colour: Colour
    value: str
    measured: str
    most: float
    mark: float | None
    reference: str = ""

    @classmethod
    def of(cls, scenario: Scenario) -> "tuple[Dial, Dial]":
        """The two that matter in a scenario."""
        limits, parts = scenario.limits, scenario.control.action == "part"
        force, power = ("mean_thrust_force", "mean_power") if parts else ("thrust_force", "power")
        sensed = "" if parts or scenario.sensors.force == "servo_current" else "measured_thrust_force"
        name = "force, mean of the last pass" if parts else "force"
        dial_of_force = cls(name, "N", 0, FORCE, force, sensed, 1.5 * limits.thrust_force, limits.thrust_force)
        if scenario.control.aim == "roughness":
            most = 1.5 * scenario.surface.reference_max
            return cls("roughness Ra", "um", 2, SURFACE, "roughness", "", most, None, "roughness_reference"), dial_of_force
        name = "power, mean of the last pass" if parts else "power"
        sensed = "" if parts else "measured_power"
        return cls(name, "kW", 2, POWER, power, sensed, 1.5 * limits.power, limits.power), dial_of_force


class Dials:
    """Draws two dials at a place, side by side."""

    def __init__(self, scenario: Scenario, box: Box) -> None:
        self._corners = [(box[0] + 4, box[1] + 6), (box[0] + 212, box[1] + 6)]
        self._dials = Dial.of(scenario)
        self._faces = [_face(dial) for dial in self._dials]

    def draw(self, frame: Pixels, lane: Lane) -> None:
        """The needles at where they are."""
        for dial, (large, face), corner in zip(self._dials, self._faces, self._corners, strict=True):
            put(frame, _with_needle(dial, large, face, lane), corner)


def _face(dial: Dial) -> tuple[Image.Image, Image.Image]:
    """What stands still: the arc, enlarged, and the texts on their own."""
    face = Image.new("RGB", (_WIDTH, _HEIGHT), CARD)
    large = enlarged(face)
    draw = ImageDraw.Draw(large)
    box = _arc_box(0)
    draw.arc(box, 180, 360, fill=RULE, width=SCALE * _BAND)
    if dial.mark is not None:
        draw.arc(box, 180 + 180 * dial.mark / dial.most, 360, fill=mixed(OVER, 0.28), width=SCALE * _BAND)
        draw.line(_ray(dial.mark / dial.most, _RADIUS - _BAND - 3, _RADIUS + 3), fill=OVER, width=4)
    return large, face


def _with_needle(dial: Dial, large: Image.Image, face: Image.Image, lane: Lane) -> Image.Image:
    now = lane.now
    value = now[dial.value]
    share = min(max(value / dial.most, 0.0), 1.0)
    image = large.copy()
    draw = ImageDraw.Draw(image)
    mark = dial.mark
    box = _arc_box(0)
    if share > 0.002:
        draw.arc(box, 180, 180 + 180 * min(share, mark / dial.most if mark else 1.0), fill=dial.colour, width=SCALE * _BAND)
    if mark is not None and value > mark:
        draw.arc(box, 180 + 180 * mark / dial.most, 180 + 180 * share, fill=OVER, width=SCALE * _BAND)
    if dial.reference:
        draw.line(_ray(min(now[dial.reference] / dial.most, 1.0), _RADIUS - _BAND - 4, _RADIUS + 5), fill=INK, width=6)
    if dial.measured and now[dial.measured] > 0.0:
        _draw_pointer(draw, min(now[dial.measured] / dial.most, 1.0))
    draw.line(_ray(share, 45, _RADIUS - _BAND - 4), fill=INK, width=5)
    image = image.reduce(SCALE)
    middle, base = _WIDTH // 2, _RADIUS + 12
    write(image, (middle, base - 22), f"{value:.{dial.decimals}f} {dial.unit}", 17, INK, "middle")
    write(image, (middle, base + 4), dial.title, 13, INK, "middle")
    if dial.reference:
        told = f"reference {now[dial.reference]:.{dial.decimals}f} {dial.unit}"
    elif dial.measured:
        told = f"limit {mark:g} {dial.unit}, measured {now[dial.measured]:.{dial.decimals}f}"
    elif now["measured_servo_current"] > 0.0 and dial.unit == "N":
        told = f"limit {mark:g} {dial.unit}, servo current {now['measured_servo_current']:.2f} A"
    else:
        told = f"limit {mark:g} {dial.unit}"
    write(image, (middle, base + 21), told, 11, QUIET, "middle")
    return image


def _arc_box(inset: int) -> tuple[int, int, int, int]:
    middle, base, radius = SCALE * _WIDTH // 2, SCALE * (_RADIUS + 12), SCALE * (_RADIUS - inset)
    return middle - radius, base - radius, middle + radius, base + radius


def _ray(share: float, inner: float, outer: float) -> tuple[float, float, float, float]:
    """Of the enlarged dial: from one radius [pixels] to another at a share of its arc."""
    angle = math.pi * (1.0 - share)
    middle, base = SCALE * _WIDTH / 2, SCALE * (_RADIUS + 12)
    cosine, sine = SCALE * math.cos(angle), SCALE * math.sin(angle)
    return middle + inner * cosine, base - inner * sine, middle + outer * cosine, base - outer * sine


def _draw_pointer(draw: ImageDraw.ImageDraw, share: float) -> None:
    """What is measured, as a triangle from outside."""
    tip, left, right = (_ray(share + turn, radius, radius)[:2] for turn, radius in ((0, 72), (-0.018, 82), (0.018, 82)))
    draw.polygon([tip, left, right], fill=QUIET)
