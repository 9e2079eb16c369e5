"""The roughness control paper: constant force by feed, its eight simulations (Table 1) and what its text says of the control.

Each simulation plays the preset `surface` with one reference of Ra for the whole 15 s on several seeds: at the table's feed
without control, under control, and, for the two that the text shows, under the same law on the feed commanded before. Numbers are
means over seeds and over time after the control has settled. "Saturated" means that the law asks for the highest override.
"""

import csv
from collections.abc import Iterator
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.constant_force import ConstantForce, force_of_roughness
from baselines.fixed import FixedParameters
from baselines.models.part_program import PartProgram
from papers import changed
from papers.reproduce.checks import Check, at_least, at_most, claim, table
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.scoring.policy import Policy
from turning_env.scoring.seeds import tuning_seeds

TABLE = Path(__file__).parents[1] / "data" / "surface_table1.csv"
NUM_SEEDS = 8
SHOWN = (1, 3)
"""The simulations that the text shows."""
SETTLED = 2.0
"""Time after which the control has settled [s]: half a second of air, then some servo time constants."""

FORCE_TOLERANCE, FEED_TOLERANCE = 0.08, 0.015
"""Relative, and in mm/rev: force over feed falls from 3080 to 2680 N per mm/rev in the table, and is 2850 here."""


class Simulation(NamedTuple):
    """A simulation of Table 1."""

    number: int
    reference: float
    """Desired Ra [um]."""
    uncontrolled_force: float
    """[N]"""
    uncontrolled_feed: float
    """[mm/rev]"""
    force: float
    """Under control [N]."""
    feed: float
    """Under control [mm/rev]."""
    roughness: float
    """Ra reached under control [um]."""


def rows() -> list[Simulation]:
    """Return Table 1 as printed (its Ra are in um, though it says mm)."""
    with TABLE.open(newline="") as file:
        return [Simulation(int(number), *map(float, values)) for number, *values in list(csv.reader(file))[1:]]


class Outcome(NamedTuple):
    """Settled means of a simulation; arrays over seeds."""

    force: float
    """[N]"""
    feed: float
    """[mm/rev]"""
    roughness: NDArray[np.float64]
    """Mean Ra [um]."""
    spread: float
    """Standard deviation of Ra over time, over its mean [-]."""
    deviation: float
    """Mean relative deviation of Ra from the reference [-]."""
    saturated: NDArray[np.float64]
    """Share of time [-]."""


def held_at(reference: float, **sections: dict[str, Any]) -> Scenario:
    """Return the preset `surface` with one reference of Ra [um], and other values replaced."""
    return changed("surface", surface={"reference_min": reference, "reference_max": reference}, **sections)


def record(policy: Policy, scenario: Scenario, num_envs: int) -> dict[str, NDArray[np.float64]]:
    """Return ``info`` over one episode of each of the first tuning seeds, shape (steps, num_envs)."""
    env = RoughTurningVectorEnv(num_envs, scenario)
    observations, _ = env.reset(seed=tuning_seeds(num_envs))
    policy.reset(np.ones(num_envs, np.bool_))
    kept = []
    for _ in range(round(60.0 * scenario.control.time_limit / scenario.control.interval)):
        observations, _, _, _, infos = env.step(policy.act(observations))
        kept.append(infos)
    names = ("roughness", "thrust_force", "feed", "commanded_feed", "roughness_reference")
    return {name: np.array([infos[name] for infos in kept]) for name in names}


def play(policy: Policy, scenario: Scenario) -> Outcome:
    """Play one episode of every seed."""
    settled = round(SETTLED / scenario.control.interval)
    kept = {name: values[settled:] for name, values in record(policy, scenario, NUM_SEEDS).items()}
    roughness = kept["roughness"]
    return Outcome(
        float(kept["thrust_force"].mean()),
        float(kept["feed"].mean()),
        roughness.mean(axis=0),
        float((roughness.std(axis=0) / roughness.mean(axis=0)).mean()),
        float(np.abs(roughness / kept["roughness_reference"] - 1.0).mean()),
        (kept["commanded_feed"] > 0.9999 * scenario.machine.feed_max).mean(axis=0),
    )


@cache
def outcomes() -> tuple[tuple[Simulation, Outcome, Outcome, Outcome | None], ...]:
    """Return every simulation: without control, under control, and, if shown, under the law on the feed commanded before."""
    results = []
    for row in rows():
        scenario = held_at(row.reference)
        uncontrolled = FixedParameters(scenario, scenario.control.initial_cutting_speed, row.uncontrolled_feed)
        program = PartProgram(scenario, {})
        on_command = play(ConstantForce(program, NUM_SEEDS, on_command=True), scenario) if row.number in SHOWN else None
        results.append((row, play(uncontrolled, scenario), play(ConstantForce(program, NUM_SEEDS), scenario), on_command))
    return tuple(results)


def simulation_checks() -> Iterator[Check]:
    """Yield the checks of the table."""
    for row, uncontrolled, controlled, on_command in outcomes():
        name, reference = f"simulation {row.number}, Ra {row.reference} um: ", row.reference
        worst = np.abs(controlled.roughness[controlled.saturated < 0.05] / reference - 1.0).max()
        yield Check(f"{name}Ra reached [um]", reference, float(controlled.roughness.mean()), 0.05 * reference)
        yield at_most(f"{name}deviation of mean Ra, worst unsaturated seed", 0.05, float(worst))
        yield Check(f"{name}force [N]", row.force, controlled.force, FORCE_TOLERANCE * row.force)
        yield Check(f"{name}feed [mm/rev]", row.feed, controlled.feed, FEED_TOLERANCE)
        yield claim(f"{name}control brings Ra nearer the reference", controlled.deviation < 0.5 * uncontrolled.deviation)
        if on_command is not None:
            yield at_least(f"{name}on the command before, Ra swings: times as far", 3.0, on_command.spread / controlled.spread)
        printed = 0.2401 * float(np.exp(0.0034 * row.force))
        off = abs(printed / row.roughness - 1.0) > 0.05
        reason = "the table's force and Ra do not satisfy the paper's equation (5)" if off else ""
        what = f"{name}Ra of the printed force by (5) [um]"
        yield Check(what, row.roughness, printed, 0.05 * row.roughness, not_reproduced=reason)


def text_checks() -> Iterator[Check]:
    """Yield the checks of the text."""
    scenario = Scenario.load("surface")
    force = float(force_of_roughness(scenario.surface, np.array([1.6]))[0])
    yield Check("force for Ra 1.6 um by the inverse of (5) [N]; the text: about 570", 570.0, force, 15.0)
    undisturbed = held_at(
        1.6,
        workpiece={"depth_bar_spread": 0.0, "hardness_bar_spread": 0.0, "hardness_along_spread": 0.0},
        sensors={"force_noise": 0.0},
    )
    ideal = play(ConstantForce(PartProgram(undisturbed, {}), NUM_SEEDS), undisturbed)
    yield at_most("without noise, deviation of Ra (ideal)", 0.001, ideal.deviation)
    kept = record(ConstantForce(PartProgram(scenario, {}), NUM_SEEDS), scenario, NUM_SEEDS)
    reference, feed = kept["roughness_reference"], kept["commanded_feed"]
    # The info of a step holds the reference for the next one: falls of a fifth or more, and the feed in the step after.
    falls = (reference[2:-1] < 0.8 * reference[1:-2]) & (kept["feed"][2:-1] > scenario.machine.feed_min)
    reduced = bool(np.all((feed[2:-1] - feed[3:])[falls] > 0.0))
    yield claim("when the reference falls, the feed is reduced at once", reduced)
    in_air = float(kept["commanded_feed"][0, 0])
    yield claim("without force, the programmed feed is commanded", round(in_air, 6) == scenario.control.initial_feed)


def tables() -> Iterator[str]:
    """Yield the table of the eight simulations and the paper's."""
    yield f"Means over {NUM_SEEDS} seeds, after {SETTLED:.0f} s; in brackets the paper's. Spread: of Ra over time, over its mean."
    heads = ["", "Ra um", "free: N", "mm/rev", "Ra", "spread", "held: N", "mm/rev", "Ra", "spread", "saturated"]
    lines = []
    for row, free, held, on_command in outcomes():
        line = [f"{row.number}", f"{row.reference:.1f}", f"{free.force:.0f} ({row.uncontrolled_force:.0f})", f"{free.feed:.3f}"]
        line += [f"{free.roughness.mean():.2f}", f"{free.spread:.1%}", f"{held.force:.0f} ({row.force:.0f})"]
        line += [f"{held.feed:.3f} ({row.feed:.2f})", f"{held.roughness.mean():.2f} ({row.roughness:.2f})", f"{held.spread:.1%}"]
        lines.append([*line, f"{held.saturated.mean():.1%}", f"{on_command.spread:.1%}" if on_command else "-"])
    yield from table([*heads, "on command: spread"], lines)


def checks() -> Iterator[Check]:
    """Yield all checks of the paper."""
    return chain(simulation_checks(), text_checks())
