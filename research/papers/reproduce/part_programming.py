"""Sharmazanashvili (2008): gain by correcting the tool path to the measured blank, by rule and kind of blank.

The paper's claim: for roughing, the correction improves the rules [PV] [SN] [PN] [MV] [MN], and is not necessary with [PT] [MT].
Its figures are lost. They are recomputed from exponents of engineering handbooks and the paper's dispersions of the allowance:

* Force and torque go with S^0.75 t, power with V times that; life with V^-5 S^-1.75 t^-0.75 (V cutting speed, S feed, t depth).
* A rule's limits meet in one cut, 145 m/min and 0.32 mm/rev at 2.5 mm, where the edge has its economic life. The other limits,
  which the slides keep too, are ``SLACK`` times their value in that cut (assumption): along [SN] only the force bounds the depth.
  The slides bound speed and feed from above only, so the project's lowest speed and feed do not apply.
* The allowance is normal, its dispersion being six standard deviations, above the least that roughness, defect layer and
  spatial deviation ask for (assumption; where a source prints none of its own, the handbooks').
* Uncorrected, the path is made for the largest blank of its kind, in equal passes counted from the finished part outwards; their
  number is the cheapest in the mean. A smaller blank leaves less for the first passes, or only air. Corrected, every blank is
  divided anew into the cheapest number of equal passes. Speed and feed of each pass are the rule's at the depth that it meets.
  Every pass also costs the time to return (0.1 min, assumption).

The gain is the paper's psi = (Q_0/Q_a - 1) 100 %, uncorrected over corrected cost of the mean part.
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
from research.papers.reproduce.checks import Check, at_least, at_most, table
from research.papers.reproduce.part_programming_cases import case_checks, formula_checks
from turning_env import PowerLaw, Scenario

IMPROVED = (
    "PV",
    "SN",
    "PN",
    "MV",
    "MN",
)  # the paper's claims on the rules; it has none on [SV] and [ST]
NOT_NECESSARY = ("PT", "MT")  # likewise
SOURCES = ("handbook", "experience", "literature")  # the slides' sources of dispersions
WORTH_HAVING = 1.0  # least psi that counts as an improvement [%] (assumption)
SLACK = 2.0  # limits that a rule does not name, over their value in the common cut [-]

READINGS = {"punching": (0.084, 1.1), "rolling": (2.1, 1.05, 0.21, 0.0), "welding": (1.06, 0.06)}
"""Spatial deviations [mm] that the handbooks' garbled cells can be read as, by kind of blank; the first is the one in use.

The copy has "0.084, 1 Q, 1.1" for punched blanks, "2.1" in the next column for rolled ones, and "0.06 *, 1.06" for welded ones.
The values 1.05 and 0.21 stand for a reading of half and a tenth of 2.1, and 0 for none.
"""

RETURN_TIME = 0.1  # [min] per pass
MAX_PASSES = 8
_LOWEST = 1e-3  # in place of a lowest cutting speed [m/min] and feed [mm/rev]
_DEVIATIONS = np.linspace(-3.0, 3.0, 241)


def _law(
    cutting_speed: float, feed: float, depth_of_cut: float, time: float = 0.0, at_time: float = 1.0
) -> PowerLaw:
    """Return a law that is 1 in the common cut, for wear at a cutting time [min]."""
    at_reference = HANDBOOK_CUTTING_SPEED**cutting_speed * HANDBOOK_FEED**feed * at_time**time
    exponents = {
        "cutting_speed": cutting_speed,
        "feed": feed,
        "depth_of_cut": depth_of_cut,
        "time": time,
    }
    return PowerLaw(coefficient=1.0 / at_reference, **exponents)


def handbook_process(rule: str, slack: float = SLACK) -> Process:
    """Return the handbooks' process, with a rule's two limits and the highest speed and feed of the lathe."""
    price = Process.of(Scenario()).edge_price
    return Process(
        wear=_law(
            1.0, 0.35, 0.15, time=0.2, at_time=4.0 * price
        ),  # mu = 5, nu = 1.75, rho = 0.75; T_0 = (mu - 1) gamma
        wear_criterion=1.0,
        thrust_force=Limit(_law(0.0, 0.75, 1.0), 1.0 if "P" in rule else math.inf),
        power=Limit(_law(1.0, 0.75, 1.0), 1.0 if "N" in rule else math.inf),
        torque=Limit(_law(0.0, 0.75, 1.0), 1.0 if "M" in rule else math.inf),
        cutting_speed_range=(_LOWEST, HANDBOOK_CUTTING_SPEED * (1.0 if "V" in rule else slack)),
        feed_range=(_LOWEST, HANDBOOK_FEED * (1.0 if "S" in rule else slack)),
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
    found = rows("allowance_dispersion.csv")
    handbook = {row["stock"]: row for row in found if row["source"] == "handbook"}

    def least(row: dict[str, str]) -> float:
        parts = ("rz_mm", "defect_layer_mm", "spatial_deviation_mm")
        return sum(float(row[part] or handbook[row["stock"]][part] or 0.0) for part in parts)

    stated = [row for row in found if row["allowance_dispersion_mm"]]
    return tuple(
        Blank(row["stock"], row["source"], least(row), float(row["allowance_dispersion_mm"]))
        for row in stated
    )


def pass_cost(rule: str, depth_of_cut: Array, slack: float = SLACK) -> Array:
    """Return the cost [min] of a pass of a depth [mm] over the nominal bar: at the ranges' ends in air, infinite if too deep."""
    process, workpiece = handbook_process(rule, slack), Scenario().workpiece
    speed, feed = set_point(rule, process, depth_of_cut)
    depth = np.maximum(depth_of_cut, MIN_DEPTH)
    time = math.pi * workpiece.diameter * workpiece.bar_length / (1000.0 * speed * feed)
    cost = (
        time
        * (
            1.0
            + process.edge_price
            * np.exp(-process.log_life(np.log(speed), np.log(feed), depth, 1.0))
        )
        + RETURN_TIME
    )
    for limit in (process.thrust_force, process.power, process.torque):
        cost[limit.law(speed, feed, depth) > np.minimum(limit.most, slack) * (1.0 + 1e-9)] = np.inf
    return cost


def divided_cost(rule: str, allowance: Array, slack: float = SLACK) -> Array:
    """Return the cost of parts [min] in 1, 2, ... equal passes, shape (passes, parts), for allowances [mm]."""
    counts = np.arange(1, MAX_PASSES + 1)[:, np.newaxis]
    return counts * pass_cost(rule, allowance / counts, slack)


def uncorrected_cost(rule: str, blank: Blank, passes: int, slack: float = SLACK) -> Array:
    """Return the cost of parts [min] of a path for the largest blank, for the blank's allowances."""
    depth = blank.largest / passes
    inside = (
        np.arange(passes)[:, np.newaxis] * depth
    )  # allowance that lies inside each pass, from the last pass to the first
    return np.asarray(
        pass_cost(rule, np.clip(blank.allowances - inside, 0.0, depth), slack).sum(axis=0)
    )


@cache
def gain(rule: str, blank: Blank, slack: float = SLACK) -> tuple[int, float]:
    """Return (passes of the uncorrected path, psi [%])."""
    weights = np.exp(-0.5 * _DEVIATIONS**2)
    uncorrected = [
        float(weights @ uncorrected_cost(rule, blank, passes, slack))
        for passes in range(1, MAX_PASSES + 1)
    ]
    corrected = float(weights @ divided_cost(rule, blank.allowances, slack).min(axis=0))
    return 1 + int(np.argmin(uncorrected)), 100.0 * (min(uncorrected) / corrected - 1.0)


def gain_by_reading(rule: str, kind: str, spatial_deviation: float) -> float:
    """Return psi [%] of a kind of blank with the handbooks' dispersion and another spatial deviation [mm]."""
    blank = next(blank for blank in blanks() if (blank.name, blank.source) == (kind, "handbook"))
    in_use, *_ = READINGS[kind]
    return gain(rule, replace(blank, least=blank.least - in_use + spatial_deviation))[1]


def gains(rule: str, source: str, slack: float = SLACK) -> dict[str, float]:
    """Return psi [%] of the kinds of blank of a source."""
    return {blank.name: gain(rule, blank, slack)[1] for blank in blanks() if blank.source == source}


def tables() -> Iterator[str]:
    """Yield the table of psi, with the mean of each source's kinds."""
    yield "Gain psi from correcting the path to the measured blank [%]."
    found = {
        source: {rule: gains(rule, source) for rule in (*IMPROVED, *NOT_NECESSARY)}
        for source in SOURCES
    }
    lines = []
    for source, by_rule in found.items():
        kinds = {kind: [each[kind] for each in by_rule.values()] for kind in by_rule["PV"]}
        kinds["mean of its kinds"] = np.mean([*kinds.values()], axis=0).tolist()
        lines += [
            [f"{source}, {kind}", *(f"{value:.1f}" for value in values)]
            for kind, values in kinds.items()
        ]
    yield from table(
        ("source of dispersion, blank", *(f"[{rule}]" for rule in found["handbook"])), lines
    )
    yield ""
    yield "Gain psi by reading of the handbooks' spatial deviations [%]; the first of each kind is in use."
    lines = []
    for kind, deviations in READINGS.items():
        for deviation in deviations:
            values = [gain_by_reading(rule, kind, deviation) for rule in found["handbook"]]
            lines.append([f"{kind}, {deviation:g} mm", *(f"{value:.1f}" for value in values)])
    yield from table(
        ("blank, spatial deviation", *(f"[{rule}]" for rule in found["handbook"])), lines
    )


def checks() -> Iterator[Check]:
    """Yield the checks of formulas and cases, and those of the claims."""
    yield from formula_checks()
    yield from case_checks()
    yield from claim_checks()


def claim_checks() -> Iterator[Check]:
    """Yield the checks of the claims for every rule that they name, with the best kind of blank and the mean of the kinds."""
    for source in SOURCES:
        for rule in (*IMPROVED, *NOT_NECESSARY):
            compare, values = (
                at_least if rule in IMPROVED else at_most,
                [*gains(rule, source).values()],
            )
            yield compare(
                f"[{rule}]: largest psi with dispersions of {source} [%]", WORTH_HAVING, max(values)
            )
            yield compare(
                f"[{rule}]: mean psi of the kinds of blank of {source} [%]",
                WORTH_HAVING,
                float(np.mean(values)),
            )
