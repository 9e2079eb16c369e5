"""Write one page to pin to the machine: which wear to measure next, and what that will narrow.

The gain is found as the user will find it: ``calibrate`` fits laws to a sheet of the readings that
are expected, and the intervals are those of its laws. ``start_answer.py`` names the one reading
that narrows the cost most, together with the catalogue.
"""

import html
import math
from pathlib import Path
from string import Template
from typing import NamedTuple

import numpy as np
from scipy import special
from turning_shop import Values, WorkshopError
from turning_shop.advise import PartPlan
from turning_shop.calibrate import calibrate
from turning_shop.fit import TYPICAL_EDGE_SPREAD
from turning_shop.measurements import Measurements
from turning_shop.prediction import LawEvidence, evidence_of
from turning_shop.start import CatalogueJob
from turning_shop.units import METRIC, Units

from turning_env.scenario.power_law import PowerLaw
from turning_env.scenario.sections import Material

EDGES = (4, 6, 8, 10)
"""Numbers of edges that are compared; fewer do not show how edges differ."""
ENOUGH = 0.5  # share of the interval of the life that is narrow enough to stop measuring [-]
STOPS = (1 / 3, 1 / 2, 2 / 3, 1.0)
"""Wears at which an edge is read, over that at its change [-]: about 0.1 to 0.3 mm."""
READING_ERROR = {"wear": 0.05, "power": 0.01}
"""Standard deviation of the logarithm of one reading of an edge [-] (assumption)."""
SIGNS = (1.0, -1.0, -1.0, 1.0)
"""Signs of the errors at the stops of an edge; they hardly change its level and its growth."""
_HERE = Path(__file__).parent


class Interval(NamedTuple):
    """A 95 % interval of a quantity."""

    low: float
    value: float
    high: float

    @property
    def log_width(self) -> float:
        """Logarithm of its upper over its lower end [-]."""
        return math.log(self.high / self.low)


class Known(NamedTuple):
    """Intervals of life and power at the advised cut after some edges were measured."""

    edges: int  # 0: only the catalogue
    life: Interval  # cutting time of a usual edge up to its change [min]
    power: Interval  # of the spindle at the change, with the idle power [kW]


class Stop(NamedTuple):
    """A stop at which an edge is read."""

    time: float  # cutting time since the edge was fresh [min]
    parts: float
    wear: float  # that is expected [mm]

    @property
    def parts_text(self) -> str:
        """The parts for people."""
        return "1 part" if self.parts == 1 else f"{self.parts:.3g} parts"


def stops(job: CatalogueJob, best: PartPlan) -> list[Stop]:
    """Return when to stop and read an edge: after whole parts if it lasts some.

    Raises:
        WorkshopError: The wear of the advised cut does not limit the edge.
    """
    if not best.by_wear:
        raise WorkshopError(
            "--plan: wear does not limit the edge at the advised cut, so there is no wear to "
            "measure; raise the speed, or state an economics.machine_rate"
        )
    law = job.scenario.material.wear
    cuts = best.cuts
    part_time = float(best.minutes) / float(best.parts)
    lasting = float(cuts.time) / part_time
    planned = []
    for share in STOPS:
        # W = c t^g
        parts = lasting * share ** (1.0 / law.time)
        if lasting * STOPS[0] ** (1.0 / law.time) >= 1.0:
            parts = float(round(parts))
        time = parts * part_time
        wear = law(cuts.cutting_speed, cuts.feed, cuts.depth_of_cut, time=time)
        planned.append(Stop(time=time, parts=parts, wear=float(wear)))
    return planned


def expected_sheet(job: CatalogueJob, best: PartPlan, edges: int) -> Measurements:
    """Return the readings that are expected of some edges at the advised cut.

    The law's values, with edges and readings that differ as usual: the deviations are the normal
    quantiles of as many edges, so that their mean is 0 and their standard deviation exact.
    """
    material = job.scenario.material
    planned = stops(job, best)
    rows = edges * len(planned)
    edge = np.repeat(np.arange(edges), len(planned))
    ranks = (np.arange(edges) + 0.5) / edges
    quantiles = special.ndtri(ranks)
    deviation = (quantiles / np.std(quantiles, ddof=1))[edge]
    error = np.tile(SIGNS, edges)

    settings: dict[str, Values] = {}
    for name in ("cutting_speed", "feed", "depth_of_cut"):
        settings[name] = np.full(rows, float(getattr(best.cuts, name)))
    time = np.tile([stop.time for stop in planned], edges)

    # An edge that wears fast need not take more power at a wear: the order is another one.
    wear = _scattered(
        material.wear,
        settings | {"time": time},
        job.edge_spread * deviation,
        READING_ERROR["wear"] * error,
    )
    order = np.roll(deviation, len(planned) * (edges // 2))
    power = _scattered(
        material.power,
        settings | {"wear": wear},
        TYPICAL_EDGE_SPREAD["power"] * order,
        READING_ERROR["power"] * error,
    )
    return Measurements(
        columns=settings | {"time": time, "wear": wear, "power": power},
        lines=np.arange(2, rows + 2),
        edges=edge,
    )


def _scattered(
    law: PowerLaw, factors: dict[str, Values], of_edges: Values, of_readings: Values
) -> Values:
    """Return readings about a law, from which edges and readings deviate in the logarithm [-]."""
    return np.asarray(law(**factors) * np.exp(of_edges + of_readings))


def known_now(job: CatalogueJob, best: PartPlan) -> Known:
    """Return what the catalogue tells."""
    return _known(0, best, laws=job.evidence.laws, material=job.scenario.material)


def known_after(job: CatalogueJob, best: PartPlan, sheet: Measurements) -> Known:
    """Return what ``calibrate`` tells with a sheet, about the expected life and power.

    Raises:
        WorkshopError: No law can be fitted to the sheet.
    """
    calibration = calibrate(sheet, job.scenario, force=True)
    laws = {name: evidence_of(fitted) for name, fitted in calibration.fits.items()}
    edges = len(np.unique(sheet.edges)) if sheet.edges is not None else 0
    return _known(edges, best, laws=laws, material=calibration.material)


def _known(
    edges: int, best: PartPlan, *, laws: dict[str, LawEvidence], material: Material
) -> Known:
    """Return the intervals of the usual life and power at the advised cut.

    They are those of the laws; edges and readings differ on top of them.
    """
    factors = best.cuts._asdict()
    wear = laws["wear"]
    life_deviation = wear.log_deviation(material.wear, factors, of_reading=False)
    # W = c t^g, so that the logarithm of the time to a wear deviates by 1 / g of that of wear.
    life_doubt = wear.quantile * float(life_deviation) / material.wear.time
    power = laws["power"]
    power_deviation = power.log_deviation(material.power, factors, of_reading=False)
    power_doubt = power.quantile * float(power_deviation)
    return Known(
        edges=edges,
        life=_interval(float(best.cuts.time), life_doubt),
        power=_interval(float(best.cuts.power), power_doubt),
    )


def _interval(value: float, log_half_width: float) -> Interval:
    factor = math.exp(log_half_width)
    return Interval(low=value / factor, value=value, high=value * factor)


# The page.


def render(job: CatalogueJob, best: PartPlan, units: Units = METRIC) -> str:
    """Return the page as HTML, which needs no other file.

    Raises:
        WorkshopError: The wear of the advised cut does not limit the edge.
    """
    planned = stops(job, best)
    now = known_now(job, best)
    later = []
    for edges in EDGES:
        sheet = expected_sheet(job, best, edges)
        later.append(known_after(job, best, sheet))
    chosen = enough(now, later)

    scenario = job.scenario
    cuts = best.cuts
    setting = (
        f"{float(cuts.cutting_speed):.4g} m/min, {float(cuts.feed):.3g} mm/rev, "
        f"{float(cuts.depth_of_cut):g} mm deep, bars of {scenario.workpiece.diameter:g} mm "
        f"diameter, {scenario.workpiece.bar_length:g} mm of cut a part"
    )
    change = f"{float(cuts.wear):.2g} mm"
    return Template((_HERE / "wear_plan.html").read_text("utf-8")).substitute(
        title=html.escape(f"{job.insert.name} {job.grade} in {job.material.name}"),
        machine=html.escape(job.question.machine),
        setting=html.escape(units.text(setting)),
        change=units.text(change),
        edges=chosen.edges,
        stops=html.escape(_listed(planned)),
        gains=_gains(now, later, chosen),
        boxes=_boxes(planned, chosen.edges, units),
        example=html.escape(_example(best, planned[0])),
        spread=f"{100 * job.edge_spread:.0f} %",
    )


def enough(now: Known, later: list[Known]) -> Known:
    """Return what the fewest edges tell that narrow the life by ``ENOUGH``; the most if none do."""
    for known in later:
        if known.life.log_width <= ENOUGH * now.life.log_width:
            return known
    return later[-1]


def _listed(planned: list[Stop]) -> str:
    """Return the stops as text."""
    texts = []
    for stop in planned:
        texts.append(f"{stop.parts_text} ({stop.time:.3g} min of cutting)")
    return ", ".join(texts[:-1]) + f" and {texts[-1]}"


def _gains(now: Known, later: list[Known], chosen: Known) -> str:
    """Return the rows of the table of what edges tell."""
    rows = []
    for known in (now, *later):
        name = f"{known.edges} edges" if known.edges else "catalogue alone"
        life = f"{known.life.low:.3g} to {known.life.high:.3g} min"
        power = f"{known.power.low:.3g} to {known.power.high:.3g} kW"
        share = ""
        if known.edges:
            share = f"{100 * known.life.log_width / now.life.log_width:.0f} %"
        mark = ' class="chosen"' if known is chosen else ""
        cells = "".join(f"<td>{cell}</td>" for cell in (name, life, share, power))
        rows.append(f"<tr{mark}>{cells}</tr>")
    return "\n".join(rows)


def _boxes(planned: list[Stop], edges: int, units: Units) -> str:
    """Return the table with empty boxes."""
    heads = []
    for stop in planned:
        expected = units.text(f"{stop.wear:.2f} mm")
        heads.append(
            f'<th colspan="2">{stop.parts_text}<br>{stop.time:.3g} min'
            f"<br><small>expected VB {expected}</small></th>"
        )
    names = "<th>VB [mm]</th><th>P [kW]</th>" * len(planned)
    rows = [
        f'<tr><th rowspan="2">edge</th>{"".join(heads)}<th rowspan="2">note</th></tr>',
        f"<tr>{names}</tr>",
    ]
    empty = "<td></td>" * (2 * len(planned) + 1)
    rows += [f"<tr><th>{number}</th>{empty}</tr>" for number in range(1, edges + 1)]
    return "\n".join(rows)


def _example(best: PartPlan, stop: Stop) -> str:
    """Return the head of the sheet, and a row to fill in."""
    cuts = best.cuts
    settings = f"{float(cuts.cutting_speed):g},{float(cuts.feed):g},{float(cuts.depth_of_cut):g}"
    return (
        "edge,cutting_speed,feed,depth_of_cut,time,wear,power\n"
        f"1,{settings},{stop.time:.3g},____,____"
    )
