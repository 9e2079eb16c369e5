"""The roughness control paper: constant force by feed, its eight simulations, and its statements.

Each simulation (Table 1) plays the preset `surface` with one reference of Ra for the whole 15 s on
several seeds. It is played at the table's feed without control, and under control. The two that the
text shows are also played under the same law on the feed commanded before. Numbers are means over
seeds and over time after the control has settled. "Saturated" means that the law asks for the
highest override.

The text's equation (4), the reference force of a roughness, is lost. It is a regression on the same
data as (5). Fitted to the forces of Table 1, F = c + d ln Ra gives all eight and the text's 570 N.
As d times the exponent of (5) is the data's r2, below 1, (4) is not the inverse of (5), which the
project's controllers use.
"""

from collections.abc import Iterator
from functools import cache
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
from leaderboard.seeds import tuning_seeds
from research.papers import changed, record, rows
from research.papers.reproduce.checks import Check, at_least, at_most, claim
from turning_env import Scenario
from turning_env.policy import Policy

NUM_SEEDS = 8
SHOWN = (1, 3)  # the simulations that the text shows
SURFACE = (
    "roughness",
    "roughness_reference",
    "cutting",
    "commanded_feed",
    "thrust_force",
    "feed",
)
"""Quantities of which an outcome is made."""
# Time after which the control has settled [s]: half a second of air, then some time constants of
# the servo.
SETTLED = 2.0

# Equation (5): Ra = 0.2401 exp(0.0034 F) [um, N].
ROUGHNESS_COEFFICIENT = 0.2401  # [um]
ROUGHNESS_EXPONENT = 0.0034  # [1/N]

ROUGHNESS_TOLERANCE = 0.05  # of Ra by (5) at the printed force [-] (assumption)
TOO_LOW = (1, 2, 3)  # simulations whose printed Ra lies farther below (5) at the printed force
# Force over feed is 3080 to 2680 N per mm/rev in the table, and 2850 here.
FORCE_TOLERANCE = 0.08  # [-]
FEED_TOLERANCE = 0.015  # [mm/rev]


class Simulation(NamedTuple):
    """A simulation of Table 1; its Ra are in um, though it says mm."""

    number: int
    reference: float  # desired Ra [um]
    uncontrolled_force: float  # force without control [N]
    uncontrolled_feed: float  # feed without control [mm/rev]
    force: float  # force under control [N]
    feed: float  # feed under control [mm/rev]
    roughness: float  # ra reached under control [um]


def _read_simulations() -> list[Simulation]:
    """Return Table 1 as printed."""
    simulations = []
    for row in rows("surface_table1.csv"):
        simulation = Simulation(
            number=int(row["sim_no"]),
            reference=float(row["ra_ref_um"]),
            uncontrolled_force=float(row["force_uncontrolled_n"]),
            uncontrolled_feed=float(row["feed_uncontrolled_mm_rev"]),
            force=float(row["force_controlled_n"]),
            feed=float(row["feed_controlled_mm_rev"]),
            roughness=float(row["ra_actual_um"]),
        )
        simulations.append(simulation)
    return simulations


SIMULATIONS = _read_simulations()


class Outcome(NamedTuple):
    """Settled means of a simulation; arrays over seeds."""

    force: float  # mean force [N]
    feed: float  # mean feed [mm/rev]
    roughness: NDArray[np.float64]  # mean Ra [um]
    spread: float  # standard deviation of Ra over time, over its mean [-]
    deviation: float  # mean relative deviation of Ra from the reference [-]
    saturated: NDArray[np.float64]  # share of time at the highest override [-]
    entry_deviation: float  # mean relative deviation of Ra before it has settled [-]


class Outcomes(NamedTuple):
    """The outcomes of a simulation."""

    simulation: Simulation
    uncontrolled: Outcome
    controlled: Outcome
    on_command: Outcome | None  # under the law on the feed commanded before, if the text shows it


def held_at(reference: float, **sections: dict[str, Any]) -> Scenario:
    """Return the preset `surface` with one reference of Ra [um], and other values replaced."""
    surface = {"reference_min": reference, "reference_max": reference}
    return changed("surface", surface=surface, **sections)


def play(policy: Policy, scenario: Scenario) -> Outcome:
    """Play one episode of every seed."""
    recorded = record(policy, scenario, tuning_seeds(NUM_SEEDS), names=SURFACE)
    settled = round(SETTLED / scenario.control.interval)
    ratio = recorded["roughness"] / recorded["roughness_reference"]
    deviation = np.abs(ratio - 1.0)
    in_metal_at_entry = recorded["cutting"][:settled]
    entry_deviation = deviation[:settled][in_metal_at_entry]

    force = recorded["thrust_force"][settled:]
    feed = recorded["feed"][settled:]
    roughness = recorded["roughness"][settled:]
    mean_roughness = roughness.mean(axis=0)
    spread = roughness.std(axis=0) / mean_roughness
    commanded_feed = recorded["commanded_feed"][settled:]
    saturated = commanded_feed > 0.9999 * scenario.machine.feed_max
    return Outcome(
        force=float(force.mean()),
        feed=float(feed.mean()),
        roughness=mean_roughness,
        spread=float(spread.mean()),
        deviation=float(deviation[settled:].mean()),
        saturated=saturated.mean(axis=0),
        entry_deviation=float(entry_deviation.mean()),
    )


@cache
def outcomes() -> tuple[Outcomes, ...]:
    """Return the outcomes of every simulation."""
    results = []
    for simulation in SIMULATIONS:
        scenario = held_at(simulation.reference)
        program = PartProgram(scenario, {})
        programmed = FixedParameters(
            scenario, scenario.control.initial_cutting_speed, feed=simulation.uncontrolled_feed
        )
        on_command = None
        if simulation.number in SHOWN:
            on_command = play(ConstantForce(program, NUM_SEEDS, on_command=True), scenario)
        results.append(
            Outcomes(
                simulation=simulation,
                uncontrolled=play(programmed, scenario),
                controlled=play(ConstantForce(program, NUM_SEEDS), scenario),
                on_command=on_command,
            )
        )
    return tuple(results)


def simulation_checks() -> Iterator[Check]:
    """Yield the checks of the table."""
    for results in outcomes():
        simulation = results.simulation
        controlled = results.controlled
        reference = simulation.reference
        name = f"simulation {simulation.number}, Ra {reference} um: "
        unsaturated = controlled.roughness[controlled.saturated < 0.05]
        worst = np.abs(unsaturated / reference - 1.0).max()
        yield Check(
            f"{name}Ra reached [um]",
            reference,
            ours=float(controlled.roughness.mean()),
            tolerance=0.05 * reference,
        )
        yield at_most(
            f"{name}deviation of mean Ra, worst unsaturated seed", 0.05, ours=float(worst)
        )
        yield Check(
            f"{name}force [N]",
            simulation.force,
            ours=controlled.force,
            tolerance=FORCE_TOLERANCE * simulation.force,
        )
        yield Check(
            f"{name}feed [mm/rev]",
            simulation.feed,
            ours=controlled.feed,
            tolerance=FEED_TOLERANCE,
        )
        yield claim(
            f"{name}control brings Ra nearer the reference",
            controlled.deviation < 0.5 * results.uncontrolled.deviation,
        )
        if results.on_command is not None:
            yield at_least(
                f"{name}on the command before, Ra swings: times as far",
                3.0,
                ours=results.on_command.spread / controlled.spread,
            )
        yield roughness_check(simulation, name)


def roughness_check(simulation: Simulation, name: str) -> Check:
    """Return the check of a printed Ra by equation (5) at the printed force."""
    exponential = float(np.exp(ROUGHNESS_EXPONENT * simulation.force))
    by_equation = ROUGHNESS_COEFFICIENT * exponential
    reason = ""
    if simulation.number in TOO_LOW:
        reason = (
            "the printed Ra of simulations 1 to 3 lie 14, 10 and 8.5 % below (5) "
            "at the printed force"
        )
    return Check(
        f"{name}Ra by (5) at the printed force [um]",
        simulation.roughness,
        ours=by_equation,
        tolerance=ROUGHNESS_TOLERANCE * by_equation,
        not_reproduced=reason,
    )


class ReferenceForce(NamedTuple):
    """Equation (4): F = c + d ln Ra [N, um]."""

    c: float  # [N]
    d: float  # [N]

    def __call__(self, roughness: float) -> float:
        """Return the reference force [N] of a roughness [um]."""
        return float(self.c + self.d * np.log(roughness))

    @property
    def r_squared(self) -> float:
        """Share of variance that a line explains if (4) and (5) are regressions of one data set."""
        # The product of the slopes of the regressions of y on x and of x on y is r2.
        return self.d * ROUGHNESS_EXPONENT


def reference_force() -> ReferenceForce:
    """Return (4), fitted to the forces under control and the references of Table 1."""
    references = np.array([simulation.reference for simulation in SIMULATIONS])
    forces = np.array([simulation.force for simulation in SIMULATIONS])
    d, c = np.polyfit(np.log(references), forces, deg=1)
    return ReferenceForce(c=float(c), d=float(d))


def reference_checks() -> Iterator[Check]:
    """Yield the checks of block B1: equation (4) as a regression of its own."""
    fitted = reference_force()
    yield Check(
        "(4) fitted to Table 1: force for Ra 1.6 um [N]; the text: about 570",
        570.0,
        ours=fitted(1.6),
        tolerance=5.0,
    )
    deviations = [
        abs(fitted(simulation.reference) / simulation.force - 1.0) for simulation in SIMULATIONS
    ]
    yield at_most(
        "(4) fitted to Table 1: largest deviation of the table's forces", 0.03, ours=max(deviations)
    )
    yield claim(
        "(4) and (5) regressions of one set of data: r2 is high, and below 1",
        0.8 < fitted.r_squared < 1.0,
    )


def network_checks() -> Iterator[Check]:
    """Yield the checks of the cutting conditions that a network recommends."""
    scenario = Scenario.load("surface")
    references = np.array([simulation.reference for simulation in SIMULATIONS])

    # The table's cuts without control have the recommended feeds. Their forces give the specific
    # cutting force at 1 mm of depth [N/mm2].
    specific_forces = [
        simulation.uncontrolled_force / simulation.uncontrolled_feed for simulation in SIMULATIONS
    ]
    law = scenario.material.thrust_force.model_dump()
    law["coefficient"] = float(np.mean(specific_forces))
    recommend = recommended_feed(changed("surface", material={"thrust_force": law}))
    for simulation, feed in zip(SIMULATIONS, recommend(references).tolist(), strict=True):
        yield Check(
            f"recommended feed: for Ra {simulation.reference} um [mm/rev]",
            simulation.uncontrolled_feed,
            ours=feed,
            tolerance=FEED_TOLERANCE,
        )

    nearer = []
    for reference in (references.min(), references.max()):
        held = held_at(float(reference))
        program = PartProgram(held, {})
        recommended = play(ConstantForceNetwork(program, NUM_SEEDS), held)
        programmed = play(ConstantForce(program, NUM_SEEDS), held)
        nearer.append(recommended.entry_deviation < programmed.entry_deviation)
    yield claim("recommended feed: Ra at entry is nearer than with the programmed feed", nearer)


def output_checks() -> Iterator[Check]:
    """Yield the check of the text's statement on tool life, at the feeds that Table 1 prints."""
    scenario = Scenario.load("surface")
    process = Process.of(scenario)
    log_speed = np.log(scenario.control.initial_cutting_speed)

    def log_lives(feeds: list[float]) -> NDArray[np.float64]:
        return process.log_life(
            np.full(len(feeds), log_speed),
            np.log(feeds),
            depth_of_cut=scenario.workpiece.depth_of_cut,
            hardness=1.0,
        )

    without = log_lives([simulation.uncontrolled_feed for simulation in SIMULATIONS])
    with_control = log_lives([simulation.feed for simulation in SIMULATIONS])
    yield claim(
        "output block: at the table's feeds, control shortens no tool life", with_control >= without
    )


def text_checks() -> Iterator[Check]:
    """Yield the checks of the text."""
    scenario = Scenario.load("surface")
    force = float(force_of_roughness(scenario.surface, np.array([1.6]))[0])
    yield Check(
        "force for Ra 1.6 um by the inverse of (5) [N]; the text: about 570",
        570.0,
        ours=force,
        tolerance=15.0,
    )

    uniform = {
        "depth_bar_spread": 0.0,
        "hardness_bar_spread": 0.0,
        "hardness_along_spread": 0.0,
    }
    undisturbed = held_at(1.6, workpiece=uniform, sensors={"force_noise": 0.0})
    ideal = play(ConstantForce(PartProgram(undisturbed, {}), NUM_SEEDS), undisturbed)
    yield at_most("without noise, deviation of Ra (ideal)", 0.001, ours=ideal.deviation)

    policy = ConstantForce(PartProgram(scenario, {}), NUM_SEEDS)
    recorded = record(policy, scenario, tuning_seeds(NUM_SEEDS))
    reference = recorded["roughness_reference"]
    feed = recorded["commanded_feed"]
    # The info of a step holds the reference for the next one. So a fall of a fifth or more is seen
    # in the feed of the step after. At the lowest feed, none can follow.
    falls = reference[2:-1] < 0.8 * reference[1:-2]
    above_lowest = recorded["feed"][2:-1] > scenario.machine.feed_min
    reductions = feed[2:-1] - feed[3:]
    yield claim(
        "when the reference falls, the feed is reduced at once",
        reductions[falls & above_lowest] > 0.0,
    )
    in_air = float(feed[0, 0])
    yield claim(
        "without force, the programmed feed is commanded",
        round(in_air, 6) == scenario.control.initial_feed,
    )


def tables() -> Iterator[str]:
    """Yield equation (4)."""
    fitted = reference_force()
    yield (
        f"(4) fitted to Table 1: F = {fitted.c:.0f} N + {fitted.d:.0f} N ln(Ra / um), "
        f"r2 of the data {fitted.r_squared:.2f}"
    )


def checks() -> Iterator[Check]:
    """Yield all checks of the paper."""
    yield from simulation_checks()
    yield from reference_checks()
    yield from network_checks()
    yield from output_checks()
    yield from text_checks()
