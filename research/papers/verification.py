"""The tests at fixed speed and feed with which Alaskari and Oraby (2018) compare their grid search.

The figures that gave the parameters of these tests, T1 to T9, are lost. The text gives cutting
speeds, and the grid search's removal rates over those of the tests. For some tests it also gives
the edge's life, or the ratio of metal per edge. From these:

* The ratio of removal rates V f d gives f d. All tests have 2.5 mm of depth here (assumption;
  theirs lay between 1.5 and 3 mm), and the feed that then follows, rounded. T6 and T7, of which
  only the speed is known, are left out.
* Every ratio of metal per edge is the ratio of rates times 15 min over a whole number of minutes:
  11 (as the text says), 7 and 5 for T4, T8 and T9. So the paper counts 15 min for the grid search,
  whose edge lasts 14.
* The paper gives the tests their measured wear. The preset `measured_wear` multiplies nominal wear
  by the mean of their factors.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from baselines.fixed import FixedParameters
from leaderboard.play import play
from research.papers import changed, rows
from turning_env import Scenario

STATED_LIFE = 15.0  # life of the grid search's edge in the paper's ratios of metal per edge [min]
COLLAPSE_TIME = 6.25  # cutting time at which the edge of T9 collapsed [min]
COLLAPSE_FORCE = 2690.0  # thrust force at that time [N]
UNBREAKABLE = 1e6  # edge strength that no force reaches [N]
TIME_LIMIT = 1000.0  # longer than the life of the slowest test, T1 [min]


@dataclass(frozen=True)
class VerificationTest:
    """One speed and feed for the edge's whole life, and the paper's statements on it."""

    name: str
    cutting_speed: float  # [m/min], stated
    feed: float  # [mm/rev], from the ratio of rates, at 2.5 mm depth of cut
    rate_ratio: float  # removal rate of the grid search over that of the test, stated
    life: float | None = None
    """Cutting time until 0.3 mm of wear [min]: stated, or from the ratio of metal per edge."""
    total_ratio: float | None = None
    """Metal per edge of the grid search over that of the test, stated."""


def _read_tests() -> tuple[VerificationTest, ...]:
    """Return the tests of verification_tests.csv; an empty cell is None."""

    def number(text: str) -> float | None:
        return float(text) if text else None

    tests = []
    for row in rows("verification_tests.csv"):
        test = VerificationTest(
            name=row["name"],
            cutting_speed=float(row["cutting_speed"]),
            feed=float(row["feed"]),
            rate_ratio=float(row["rate_ratio"]),
            life=number(row["life"]),
            total_ratio=number(row["total_ratio"]),
        )
        tests.append(test)
    return tuple(tests)


# For T5 and T8 the text states the inverse of the ratio of rates: 0.58 and 0.73.
TESTS = _read_tests()
MEASURED = tuple(test for test in TESTS if test.life is not None)  # the tests with a known life
MAX_SPEED = max(test.cutting_speed for test in TESTS)  # [m/min]


def undisturbed(wear_factor: float = 1.0) -> Scenario:
    """Return the published simulation, extended for the tests.

    The spindle reaches the speed of T9, and episodes are long enough for T1. The edge does not
    break before it is worn; that of T4 would, just before 0.3 mm.

    Args:
        wear_factor: factor on the nominal wear [-].
    """
    wear_law = Scenario.load("paper").material.wear.model_dump()
    wear_law["coefficient"] = wear_law["coefficient"] * wear_factor
    return changed(
        "paper",
        machine={"cutting_speed_max": MAX_SPEED},
        tool={"edge_strength": UNBREAKABLE},
        control={"interval": 6.0, "time_limit": TIME_LIMIT},
        material={"wear": wear_law},
    )


@dataclass(frozen=True)
class EdgeOutcome:
    """Result of an edge at fixed speed and feed."""

    rate: float  # removal rate [cm3/min]
    life: float  # cutting time until the edge was worn out [min]

    @property
    def total(self) -> float:
        """Metal removed with the edge [cm3]."""
        return self.rate * self.life


def played(tests: Sequence[VerificationTest], wear_factor: float = 1.0) -> list[EdgeOutcome]:
    """Play tests to the end of their edges, with the same wear factor."""
    scenario = undisturbed(wear_factor)
    speeds = np.array([test.cutting_speed for test in tests])
    feeds = np.array([test.feed for test in tests])

    def make_policy(num_envs: int) -> FixedParameters:
        # One environment plays each test.
        return FixedParameters(scenario, speeds, feeds)

    episodes = play(make_policy, scenario, seeds=range(len(tests)))
    lives = episodes["engaged_time"] / 60.0
    rates = episodes["removed"] / lives
    outcomes = []
    for rate, life in zip(rates, lives, strict=True):
        outcomes.append(EdgeOutcome(rate=float(rate), life=float(life)))
    return outcomes


def wear(test: VerificationTest, minutes: float) -> float:
    """Return the wear of the nominal model after a cutting time [mm]."""
    scenario = undisturbed()
    depth = scenario.workpiece.depth_of_cut
    law = scenario.material.wear
    return float(law(test.cutting_speed, test.feed, depth_of_cut=depth, time=minutes))


def implied_wear_factor(test: VerificationTest, life: float) -> float:
    """Return the factor on the nominal wear with which an edge lasts ``life`` minutes [-]."""
    return undisturbed().tool.wear_criterion / wear(test, life)


def until_failure(test: VerificationTest) -> tuple[float, bool]:
    """Return the life [min] of an edge that wears as measured, and whether it collapsed.

    It wears to 0.32 mm, that of T9 when it collapsed. It collapses at the temperature of the preset
    `practitioner`.
    """
    life = test.life or played([test])[0].life
    collapse_temperature = Scenario.load("practitioner").edge_failure.collapse_temperature
    scenario = changed(
        undisturbed(implied_wear_factor(test, life)),
        edge_failure={"collapse_temperature": collapse_temperature},
        tool={"wear_criterion": 0.32},
    )
    policy = FixedParameters(scenario, test.cutting_speed, test.feed)
    episodes = play(lambda num_envs: policy, scenario, seeds=[0])
    minutes = float(episodes["engaged_time"][0]) / 60.0
    return minutes, bool(episodes["edges_broken"][0])


def with_measured_wear(interval: float) -> Scenario:
    """Return the preset `measured_wear`, extended like ``undisturbed``.

    Args:
        interval: control interval [s].
    """
    return changed(
        "measured_wear",
        machine={"cutting_speed_max": MAX_SPEED},
        tool={"edge_strength": UNBREAKABLE},
        control={"interval": interval, "time_limit": TIME_LIMIT},
    )


def force_and_power(test: VerificationTest, flank_wear: float) -> tuple[float, float]:
    """Return thrust force [N] and power [kW] of the nominal model at a wear [mm]."""
    scenario = undisturbed()
    laws = scenario.material
    speed = test.cutting_speed
    feed = test.feed
    depth = scenario.workpiece.depth_of_cut
    force = laws.thrust_force(speed, feed, depth_of_cut=depth, wear=flank_wear)
    power = laws.power(speed, feed, depth_of_cut=depth, wear=flank_wear)
    return float(force), float(power)
