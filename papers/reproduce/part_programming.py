"""Sharmazanashvili (2008): gain by correcting the tool path to the measured blank, by rule and kind of blank.

The paper's claim: for roughing, the correction improves the rules [PV] [SN] [PN] [MV] [MN], and is not necessary with [PT] [MT].
Its figures are lost. They are recomputed from exponents of engineering handbooks and the paper's dispersions of the allowance:

* Force goes with S^0.75 t, power with V times that, torque as force; life goes with V^-5 S^-1.75 t^-0.75 (V cutting speed, S
  feed, t depth of cut).
* All limits meet in one cut, 145 m/min and 0.32 mm/rev at 2.5 mm, where the edge has its economic life. So rules differ only by
  their exponents. A limit that a rule does not name does not bind, but speed and feed stay in the lathe's ranges (assumptions).
* The allowance is normal, its dispersion being six standard deviations, above the least that roughness, defect layer and
  spatial deviation ask for (assumption; where a source lacks these, the handbooks').
* Uncorrected, the path is made for the largest blank of its kind: passes of the same depth, counted from the finished part
  outwards, as many as are cheapest in the mean. A smaller blank leaves less for the first passes, or only air. Corrected, every
  blank is measured and divided anew into the cheapest number of equal passes. Either way the control is adaptive: speed and feed
  of each pass are the rule's at the depth that it meets. Every pass also costs the time to return (0.1 min, assumption).

The gain is the paper's psi = (Q_0/Q_a - 1) 100 %, uncorrected over corrected cost of the mean part.
"""

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from baselines.fixed import HANDBOOK_CUTTING_SPEED, HANDBOOK_FEED
from baselines.models.process import Array, Limit, Process
from baselines.two_limits import MIN_DEPTH, TWO_LIMITS, depth_exponents, set_point
from papers.reproduce.alaskari_oraby import PAPER
from papers.reproduce.checks import Check, at_least, at_most, table
from turning_env import PowerLaw, Scenario

IMPROVED = ("PV", "SN", "PN", "MV", "MN")
NOT_NECESSARY = ("PT", "MT")
"""The paper's claims on the rules; it has none on [SV] and [ST]."""
WORTH_HAVING = 1.0
"""Least psi that counts as an improvement [%] (assumption)."""

RETURN_TIME = 0.1
"""[min] per pass."""
MAX_PASSES = 8
_DEVIATIONS = np.linspace(-3.0, 3.0, 241)


def _law(cutting_speed: float, feed: float, depth_of_cut: float, time: float = 0.0, at_time: float = 1.0) -> PowerLaw:
    """Return a law that is 1 in the common cut, for wear at a cutting time [min]."""
    at_reference = HANDBOOK_CUTTING_SPEED**cutting_speed * HANDBOOK_FEED**feed * at_time**time
    exponents = {"cutting_speed": cutting_speed, "feed": feed, "depth_of_cut": depth_of_cut, "time": time}
    return PowerLaw(coefficient=1.0 / at_reference, **exponents)


def handbook_process(rule: str) -> Process:
    """Return the handbooks' process, in which only a rule's two limits and the lathe's ranges bind."""
    scenario = Scenario()
    price = Process.of(scenario).edge_price
    speeds = (scenario.machine.cutting_speed_min, scenario.machine.cutting_speed_max)
    feeds = (scenario.machine.feed_min, scenario.machine.feed_max)
    return Process(
        wear=_law(1.0, 0.35, 0.15, time=0.2, at_time=4.0 * price),  # mu = 5, nu = 1.75, rho = 0.75; T_0 = (mu - 1) gamma
        wear_criterion=1.0,
        thrust_force=Limit(_law(0.0, 0.75, 1.0), 1.0 if "P" in rule else math.inf),
        power=Limit(_law(1.0, 0.75, 1.0), 1.0 if "N" in rule else math.inf),
        torque=Limit(_law(0.0, 0.75, 1.0), 1.0 if "M" in rule else math.inf),
        cutting_speed_range=(speeds[0], HANDBOOK_CUTTING_SPEED if "V" in rule else speeds[1]),
        feed_range=(feeds[0], HANDBOOK_FEED if "S" in rule else feeds[1]),
        edge_price=price,
    )


@dataclass(frozen=True)
class Blank:
    """A kind of blank."""

    name: str
    source: str
    least: float
    """Least allowance [mm]."""
    dispersion: float
    """Largest less least allowance [mm]."""

    @property
    def largest(self) -> float:
        """Greatest allowance [mm]."""
        return self.least + self.dispersion

    @property
    def allowances(self) -> Array:
        """Allowances [mm] at evenly spaced deviations."""
        return self.least + self.dispersion * (0.5 + _DEVIATIONS / 6.0)


@cache
def blanks() -> tuple[Blank, ...]:
    """Return the blanks of the handbooks and of manufacturing experience, where these give a dispersion."""
    with (PAPER / "allowance_dispersion.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    parts = ("rz_mm", "defect_layer_mm", "spatial_deviation_mm")
    least = {row["stock"]: sum(float(row[part] or 0.0) for part in parts) for row in rows if row["source"] == "handbook"}
    return tuple(
        Blank(row["stock"], row["source"], least[row["stock"]], float(row["allowance_dispersion_mm"]))
        for row in rows
        if row["source"] in ("handbook", "experience") and row["allowance_dispersion_mm"]
    )


def pass_cost(rule: str, depth_of_cut: Array) -> Array:
    """Return the cost of one pass over the nominal bar [min] at a depth of cut [mm], infinite if too deep for the lowest feed.

    A pass in air is run at the ends of the ranges.
    """
    process, workpiece = handbook_process(rule), Scenario().workpiece
    speed, feed = set_point(rule, process, depth_of_cut)
    depth = np.maximum(depth_of_cut, MIN_DEPTH)
    time = math.pi * workpiece.diameter * workpiece.bar_length / (1000.0 * speed * feed)
    cost = time * (1.0 + process.edge_price * np.exp(-process.log_life(np.log(speed), np.log(feed), depth, 1.0))) + RETURN_TIME
    for limit in (process.thrust_force, process.power, process.torque):
        cost[limit.law(speed, feed, depth) > np.multiply(limit.most, 1.0 + 1e-9)] = np.inf
    return cost


def divided_cost(rule: str, allowance: Array) -> Array:
    """Return the cost of parts [min] in 1, 2, ... equal passes, shape (passes, parts), for allowances [mm]."""
    counts = np.arange(1, MAX_PASSES + 1)[:, np.newaxis]
    return counts * pass_cost(rule, allowance / counts)


def uncorrected_cost(rule: str, blank: Blank, passes: int) -> Array:
    """Return the cost of parts [min] of a path for the largest blank, for the blank's allowances."""
    depth = blank.largest / passes
    inside = np.arange(passes)[:, np.newaxis] * depth  # allowance that lies inside each pass, from the last pass to the first
    return np.asarray(pass_cost(rule, np.clip(blank.allowances - inside, 0.0, depth)).sum(axis=0))


@cache
def gain(rule: str, blank: Blank) -> tuple[int, float]:
    """Return (passes of the uncorrected path, psi [%])."""
    weights = np.exp(-0.5 * _DEVIATIONS**2)
    uncorrected = [float(weights @ uncorrected_cost(rule, blank, passes)) for passes in range(1, MAX_PASSES + 1)]
    corrected = float(weights @ divided_cost(rule, blank.allowances).min(axis=0))
    return 1 + int(np.argmin(uncorrected)), 100.0 * (min(uncorrected) / corrected - 1.0)


_ONE_PASS = "its removal rate does not depend on depth: one pass is cheapest, and leaves nothing to correct"
_TWO_PASSES = "the largest welded blank takes two passes: one would exceed the limit at the lathe's lowest feed"
NOT_REPRODUCED = {
    **dict.fromkeys((("SN", "handbook"), ("SN", "experience")), _ONE_PASS),
    **dict.fromkeys((("PT", "experience"), ("MT", "experience")), _TWO_PASSES),
}


def checks() -> Iterator[Check]:
    """Yield the checks of the claim for every rule that it names, with the kind of blank that gains most."""
    for source in ("handbook", "experience"):
        for rule in (*IMPROVED, *NOT_NECESSARY):
            most = max(gain(rule, blank)[1] for blank in blanks() if blank.source == source)
            compare = at_least if rule in IMPROVED else at_most
            what = f"[{rule}]: largest psi with dispersions of {source} [%]"
            yield compare(what, WORTH_HAVING, most, NOT_REPRODUCED.get((rule, source), ""))


def tables() -> Iterator[str]:
    """Yield the tables of each rule's exponents of depth of cut, and of the gain by correcting the path."""
    yield "Exponent of the depth of cut along each rule, in cutting speed, feed, removal rate and life of the edge."
    yield "Handbook exponents; last: removal rate with the laws of 709M40."
    rows = []
    for rule in TWO_LIMITS:
        process = handbook_process(rule)
        speed, feed = depth_exponents(rule, process)
        mu, nu, rho = process.life_exponents
        values = (speed, feed, 1.0 + speed + feed, -(mu * speed + nu * feed + rho))
        steel = 1.0 + sum(depth_exponents(rule, Process.of(Scenario())))
        rows.append([f"[{rule}]", *(f"{value + 0.0:.3f}" for value in (*values, steel))])
    yield from table(("", "speed", "feed", "rate", "life", "709M40"), rows)
    yield ""
    yield "psi: gain by correcting the path to the measured blank [%]; in brackets the passes of the uncorrected path."
    rows = []
    for blank in blanks():
        gains = (f"{psi:.1f} ({passes})" for passes, psi in (gain(rule, blank) for rule in TWO_LIMITS))
        rows.append([f"{blank.name} ({blank.source})", f"{blank.least:.2f}-{blank.largest:.2f}", *gains])
    yield from table(["", "mm", *(f"[{rule}]" for rule in TWO_LIMITS)], rows)
