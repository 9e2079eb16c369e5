"""Write one offline HTML page with sliders: a browser computes map, loads, tool life and cost.

``page.html`` is the frame; ``page.js`` computes from the scenario's laws, and draws. Both lie
beside this file and are put into the page.
"""

import hashlib
import html
import json
import math
from base64 import b64encode
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

from turning_shop.advise import Advice, headline, life_spread, settings
from turning_shop.allowed import allowed_loads, feed_range
from turning_shop.prediction import BEYOND, Evidence
from turning_shop.units import METRIC, Units
from turning_shop.whatif import NO_LIMIT

from turning_env.scenario import Scenario
from turning_env.scenario.power_law import POWER_LAW_RECORD

_HERE = Path(__file__).parent


def render(
    scenario: Scenario,
    evidence: Evidence,
    advice: list[Advice],
    simulated: Sequence[str] = (),
    units: Units = METRIC,
) -> str:
    """Return the page as HTML, which needs no other file and no network.

    It begins with the first advice. ``simulated`` are sentences on what the simulation said of it.
    """
    script = (_HERE / "page.js").read_text("utf-8")
    values = page_data(scenario, evidence, advice, units)
    data = json.dumps(values, allow_nan=False, separators=(",", ":"))
    work = scenario.workpiece
    bars = f"bars of {work.diameter:g} mm diameter, {work.bar_length:g} mm long"
    return Template((_HERE / "page.html").read_text("utf-8")).substitute(
        name=html.escape(scenario.name),
        work=html.escape(units.text(bars)),
        criterion=units.text(f"{scenario.tool.wear_criterion:g} mm"),
        warnings="".join(
            f"<li>{html.escape(units.text(warning))}</li>" for warning in evidence.warnings
        ),
        headline="".join(
            f"<p>{html.escape(units.text(line))}</p>"
            for line in (*headline(scenario, evidence, advice), *simulated)
        ),
        data=data.replace("<", "\\u003c"),
        script=script,
        # No script but this one runs, whatever a scenario is called.
        script_digest=b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )


_SHOWN = ("m/min", "mm/rev", "mm", "N", "kW", "cm3/min")
"""Metric units of the numbers that the page shows in other units."""


class Slider(NamedTuple):
    """A slider of the page."""

    name: str
    label: str
    unit: str
    low: float
    high: float
    value: float  # at which it begins


def page_data(
    scenario: Scenario, evidence: Evidence, advice: Sequence[Advice], units: Units = METRIC
) -> dict[str, Any]:
    """Return the data of ``page.js`` as JSON values."""
    work = scenario.workpiece
    economics = scenario.economics
    speeds, feeds, _ = settings(scenario)
    chosen = []
    for aim, plan, _ in advice:
        shown: dict[str, Any] = {"aim": aim}
        for name in ("cutting_speed", "feed", "wear"):
            shown[name] = float(getattr(plan.cuts, name))
        chosen.append(shown)

    laws = {}
    for name in ("wear", "thrust_force", "power"):
        law = getattr(scenario.material, name)
        laws[name] = {key: float(getattr(law, key)) for key in POWER_LAW_RECORD.names or ()}
    known = {}
    for name, law_evidence in evidence.laws.items():
        fields = {
            "terms",
            "covariance",
            "scatter",
            "curve_scatter",
            "curve_reference",
            "measured",
            "origin",
        }
        known[name] = law_evidence.model_dump(mode="json", include=fields)
        known[name]["quantile"] = law_evidence.quantile
        law = getattr(scenario.material, name)
        known[name]["reference_depth_of_cut"] = law.reference_depth_of_cut
        known[name]["law"] = laws[name]

    # JSON has no infinity: a limit that is off is null.
    limits = {}
    for name, no_limit in NO_LIMIT.items():
        limit = getattr(scenario.limits, name)
        limits[name] = None if limit == no_limit else limit
    loads = allowed_loads(scenario)
    allowed = {"thrust_force": loads.thrust_force, "power": loads.power}
    is_override = scenario.control.action == "override"
    return {
        "laws": laws,
        "known": known,
        "origins": evidence.origins,
        "beyond": BEYOND,
        "life_spread": life_spread(scenario),
        "criterion": scenario.tool.wear_criterion,
        "allowed": {name: None if math.isinf(load) else load for name, load in allowed.items()},
        "limits": limits,
        "speeds": speeds.ravel().tolist(),
        "feeds": feeds.ravel().tolist(),
        "base_cutting_speed": scenario.base_cutting_speed or None,
        "idle_power_per_speed": scenario.spindle.idle_torque / (30.0 * work.diameter),
        "diameter": work.diameter,
        "bar_length": work.bar_length,
        "approach": work.approach,
        "return_time": scenario.machine.return_time,
        "edge_cost": economics.edge_cost,
        "currency": economics.currency,
        "units": {metric: units.unit(metric)._asdict() for metric in _SHOWN},
        "set_speed": scenario.control.initial_cutting_speed if is_override else None,
        "advice": chosen,
        "sliders": [slider._asdict() for slider in _sliders(scenario, chosen[0])],
    }


def _sliders(scenario: Scenario, start: dict[str, Any]) -> list[Slider]:
    """Return the sliders, which begin at the first advice and the scenario's prices."""
    economics = scenario.economics
    criterion = scenario.tool.wear_criterion
    depth = scenario.workpiece.depth_of_cut
    edges = economics.edges_per_insert
    low_feed, high_feed = feed_range(scenario)
    low_speed = scenario.machine.cutting_speed_min
    high_speed = scenario.cutting_speed_max
    speed = start["cutting_speed"]
    wear = start["wear"]

    def price(name: str, label: str, unit: str, min_high: float) -> Slider:
        value = getattr(economics, name)
        high = max(min_high, 3.0 * value)
        return Slider(name, label, unit=unit, low=0.0, high=high, value=value)

    worn = "flank wear when the edge is changed"
    return [
        Slider("cutting_speed", "cutting speed", "m/min", low_speed, high_speed, speed),
        Slider("feed", "feed", "mm/rev", low_feed, high_feed, start["feed"]),
        Slider("depth_of_cut", "depth of cut", "mm", 0.2 * depth, 2.0 * depth, depth),
        Slider("wear", worn, "mm", 0.05 * criterion, criterion, wear),
        Slider("hardness", "hardness over nominal", "", 0.7, 1.3, 1.0),
        price("machine_rate", "machine", "money/h", min_high=120.0),
        price("operator_rate", "operator", "money/h", min_high=120.0),
        price("insert_price", "insert", "money", min_high=30.0),
        Slider("edges_per_insert", "edges per insert", "", 1.0, max(16.0, edges), edges),
        price("edge_change_time", "change of edge", "min", min_high=10.0),
    ]
