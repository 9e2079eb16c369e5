"""Sharmazanashvili (2008): the gain from correcting the tool path to the measured blank.

The paper's claim: for roughing, the correction improves the rules [PV] [SN] [PN] [MV] [MN], and is
not necessary with [PT] [MT]. Its figures are lost. They are recomputed by rule and kind of blank,
from exponents of engineering handbooks and the paper's dispersions of the allowance:

* Force and torque go with S^0.75 t, power with V times that; life with V^-5 S^-1.75 t^-0.75
  (V cutting speed, S feed, t depth).
* A rule's limits meet in one cut, 145 m/min and 0.32 mm/rev at 2.5 mm, where the edge has its
  economic life. The other limits, which the slides keep too, are ``SLACK`` times their value in
  that cut (assumption): along [SN] only the force bounds the depth. The slides bound speed and feed
  from above only, so the project's lowest speed and feed do not apply.
* The allowance is normal. Its dispersion is six standard deviations, above the least allowance that
  roughness, defect layer and spatial deviation ask for (assumption; where a source prints none of
  its own, the handbooks').
* Uncorrected, the path is made for the largest blank of its kind, in equal passes counted from the
  finished part outwards; their number is the cheapest in the mean. A smaller blank leaves less for
  the first passes, or only air. Corrected, every blank is divided anew into the cheapest number of
  equal passes. Speed and feed of each pass are the rule's at its depth. Every pass also costs the
  time to return (0.1 min, assumption).

The gain is the paper's psi = (Q_0 / Q_a - 1) 100 %, uncorrected over corrected cost of the mean
part.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from baselines.fixed import HANDBOOK_CUTTING_SPEED, HANDBOOK_FEED
from baselines.models.process import Limit, Process
from baselines.rule import Array
from baselines.two_limits import MIN_DEPTH, set_point
from research.papers import rows
from research.papers.reproduce.checks import Check, aligned_table, at_least, at_most
from research.papers.reproduce.part_programming_cases import case_checks, formula_checks
from turning_env import PowerLaw, Scenario
from turning_env.scenario.laws import machining_cost

# The paper's claims on the rules; it has none on [SV] and [ST].
IMPROVED = ("PV", "SN", "PN", "MV", "MN")
NOT_NECESSARY = ("PT", "MT")
CLAIMED = (*IMPROVED, *NOT_NECESSARY)
SOURCES = ("handbook", "experience", "literature")  # the slides' sources of dispersions
WORTH_HAVING = 1.0  # least psi that counts as an improvement [%] (assumption)
SLACK = 2.0  # limits that a rule does not name, over their value in the common cut [-]

READINGS = {"punching": (0.084, 1.1), "rolling": (2.1, 1.05, 0.21, 0.0), "welding": (1.06, 0.06)}
"""Spatial deviations [mm] that the handbooks' garbled cells can be read as, by kind of blank.

The first reading is the one in use. The copy has "0.084, 1 Q, 1.1" for punched blanks, "2.1" in the
next column for rolled ones, and "0.06 *, 1.06" for welded ones. The values 1.05 and 0.21 stand for
a reading of half and a tenth of 2.1, and 0 for none.
"""

RETURN_TIME = 0.1  # [min] per pass
MAX_PASSES = 8
NOMINAL = Scenario()
_MIN_SPEED_AND_FEED = 1e-3  # in place of a lowest cutting speed [m/min] and feed [mm/rev]
_DEVIATIONS = np.linspace(-3.0, 3.0, num=241)  # of an allowance from its mean [standard deviations]


def _law(
    cutting_speed: float, feed: float, depth_of_cut: float, time: float = 0.0, at_time: float = 1.0
) -> PowerLaw:
    """Return a law that is 1 in the common cut.

    Args:
        cutting_speed: exponent of cutting speed [-].
        feed: exponent of feed [-].
        depth_of_cut: exponent of depth of cut [-].
        time: exponent of cutting time [-].
        at_time: cutting time at which the law is 1 [min].
    """
    in_common_cut = HANDBOOK_CUTTING_SPEED**cutting_speed * HANDBOOK_FEED**feed * at_time**time
    return PowerLaw(
        coefficient=1.0 / in_common_cut,
        cutting_speed=cutting_speed,
        feed=feed,
        depth_of_cut=depth_of_cut,
        time=time,
    )


@cache
def handbook_process(rule: str, slack: float = SLACK) -> Process:
    """Return the handbooks' process, with a rule's two limits and the highest speed and feed.

    Args:
        rule: the letters of the two limits: P force, N power, M torque, V speed, S feed, T life.
        slack: limits of speed and feed that the rule does not name, over those that it does [-].
    """

    def limit(letter: str, law: PowerLaw) -> Limit:
        return Limit(law, 1.0 if letter in rule else math.inf)

    price = Process.of(NOMINAL).edge_price
    force = _law(cutting_speed=0.0, feed=0.75, depth_of_cut=1.0)
    power = _law(cutting_speed=1.0, feed=0.75, depth_of_cut=1.0)
    # T = C_T / (V^mu S^nu t^rho) with mu = 5, nu = 1.75, rho = 0.75: the exponents of wear over its
    # exponent of time. At constant feed, the economic life is T_0 = (mu - 1) gamma.
    wear = _law(cutting_speed=1.0, feed=0.35, depth_of_cut=0.15, time=0.2, at_time=4.0 * price)
    max_speed = HANDBOOK_CUTTING_SPEED * (1.0 if "V" in rule else slack)
    max_feed = HANDBOOK_FEED * (1.0 if "S" in rule else slack)
    return Process(
        wear=wear,
        wear_criterion=1.0,
        thrust_force=limit("P", force),
        power=limit("N", power),
        torque=limit("M", force),
        cutting_speed_range=(_MIN_SPEED_AND_FEED, max_speed),
        feed_range=(_MIN_SPEED_AND_FEED, max_feed),
        edge_price=price,
    )


@dataclass(frozen=True)
class Blank:
    """A kind of blank."""

    name: str
    source: str
    least: float  # least allowance [mm]
    dispersion: float  # largest less least allowance [mm]

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
    """Return the blanks of all three sources, where these give a dispersion."""
    all_rows = rows("allowance_dispersion.csv")
    handbook = {row["stock"]: row for row in all_rows if row["source"] == "handbook"}
    stated = []
    for row in all_rows:
        if not row["allowance_dispersion_mm"]:
            continue
        least = 0.0
        for part in ("rz_mm", "defect_layer_mm", "spatial_deviation_mm"):
            least += float(row[part] or handbook[row["stock"]][part] or 0.0)
        blank = Blank(
            name=row["stock"],
            source=row["source"],
            least=least,
            dispersion=float(row["allowance_dispersion_mm"]),
        )
        stated.append(blank)
    return tuple(stated)


def pass_cost(rule: str, depth_of_cut: Array, slack: float = SLACK) -> Array:
    """Return the cost [min] of a pass of a depth [mm] over the nominal bar.

    In air, speed and feed are the highest. A pass that is too deep for the limits costs infinity.
    """
    process = handbook_process(rule, slack)
    workpiece = NOMINAL.workpiece
    speed, feed = set_point(rule, process, depth_of_cut)
    depth = np.maximum(depth_of_cut, MIN_DEPTH)

    # Time to cut, pi d l / (1000 V S), and the share of edges that it uses.
    surface = math.pi * workpiece.diameter * workpiece.bar_length  # [mm2]
    surface_rate = 1000.0 * speed * feed  # [mm2/min]
    time = surface / surface_rate
    log_life = process.log_life(
        np.log(speed),
        np.log(feed),
        depth_of_cut=depth,
        hardness=1.0,
    )
    cost_of_a_minute = machining_cost(1.0, np.exp(-log_life), process.edge_price)
    cost = np.asarray(time * cost_of_a_minute + RETURN_TIME)

    for limit in (process.thrust_force, process.power, process.torque):
        response = limit.law(speed, feed, depth_of_cut=depth)
        max_response = np.minimum(limit.most, slack) * (1.0 + 1e-9)
        cost[response > max_response] = np.inf
    return cost


def divided_cost(rule: str, allowance: Array, slack: float = SLACK) -> Array:
    """Return the cost of parts [min] in 1, 2, ... equal passes, shape (passes, parts).

    Args:
        rule: see ``handbook_process``.
        allowance: allowances [mm], shape (parts,).
        slack: see ``handbook_process``.
    """
    counts = np.arange(1, MAX_PASSES + 1)[:, np.newaxis]
    return counts * pass_cost(rule, allowance / counts, slack=slack)


def uncorrected_cost(rule: str, blank: Blank, passes: int, slack: float = SLACK) -> Array:
    """Return the cost of parts [min] on a path for the largest blank, by allowance."""
    depth = blank.largest / passes
    # Allowance that lies inside each pass, from the last pass to the first.
    number = np.arange(passes)[:, np.newaxis]
    inside = number * depth
    met_depths = np.clip(blank.allowances - inside, 0.0, depth)
    costs = pass_cost(rule, met_depths, slack=slack)
    return np.asarray(costs.sum(axis=0))


@cache
def gain(rule: str, blank: Blank, slack: float = SLACK) -> float:
    """Return psi = (Q_0 / Q_a - 1) 100 %, uncorrected over corrected cost of the mean part."""
    weights = np.exp(-0.5 * _DEVIATIONS**2)
    by_passes = []
    for passes in range(1, MAX_PASSES + 1):
        costs = uncorrected_cost(rule, blank, passes=passes, slack=slack)
        by_passes.append(float(weights @ costs))
    uncorrected = min(by_passes)

    divided = divided_cost(rule, blank.allowances, slack=slack)
    cheapest = divided.min(axis=0)
    corrected = float(weights @ cheapest)
    return 100.0 * (uncorrected / corrected - 1.0)


def gain_by_reading(rule: str, kind: str, spatial_deviation: float) -> float:
    """Return psi [%] of a kind of blank with the handbooks' dispersion.

    Args:
        rule: see ``handbook_process``.
        kind: kind of blank, a name in ``READINGS``.
        spatial_deviation: spatial deviation [mm] in place of the one in use.
    """
    by_name = {(blank.name, blank.source): blank for blank in blanks()}
    blank = by_name[kind, "handbook"]
    in_use = READINGS[kind][0]
    least = blank.least - in_use + spatial_deviation
    return gain(rule, replace(blank, least=least))


def gains(rule: str, source: str, slack: float = SLACK) -> dict[str, float]:
    """Return psi [%] of the kinds of blank of a source."""
    return {
        blank.name: gain(rule, blank, slack=slack) for blank in blanks() if blank.source == source
    }


def gain_table() -> Iterator[str]:
    """Yield the table of psi, with the mean of each source's kinds."""
    yield "Gain psi from correcting the path to the measured blank [%]."
    heads = ["source of dispersion, blank"]
    for rule in CLAIMED:
        heads.append(f"[{rule}]")
    lines = []
    for source in SOURCES:
        by_rule = [gains(rule, source) for rule in CLAIMED]
        gains_by_kind = {}
        for kind in by_rule[0]:
            gains_by_kind[kind] = [psi[kind] for psi in by_rule]
        means = np.mean(list(gains_by_kind.values()), axis=0)
        gains_by_kind["mean of its kinds"] = means.tolist()
        for kind, values in gains_by_kind.items():
            cells = [f"{value:.1f}" for value in values]
            lines.append([f"{source}, {kind}", *cells])
    yield from aligned_table(heads, lines)


def reading_table() -> Iterator[str]:
    """Yield the table of psi by reading of the garbled spatial deviations."""
    yield (
        "Gain psi by reading of the handbooks' spatial deviations [%]; the first of each kind is "
        "in use."
    )
    heads = ["blank, spatial deviation"]
    heads += [f"[{rule}]" for rule in CLAIMED]
    lines = []
    for kind, deviations in READINGS.items():
        for deviation in deviations:
            values = [gain_by_reading(rule, kind, deviation) for rule in CLAIMED]
            lines.append([f"{kind}, {deviation:g} mm", *(f"{value:.1f}" for value in values)])
    yield from aligned_table(heads, lines)


def tables() -> Iterator[str]:
    """Yield the tables of psi."""
    yield from gain_table()
    yield ""
    yield from reading_table()


def claim_checks() -> Iterator[Check]:
    """Yield the checks of the claims for every rule that they name.

    They hold for the kind of blank that gains most and for the mean of the kinds.
    """
    for source in SOURCES:
        for rule in CLAIMED:
            compare = at_least if rule in IMPROVED else at_most
            values = list(gains(rule, source).values())
            yield compare(
                f"[{rule}]: largest psi with dispersions of {source} [%]",
                WORTH_HAVING,
                ours=max(values),
            )
            yield compare(
                f"[{rule}]: mean psi of the kinds of blank of {source} [%]",
                WORTH_HAVING,
                ours=float(np.mean(values)),
            )


def checks() -> Iterator[Check]:
    """Yield the checks of formulas and cases, and those of the claims."""
    yield from formula_checks()
    yield from case_checks()
    yield from claim_checks()
