"""Write one offline HTML page with sliders, whose map, loads, tool life and cost a browser computes from the scenario's laws.

``page.html`` is the frame, ``page.js`` computes and draws. Both lie beside this file and are put into the page.
"""

import hashlib
import html
import json
import math
from base64 import b64encode
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any

from turning_shop.advise import Advice, headline, life_spread, settings
from turning_shop.allowed import allowed_loads, feed_range
from turning_shop.prediction import BEYOND, Evidence
from turning_shop.whatif import NO_LIMIT

from turning_env.scenario import Scenario
from turning_env.scenario.power_law import POWER_LAW_RECORD

_HERE = Path(__file__).parent


def render(
    scenario: Scenario, evidence: Evidence, advice: list[Advice], simulated: Sequence[str] = ()
) -> str:
    """Return the page as HTML, which needs no other file and no network; it begins with the first advice.

    ``simulated`` are sentences on what the simulation said of the advice.
    """
    script = (_HERE / "page.js").read_text("utf-8")
    data = json.dumps(page_data(scenario, evidence, advice), allow_nan=False, separators=(",", ":"))
    work = scenario.workpiece
    return Template((_HERE / "page.html").read_text("utf-8")).substitute(
        name=html.escape(scenario.name),
        work=html.escape(f"bars of {work.diameter:g} mm diameter, {work.bar_length:g} mm long"),
        criterion=f"{scenario.tool.wear_criterion:g}",
        warnings="".join(f"<li>{html.escape(warning)}</li>" for warning in evidence.warnings),
        headline="".join(
            f"<p>{html.escape(line)}</p>"
            for line in (*headline(scenario, evidence, advice), *simulated)
        ),
        data=data.replace("<", "\\u003c"),
        script=script,
        # No script but this one runs, whatever a scenario is called.
        script_digest=b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )


def page_data(scenario: Scenario, evidence: Evidence, advice: Sequence[Advice]) -> dict[str, Any]:
    """Return the data of ``page.js`` as JSON values."""
    material, machine, work, economics = (
        scenario.material,
        scenario.machine,
        scenario.workpiece,
        scenario.economics,
    )
    laws = {name: getattr(material, name) for name in ("wear", "thrust_force", "power")}
    speeds, feeds, _ = settings(scenario)
    shown = ("cutting_speed", "feed", "wear")
    chosen: list[dict[str, Any]] = [
        {"aim": aim} | {name: float(getattr(plan.cuts, name)) for name in shown}
        for aim, plan, _ in advice
    ]
    best = chosen[0]
    limits = {name: getattr(scenario.limits, name) for name in NO_LIMIT}
    allowed = allowed_loads(scenario)
    loads = {"thrust_force": allowed.thrust_force, "power": allowed.power}
    lowest_feed, highest_feed = feed_range(scenario)
    criterion, depth, edges = (
        scenario.tool.wear_criterion,
        work.depth_of_cut,
        economics.edges_per_insert,
    )

    def priced(name: str, label: str, unit: str, least: float) -> tuple[Any, ...]:
        value = getattr(economics, name)
        return name, label, unit, 0.0, max(least, 3.0 * value), value

    sliders = (
        (
            "cutting_speed",
            "cutting speed",
            "m/min",
            machine.cutting_speed_min,
            scenario.cutting_speed_max,
            best["cutting_speed"],
        ),
        ("feed", "feed", "mm/rev", lowest_feed, highest_feed, best["feed"]),
        ("depth_of_cut", "depth of cut", "mm", 0.2 * depth, 2.0 * depth, depth),
        (
            "wear",
            "flank wear when the edge is changed",
            "mm",
            0.05 * criterion,
            criterion,
            best["wear"],
        ),
        ("hardness", "hardness over nominal", "", 0.7, 1.3, 1.0),
        priced("machine_rate", "machine", "money/h", 120.0),
        priced("operator_rate", "operator", "money/h", 120.0),
        priced("insert_price", "insert", "money", 30.0),
        ("edges_per_insert", "edges per insert", "", 1.0, max(16.0, edges), edges),
        priced("edge_change_time", "change of edge", "min", 10.0),
    )
    return {
        "laws": {
            name: {key: float(getattr(law, key)) for key in POWER_LAW_RECORD.names or ()}
            for name, law in laws.items()
        },
        "known": {
            name: known.model_dump(
                mode="json", include={"terms", "covariance", "scatter", "measured"}
            )
            | {
                "quantile": known.quantile,
                "reference_depth_of_cut": laws[name].reference_depth_of_cut,
            }
            for name, known in evidence.laws.items()
        },
        "beyond": BEYOND,
        "life_spread": life_spread(scenario),
        "criterion": criterion,
        "allowed": {name: None if math.isinf(load) else load for name, load in loads.items()},
        "limits": {
            name: None if limit == NO_LIMIT[name] else limit for name, limit in limits.items()
        },
        "speeds": speeds.ravel().tolist(),
        "feeds": feeds.ravel().tolist(),
        "base_cutting_speed": scenario.base_cutting_speed or None,
        "idle_power_per_speed": scenario.spindle.idle_torque / (30.0 * work.diameter),
        "diameter": work.diameter,
        "bar_length": work.bar_length,
        "approach": work.approach,
        "return_time": machine.return_time,
        "edge_cost": economics.edge_cost,
        "currency": economics.currency,
        "set_speed": scenario.control.initial_cutting_speed
        if scenario.control.action == "override"
        else None,
        "advice": chosen,
        "sliders": [
            dict(zip(("name", "label", "unit", "low", "high", "value"), each, strict=True))
            for each in sliders
        ],
    }
