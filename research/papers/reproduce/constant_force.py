"""The roughness control paper: constant force by feed, its eight simulations (Table 1) and its statements on the control.

Each simulation plays the preset `surface` with one reference of Ra for the whole 15 s on several seeds. It is played at the
table's feed without control, and under control. The two that the text shows are also played under the same law on the feed
commanded before. Numbers are means over seeds and over time after the control has settled. "Saturated" means that the law asks
for the highest override.

The text's equation (4), the reference force of a roughness, is lost. It is a regression on the same data as (5). Fitted to the
forces of Table 1, F = c + d ln Ra gives all eight and the text's 570 N. As d times the exponent of (5) is the data's r2, below 1,
(4) is not the inverse of (5), which the project's controllers use.
"""

from collections.abc import Iterator
from functools import cache
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.constant_force import (
    ConstantForce,
    ConstantForceNetwork,
    force_of_roughness,
    recommended_feed,
)
from baselines.fixed import FixedParameters
from baselines.models.part_program import PartProgram
from baselines.models.process import Process
from research.papers import changed, record, rows
from research.papers.reproduce.checks import Check, at_least, at_most, claim
from turning_env import Scenario
from turning_env.scoring.policy import Policy
from turning_env.scoring.seeds import tuning_seeds

NUM_SEEDS = 8
SHOWN = (1, 3)  # the simulations that the text shows
SETTLED = 2.0  # time after which the control has settled [s]: half a second of air, then some servo time constants

ROUGHNESS_TOLERANCE = 0.05  # of Ra by (5) at the printed force [-] (assumption)
TOO_LOW = (1, 2, 3)  # simulations whose printed Ra lies farther below (5) at the printed force
FORCE_TOLERANCE, FEED_TOLERANCE = 0.08, 0.015
"""Tolerances of force [-] and feed [mm/rev]: force over feed is 3080 to 2680 N per mm/rev in the table, and 2850 here."""


class Simulation(NamedTuple):
    """A simulation of Table 1; its Ra are in um, though it says mm."""

    number: int
    reference: float  # desired Ra [um]
    uncontrolled_force: float  # force without control [N]
    uncontrolled_feed: float  # feed without control [mm/rev]
    force: float  # force under control [N]
    feed: float  # feed under control [mm/rev]
    roughness: float  # ra reached under control [um]


SIMULATIONS = [
    Simulation(int(number), *map(float, values))
    for number, *values in map(dict.values, rows("surface_table1.csv"))
]
"""Table 1 as printed."""


class Outcome(NamedTuple):
    """Settled means of a simulation; arrays over seeds."""

    force: float  # mean force [N]
    feed: float  # mean feed [mm/rev]
    roughness: NDArray[np.float64]  # mean Ra [um]
    spread: float  # standard deviation of Ra over time, over its mean [-]
    deviation: float  # mean relative deviation of Ra from the reference [-]
    saturated: NDArray[np.float64]  # share of time at the highest override [-]
    entry_deviation: float  # mean relative deviation of Ra before it has settled [-]


def held_at(reference: float, **sections: dict[str, Any]) -> Scenario:
    """Return the preset `surface` with one reference of Ra [um], and other values replaced."""
    return changed(
        "surface", surface={"reference_min": reference, "reference_max": reference}, **sections
    )


def play(policy: Policy, scenario: Scenario) -> Outcome:
    """Play one episode of every seed."""
    kept = record(policy, scenario, tuning_seeds(NUM_SEEDS))
    settled = round(SETTLED / scenario.control.interval)
    off = np.abs(kept["roughness"] / kept["roughness_reference"] - 1.0)
    entry = off[:settled][kept["cutting"][:settled]]
    kept = {name: values[settled:] for name, values in kept.items()}
    roughness = kept["roughness"]
    return Outcome(
        float(kept["thrust_force"].mean()),
        float(kept["feed"].mean()),
        roughness.mean(axis=0),
        float((roughness.std(axis=0) / roughness.mean(axis=0)).mean()),
        float(off[settled:].mean()),
        (kept["commanded_feed"] > 0.9999 * scenario.machine.feed_max).mean(axis=0),
        float(entry.mean()),
    )


@cache
def outcomes() -> tuple[tuple[Simulation, Outcome, Outcome, Outcome | None], ...]:
    """Return every simulation: without control, under control, and, if shown, under the law on the feed commanded before."""
    results = []
    for row in SIMULATIONS:
        scenario = held_at(row.reference)
        uncontrolled = FixedParameters(
            scenario, scenario.control.initial_cutting_speed, row.uncontrolled_feed
        )
        program = PartProgram(scenario, {})
        on_command = (
            play(ConstantForce(program, NUM_SEEDS, on_command=True), scenario)
            if row.number in SHOWN
            else None
        )
        results.append(
            (
                row,
                play(uncontrolled, scenario),
                play(ConstantForce(program, NUM_SEEDS), scenario),
                on_command,
            )
        )
    return tuple(results)


def simulation_checks() -> Iterator[Check]:
    """Yield the checks of the table."""
    for row, uncontrolled, controlled, on_command in outcomes():
        name, reference = f"simulation {row.number}, Ra {row.reference} um: ", row.reference
        worst = np.abs(controlled.roughness[controlled.saturated < 0.05] / reference - 1.0).max()
        yield Check(
            f"{name}Ra reached [um]",
            reference,
            float(controlled.roughness.mean()),
            0.05 * reference,
        )
        yield at_most(f"{name}deviation of mean Ra, worst unsaturated seed", 0.05, float(worst))
        yield Check(f"{name}force [N]", row.force, controlled.force, FORCE_TOLERANCE * row.force)
        yield Check(f"{name}feed [mm/rev]", row.feed, controlled.feed, FEED_TOLERANCE)
        yield claim(
            f"{name}control brings Ra nearer the reference",
            controlled.deviation < 0.5 * uncontrolled.deviation,
        )
        if on_command is not None:
            yield at_least(
                f"{name}on the command before, Ra swings: times as far",
                3.0,
                on_command.spread / controlled.spread,
            )
        by_equation = 0.2401 * float(np.exp(0.0034 * row.force))
        reason = "the printed Ra of simulations 1 to 3 lie 14, 10 and 8.5 % below (5) at the printed force"
        yield Check(
            f"{name}Ra by (5) at the printed force [um]",
            row.roughness,
            by_equation,
            ROUGHNESS_TOLERANCE * by_equation,
            not_reproduced=reason if row.number in TOO_LOW else "",
        )


def reference_force() -> tuple[float, float]:
    """Return c and d [N] of (4), F = c + d ln Ra, fitted to the forces under control and the references of Table 1."""
    references, forces = np.array([(row.reference, row.force) for row in SIMULATIONS]).T
    d, c = np.polyfit(np.log(references), forces, 1)
    return float(c), float(d)


def reference_checks() -> Iterator[Check]:
    """Yield the checks of block B1: equation (4) as a regression of its own."""
    c, d = reference_force()
    yield Check(
        "(4) fitted to Table 1: force for Ra 1.6 um [N]; the text: about 570",
        570.0,
        c + d * np.log(1.6),
        5.0,
    )
    off = max(abs((c + d * np.log(row.reference)) / row.force - 1.0) for row in SIMULATIONS)
    yield at_most("(4) fitted to Table 1: largest deviation of the table's forces", 0.03, off)
    yield claim(
        "(4) and (5) regressions of one set of data: r2 is high, and below 1",
        0.8 < d * 0.0034 < 1.0,
    )


def network_checks() -> Iterator[Check]:
    """Yield the checks of the cutting conditions that a network recommends."""
    scenario = Scenario.load("surface")
    references = np.array([row.reference for row in SIMULATIONS])
    # The table's cuts without control have the recommended feeds. Their forces give the specific cutting force [N/mm2] at 1 mm.
    specific = float(
        np.mean([row.uncontrolled_force / row.uncontrolled_feed for row in SIMULATIONS])
    )
    law = scenario.material.thrust_force.model_dump() | {"coefficient": specific}
    feeds = recommended_feed(changed("surface", material={"thrust_force": law}))(references)
    for row, feed in zip(SIMULATIONS, feeds.tolist(), strict=True):
        yield Check(
            f"recommended feed: for Ra {row.reference} um [mm/rev]",
            row.uncontrolled_feed,
            feed,
            FEED_TOLERANCE,
        )
    entries = []
    for reference in (references.min(), references.max()):
        held = held_at(float(reference))
        program = PartProgram(held, {})
        recommended = play(ConstantForceNetwork(program, NUM_SEEDS), held).entry_deviation
        entries.append((recommended, play(ConstantForce(program, NUM_SEEDS), held).entry_deviation))
    nearer = all(recommended < programmed for recommended, programmed in entries)
    yield claim("recommended feed: Ra at entry is nearer than with the programmed feed", nearer)


def output_checks() -> Iterator[Check]:
    """Yield the check of the text's statement on tool life, at the feeds that Table 1 prints."""
    scenario = Scenario.load("surface")
    feeds = np.log([(row.uncontrolled_feed, row.feed) for row in SIMULATIONS])
    speed = np.log(np.full(feeds.shape, scenario.control.initial_cutting_speed))
    without, with_control = (
        Process.of(scenario).log_life(speed, feeds, scenario.workpiece.depth_of_cut, 1.0).T
    )
    yield claim(
        "output block: at the table's feeds, control shortens no tool life", with_control >= without
    )


def text_checks() -> Iterator[Check]:
    """Yield the checks of the text."""
    scenario = Scenario.load("surface")
    force = float(force_of_roughness(scenario.surface, np.array([1.6]))[0])
    yield Check(
        "force for Ra 1.6 um by the inverse of (5) [N]; the text: about 570", 570.0, force, 15.0
    )
    undisturbed = held_at(
        1.6,
        workpiece={
            "depth_bar_spread": 0.0,
            "hardness_bar_spread": 0.0,
            "hardness_along_spread": 0.0,
        },
        sensors={"force_noise": 0.0},
    )
    ideal = play(ConstantForce(PartProgram(undisturbed, {}), NUM_SEEDS), undisturbed)
    yield at_most("without noise, deviation of Ra (ideal)", 0.001, ideal.deviation)
    kept = record(
        ConstantForce(PartProgram(scenario, {}), NUM_SEEDS), scenario, tuning_seeds(NUM_SEEDS)
    )
    reference, feed = kept["roughness_reference"], kept["commanded_feed"]
    # The info of a step holds the reference for the next one: falls of a fifth or more, and the feed in the step after.
    falls = (reference[2:-1] < 0.8 * reference[1:-2]) & (
        kept["feed"][2:-1] > scenario.machine.feed_min
    )
    reduced = (feed[2:-1] - feed[3:])[falls] > 0.0
    yield claim("when the reference falls, the feed is reduced at once", reduced)
    in_air = float(kept["commanded_feed"][0, 0])
    yield claim(
        "without force, the programmed feed is commanded",
        round(in_air, 6) == scenario.control.initial_feed,
    )


def tables() -> Iterator[str]:
    """Yield equation (4)."""
    c, d = reference_force()
    yield f"(4) fitted to Table 1: F = {c:.0f} N + {d:.0f} N ln(Ra / um), r2 of the data {d * 0.0034:.2f}"


def checks() -> Iterator[Check]:
    """Yield all checks of the paper."""
    groups = (simulation_checks, reference_checks, network_checks, output_checks, text_checks)
    return chain.from_iterable(group() for group in groups)
