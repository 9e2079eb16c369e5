"""Feeds and speeds of turning for FreeCAD's CAM workbench: a provider, as its epic defines them.

FreeCAD resolves feeds and speeds by a chain of providers (``Path/Tool/FeedsSpeeds``, phase 1). It
takes a tool for a mill: rev/min from the diameter of the tool, feed from teeth. An insert turns no
bar by its own diameter. This provider reads the same presets, takes the diameter of the bar from
their notes ("turning: diameter 80 mm"), and gives rev/min and mm/min of turning.

``python -m turning_env tools`` writes such presets. Copy this file into FreeCAD's macros, and run
``import turning_feeds; turning_feeds.install()``. It needs nothing but FreeCAD.
"""

import math
import re
from collections.abc import Callable, Sequence
from typing import Any

Preset = dict[str, Any]

SHAPES = ("iso_shape", "iso", "isoshape")  # beginnings of the names of FreeCAD's inserts
CONFIDENCE = 0.95  # above that of any milling preset, which is at most 0.95
DIAMETER = re.compile(r"\bdiameter ([0-9.]+) ?mm")


class TurningProvider:
    """Suggests rev/min and feed for inserts from their presets; to other tools it has no answer."""

    name = "turning"

    def suggest(self, tool: Any, material: Any, op: Any) -> Any:
        """Return FreeCAD's ``PartialResult``, or None for a tool that is no insert."""
        from Path.Tool.FeedsSpeeds.types import PartialResult  # type: ignore[import-not-found]

        if not str(tool.shape_id).lower().startswith(SHAPES):
            return None
        preset = best_preset(tool.presets, material)
        if preset is None:
            return None
        speed = preset.get("surface_speed")
        feed = preset.get("chipload")
        diameter = bar_diameter(preset)
        source = f"turning:{preset.get('name') or 'preset'}"
        if not speed or not diameter:
            warning = "No cutting speed, or no 'diameter ... mm' of the bar in the preset's notes."
            return PartialResult(source=source, confidence=0.0, warnings=(warning,))
        spindle_speed = 1000.0 * speed / (math.pi * diameter)
        return PartialResult(
            horiz_feed=spindle_speed * feed if feed else None,
            vert_feed=spindle_speed * feed if feed else None,
            spindle_speed=spindle_speed,
            chipload=feed,
            surface_speed=speed,
            source=source,
            confidence=CONFIDENCE,
            warnings=(f"At a diameter of {diameter:g} mm; with G96 the control follows it.",),
        )


def best_preset(presets: Sequence[Preset], material: Any) -> Preset | None:
    """Return the preset for a material, else one for any material, else None."""
    wanted = (material.name or "").strip().casefold()
    generic = None
    for preset in presets:
        hint = preset.get("material_hint") or {}
        named = (hint.get("name") or "").strip().casefold()
        uuid = hint.get("uuid")
        if (named and named == wanted) or (uuid and uuid == material.uuid):
            return preset
        if not named and not uuid:
            generic = generic or preset
    return generic


def bar_diameter(preset: Preset) -> float | None:
    """Return the diameter of the bar that a preset's notes state [mm], or None."""
    match = DIAMETER.search(preset.get("notes") or "")
    return float(match[1]) if match else None


class Chain:
    """FreeCAD's providers, with that of turning before them."""

    def __init__(self, others: Callable[[], Sequence[Any]]) -> None:
        self._others = others

    def __call__(self) -> tuple[Any, ...]:
        return (TurningProvider(), *self._others())


def install() -> None:
    """Put the provider before FreeCAD's own, until FreeCAD ends."""
    from Path.Tool.FeedsSpeeds import resolver  # type: ignore[import-not-found]

    if not isinstance(resolver.default_providers, Chain):
        resolver.default_providers = Chain(resolver.default_providers)
