"""Write one offline HTML page with sliders, whose numbers are a table that Python computes.

The sliders have steps, and the table holds the plan of every combination of steps: those of
``advise.py`` and nothing else. ``page.html`` is the frame; ``page.js`` looks up, and draws. Both
lie beside this file and are put into the page.
"""

import hashlib
import html
import json
from base64 import b64encode
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

import numpy as np
from turning_shop import Values
from turning_shop.advise import Advice, PartPlan, Prices, headline, plan, round_numbers, settings
from turning_shop.allowed import allowed_loads
from turning_shop.prediction import Evidence, longest_life, outside
from turning_shop.units import METRIC, Units
from turning_shop.whatif import what_if

from turning_env.scenario import Scenario

_HERE = Path(__file__).parent
MAX_SPEEDS = 24  # steps of the slider, besides the advised ones
MAX_FEEDS = 16
DEPTHS = (0.5, 0.75, 1.0, 1.25, 1.5)  # over the scenario's depth of cut [-]
WEARS = (0.2, 0.4, 0.6, 0.8, 1.0)  # over the wear criterion [-]
HARDNESSES = (0.8, 1.0, 1.2)  # over nominal [-]


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
        prices=html.escape(_prices(scenario)),
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


def _prices(scenario: Scenario) -> str:
    """Return the prices of a scenario, for people."""
    prices = Prices.of(scenario)
    return (
        f"a minute costs {prices.minute:.3g} {prices.unit}, an edge {prices.edge:.3g} "
        f"{prices.unit}; a change takes {prices.change_time:g} min"
    )


_SHOWN = ("m/min", "mm/rev", "mm", "N", "kW", "cm3/min")
"""Metric units of the numbers that the page shows in other units."""


class Axis(NamedTuple):
    """A slider of the page, and an axis of its table."""

    name: str
    label: str
    unit: str
    values: list[float]  # of its steps


def page_data(
    scenario: Scenario, evidence: Evidence, advice: Sequence[Advice], units: Units = METRIC
) -> dict[str, Any]:
    """Return the data of ``page.js`` as JSON values."""
    axes = _axes(scenario, advice)
    chosen = []
    for entry in advice:
        chosen.append({"aim": entry.aim, "at": _steps(axes, scenario, entry)})
    table = {}
    for name, values in table_of(scenario, evidence, axes).items():
        table[name] = _packed(values)
    return {
        "axes": [axis._asdict() for axis in axes],
        "table": table,
        "advice": chosen,
        "measured": _measured(scenario, evidence, axes),
        "origins": evidence.origins,
        "longest_life": longest_life(evidence),
        "unit": Prices.of(scenario).unit,
        "units": {metric: units.unit(metric)._asdict() for metric in _SHOWN},
    }


def _axes(scenario: Scenario, advice: Sequence[Advice]) -> list[Axis]:
    """Return the axes in the order of the table; every advised cut is one of their steps."""
    work = scenario.workpiece
    cuts = [entry.plan.cuts for entry in advice]
    speeds, feeds, _ = settings(scenario)
    speed_steps = _thinned(speeds, MAX_SPEEDS, [float(cut.cutting_speed) for cut in cuts])
    feed_steps = _thinned(feeds, MAX_FEEDS, [float(cut.feed) for cut in cuts])
    depths = [share * work.depth_of_cut for share in DEPTHS]
    reached = [depth for depth in depths if 2.0 * depth < work.diameter]
    criterion = scenario.tool.wear_criterion
    wears = {round(share * criterion, 9) for share in WEARS}
    wears |= {round(float(cut.wear), 9) for cut in cuts}
    return [
        Axis("cutting_speed", "cutting speed", "m/min", speed_steps),
        Axis("feed", "feed", "mm/rev", feed_steps),
        Axis("depth_of_cut", "depth of cut", "mm", reached),
        Axis("wear", "flank wear when the edge is changed", "mm", sorted(wears)),
        Axis("hardness", "hardness over nominal", "", list(HARDNESSES)),
    ]


def _thinned(tried: Values, count: int, advised: Sequence[float]) -> list[float]:
    """Return about ``count`` round numbers over the range that is tried, and the advised ones."""
    low = float(tried.min())
    high = float(tried.max())
    steps = set(advised)
    if high > low:
        steps |= set(round_numbers(low, high, count).tolist())
    return sorted(steps)


def _steps(axes: Sequence[Axis], scenario: Scenario, advice: Advice) -> list[int]:
    """Return the step of each axis at which an advice stands."""
    cuts = advice.plan.cuts
    at = {name: float(getattr(cuts, name)) for name in ("cutting_speed", "feed", "wear")}
    at |= {"depth_of_cut": scenario.workpiece.depth_of_cut, "hardness": 1.0}
    return [int(np.abs(np.array(axis.values) - at[axis.name]).argmin()) for axis in axes]


def table_of(scenario: Scenario, evidence: Evidence, axes: Sequence[Axis]) -> dict[str, Values]:
    """Return the quantities of the plans at all steps: arrays whose dimensions are the axes.

    A quantity that does not depend on an axis has the length 1 along it. Half the 95 % interval of
    a load or a life is the logarithm of its ``_factor``; it is NaN if nothing is known of the law.
    """
    speeds, feeds, depths, wears, hardnesses = (np.array(axis.values) for axis in axes)
    speed, feed, wear, hardness = np.meshgrid(speeds, feeds, wears, hardnesses, indexing="ij")
    by_depth = []
    for depth in depths:
        work = scenario.workpiece.model_copy(update={"depth_of_cut": float(depth)})
        at_depth = scenario.model_copy(update={"workpiece": work})
        planned = plan(
            at_depth, evidence, cutting_speed=speed, feed=feed, wear=wear, hardness=hardness
        )
        by_depth.append(_quantities(at_depth, evidence, planned))
    table = {}
    for name in by_depth[0]:
        values = np.stack([quantities[name] for quantities in by_depth], axis=2)
        table[name] = _without_idle_axes(values)
    return table


def _quantities(scenario: Scenario, evidence: Evidence, planned: PartPlan) -> dict[str, Values]:
    """Return what the page shows of plans at one depth."""
    cuts = planned.cuts
    prediction = planned.prediction
    shares = allowed_loads(scenario).shares(scenario, cuts)
    # A life beyond the one that the law is used for is infinite: wear does not limit it.
    is_used = cuts.tool_life <= longest_life(evidence)
    quantities = {
        "thrust_force": cuts.thrust_force,
        "power": cuts.power,
        "tool_life": np.where(is_used, cuts.tool_life, np.inf),
        "removal_rate": cuts.removal_rate,
        "spindle_speed": cuts.spindle_speed,
        "thrust_force_share": shares.thrust_force,
        "power_share": shares.power,
        "extrapolated": prediction.extrapolated,
    }
    for name in ("thrust_force", "power", "tool_life"):
        quantities[f"{name}_factor"] = np.sqrt(prediction.high[name] / prediction.low[name])
    for name in ("parts", "minutes", "cycle_time", "mean_removal_rate", "cost"):
        quantities[name] = getattr(planned, name)
    quantities["cost_low"] = planned.cost_low
    quantities["cost_high"] = planned.cost_high
    return quantities


def _without_idle_axes(values: Values) -> Values:
    """Return an array with the length 1 along every axis on which it does not depend."""
    for axis in range(values.ndim):
        first = np.take(values, [0], axis=axis)
        if np.allclose(values, first, rtol=1e-12, atol=0.0, equal_nan=True):
            values = first
    return values


def _packed(values: Values) -> dict[str, Any]:
    """Return an array for JSON: its shape, and its numbers as 32-bit floats in base64."""
    numbers = np.ascontiguousarray(values, dtype="<f4")
    return {"shape": list(values.shape), "numbers": b64encode(numbers.tobytes()).decode()}


def _measured(
    scenario: Scenario, evidence: Evidence, axes: Sequence[Axis]
) -> dict[str, list[float]] | None:
    """Return the speeds and feeds of the axes between which all laws hold; None if there are none.

    The range of the map that is not marked as extrapolated by speed or feed alone.
    """
    box = {}
    cut = what_if(scenario, axes[0].values[0], axes[1].values[0], wear=axes[3].values[0])
    ranges = {measured.factor: measured for measured in outside(evidence, cut._asdict())}
    for axis in axes[:2]:
        low = axis.values[0]
        high = axis.values[-1]
        if axis.name in ranges:
            low = max(low, ranges[axis.name].low)
            high = min(high, ranges[axis.name].high)
        if low >= high:
            return None
        box[axis.name] = [low, high]
    return box if ranges else None
