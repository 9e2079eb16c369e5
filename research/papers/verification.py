"""The tests at fixed speed and feed with which Alaskari and Oraby (2018) compare their grid search: T1 to T9.

The figures that gave their parameters are lost. The text gives cutting speeds, and the grid search's removal rates over those of
the tests; for some also the edge's life, or the ratio of metal per edge. From these:

* The ratio of removal rates V f d gives f d. All tests have here 2.5 mm of depth (assumption; theirs lay between 1.5 and 3 mm),
  and the feed that then follows, rounded. T6 and T7, of which only the speed is known, are left out.
* Every ratio of metal per edge is the ratio of rates times 15 min over a whole number of minutes: 11 (as the text says), 7 and 5
  for T4, T8 and T9. So the paper counts 15 min for the grid search, whose edge lasts 14.
* The paper gives the tests their measured wear. The preset `measured_wear` multiplies nominal wear by the mean of their factors.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.fixed import FixedParameters
from research.papers import changed, rows
from turning_env import Scenario
from turning_env.scoring.play import play

STATED_LIFE = 15.0  # life of the grid search's edge in the paper's ratios of metal per edge [min]
COLLAPSE_TIME, COLLAPSE_FORCE = 6.25, 2690.0
"""Cutting time at which the edge of T9 collapsed [min], and the thrust force then [N]."""


@dataclass(frozen=True)
class VerificationTest:
    """One speed and feed for the edge's whole life, and the paper's statements on it."""

    name: str
    cutting_speed: float  # cutting speed [m/min], stated
    feed: float  # feed [mm/rev], from the ratio of rates, at 2.5 mm depth of cut
    rate_ratio: float  # removal rate of the grid search over that of the test, stated
    life: float | None = None
    """Cutting time until 0.3 mm of wear [min]: stated, or from the ratio of metal per edge."""
    total_ratio: float | None = None
    """Metal per edge of the grid search over that of the test, stated."""


def _read_tests() -> tuple[VerificationTest, ...]:
    """Return the tests of verification_tests.csv; an empty cell is None."""
    tests = []
    for row in rows("verification_tests.csv"):
        name = row.pop("name")
        numbers: dict[str, Any] = {
            field: float(text) if text else None for field, text in row.items()
        }
        tests.append(VerificationTest(name, **numbers))
    return tuple(tests)


TESTS = _read_tests()
"""T5 and T8 by the stated inverse of their ratio of rates, 0.58 and 0.73."""
MEASURED = tuple(test for test in TESTS if test.life is not None)  # the tests with a known life


def undisturbed(wear_factor: float = 1.0) -> Scenario:
    """Return the published simulation, extended for the tests.

    The spindle reaches the speed of T9, and episodes are long enough for T1. The edge does not break before it is worn; that of
    T4 would, just before 0.3 mm. An edge wears ``wear_factor`` times as much as in the models.
    """
    law = Scenario.load("paper").material.wear.model_dump()
    return changed(
        "paper",
        machine={"cutting_speed_max": max(test.cutting_speed for test in TESTS)},
        tool={"edge_strength": 1e6},
        control={"interval": 6.0, "time_limit": 1000.0},
        material={"wear": law | {"coefficient": law["coefficient"] * wear_factor}},
    )


@dataclass(frozen=True)
class Outcome:
    """Result of an edge at fixed speed and feed."""

    rate: float  # removal rate [cm3/min]
    life: float  # cutting time until it was worn out [min]

    @property
    def total(self) -> float:
        """Metal removed with the edge [cm3]."""
        return self.rate * self.life


def played(tests: Sequence[VerificationTest], wear_factor: float = 1.0) -> list[Outcome]:
    """Play tests to the end of their edges, with the same wear factor."""
    scenario = undisturbed(wear_factor)
    speeds = np.array([test.cutting_speed for test in tests])
    feeds = np.array([test.feed for test in tests])
    episodes = play(
        lambda num_envs: FixedParameters(scenario, speeds, feeds), scenario, range(len(tests))
    )
    minutes = episodes["engaged_time"] / 60.0
    return [
        Outcome(float(removed / life), float(life))
        for removed, life in zip(episodes["removed"], minutes, strict=True)
    ]


def wear(test: VerificationTest, minutes: float) -> float:
    """Return the wear of the nominal model after a cutting time [mm]."""
    scenario = undisturbed()
    return float(
        scenario.material.wear(
            test.cutting_speed, test.feed, scenario.workpiece.depth_of_cut, time=minutes
        )
    )


def implied_wear_factor(test: VerificationTest, life: float) -> float:
    """Return the factor on the nominal wear with which an edge lasts ``life`` minutes [-]."""
    return undisturbed().tool.wear_criterion / wear(test, life)


def until_failure(test: VerificationTest) -> tuple[float, bool]:
    """Return (cutting time [min], whether the edge collapsed) of an edge that wears as measured, to 0.32 mm.

    The edge collapses where that of the preset `practitioner` does.
    """
    life = test.life or played([test])[0].life
    scenario = undisturbed(implied_wear_factor(test, life))
    collapse = Scenario.load("practitioner").edge_failure.collapse_temperature
    scenario = changed(
        scenario, edge_failure={"collapse_temperature": collapse}, tool={"wear_criterion": 0.32}
    )
    episodes = play(
        lambda num_envs: FixedParameters(scenario, test.cutting_speed, test.feed), scenario, [0]
    )
    return float(episodes["engaged_time"][0]) / 60.0, bool(episodes["edges_broken"][0])


def with_measured_wear(interval: float) -> Scenario:
    """Return the preset `measured_wear` with a control interval [s], for tests and controllers: see ``undisturbed``."""
    speed = max(test.cutting_speed for test in TESTS)
    control = {"interval": interval, "time_limit": 1000.0}
    return changed(
        "measured_wear",
        machine={"cutting_speed_max": speed},
        tool={"edge_strength": 1e6},
        control=control,
    )


def force_and_power(test: VerificationTest, flank_wear: float) -> tuple[float, float]:
    """Return thrust force [N] and power [kW] of the nominal model at a wear [mm]."""
    scenario = undisturbed()
    laws, depth = scenario.material, scenario.workpiece.depth_of_cut
    force = laws.thrust_force(test.cutting_speed, test.feed, depth, wear=flank_wear)
    power = laws.power(test.cutting_speed, test.feed, depth, wear=flank_wear)
    return float(force), float(power)
