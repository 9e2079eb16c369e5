"""Alaskari and Oraby (2018): the grid search, its tables, its whole run, and the tests that it was compared with.

Table 1 (first interval of one minute) and Table 2 (second interval): the feed that the grid search chooses for each of 16 cutting
speeds, and wear, force, power and removal rate there. Then the whole run, played by the grid search on RoughTurning-Paper-v0, and
compared with the tests at fixed speed and feed.
"""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from baselines.grid_search import GridSearch, best_pair, grid, highest_feed, predict
from papers import verification
from papers.reproduce.checks import Check, at_most, table
from papers.verification import COLLAPSE_FORCE, COLLAPSE_TIME, STATED_LIFE, TESTS
from turning_env import RoughTurningEnv, Scenario
from turning_env.physics.records import parameter_records

PAPER = Path(__file__).parents[1] / "data"
FIRST_WEAR = 0.157219
"""Wear after the paper's first interval, from which its Table 2 starts [mm]."""

MISPRINTS = {("50", "wear_increase_mm"): "0.01250"}
"""Table 2 prints 0.01255 here, but the row's 0.08003 - 0.06753 and its total wear give 0.01250."""

ROUNDED = 0.015
"""Relative tolerance for the tests: their feeds are rounded, and so are the paper's ratios."""


def rows(table: str) -> list[dict[str, str]]:
    """Return a table of the paper as printed."""
    with (PAPER / table).open(newline="") as file:
        return list(csv.DictReader(file))


def last_digit(printed: str) -> float:
    """Return one unit in the last printed digit: Table 2 cuts some numbers off (0.164745 to 0.16474) and adds rounded ones."""
    return 10.0 ** -len(printed.partition(".")[2])


class PaperRun:
    """The paper's grid and limits on its nominal models."""

    def __init__(self) -> None:
        self.scenario = Scenario.load("paper")
        self.parameters = parameter_records(self.scenario)[0]
        self.speeds, self.feeds = grid(self.scenario)
        self.limits = (self.scenario.limits.thrust_force, self.scenario.limits.power, 1.0)

    def used_life(self, wear: float) -> float:
        """Return the used share of the life [-] at a wear [mm]."""
        return float((wear / self.scenario.tool.wear_criterion) ** (1.0 / self.scenario.material.wear.time))

    def wear(self, used_life: float) -> float:
        """Return the wear [mm] at a used share of the life [-]."""
        return float(self.scenario.tool.wear_criterion * used_life**self.scenario.material.wear.time)

    def row(self, speed: float, wear: float, start: float) -> tuple[float, float, float, float]:
        """Return (feed [mm/rev], wear [mm], power [kW], force [N]) of the best feed at a speed after one more minute."""
        life = self.used_life(wear)
        index = highest_feed(self.parameters, speed, self.feeds, life, start, start + 1.0, *self.limits)
        feed = self.feeds[index]
        used, force, power = predict(self.parameters, speed, feed, life, start, start + 1.0)
        return float(feed), self.wear(used), float(power), float(force)

    def chosen(self, wear: float, start: float) -> tuple[float, float] | None:
        """Return (cutting speed [m/min], feed [mm/rev]) for the next minute, or None where none is feasible."""
        life = self.used_life(wear)
        speed, feed = best_pair(self.parameters, self.speeds, self.feeds, life, start, start + 1.0, *self.limits)
        return None if speed < 0 else (float(self.speeds[speed]), float(self.feeds[feed]))


def table_1(run: PaperRun) -> Iterator[Check]:
    """Yield the checks of the first interval: chosen feeds exactly, responses to 1e-5 of their value."""
    for row in rows("table1.csv"):
        speed = float(row["speed_m_min"])
        feed, wear, power, force = run.row(speed, 0.0, 0.0)
        for name, ours, tolerance in (
            ("feed_mm_rev", feed, 1e-9),
            ("wear_mm", wear, 1e-5 * wear),
            ("power_kw", power, 1e-5 * power),
            ("thrust_force_n", force, 1e-5 * force),
            ("mrr_mm3_min", 1000 * speed * feed * run.scenario.workpiece.depth_of_cut, 1e-6),
        ):
            yield Check(f"Table 1, {speed:.0f} m/min, {name}", float(row[name]), ours, tolerance)


def table_2(run: PaperRun) -> Iterator[Check]:
    """Yield the checks of the second interval: chosen feeds exactly, responses to the last printed digit."""
    depth = run.scenario.workpiece.depth_of_cut
    law = run.scenario.material.wear
    for row in rows("table2.csv"):
        speed = float(row["speed_m_min"])
        feed, wear, power, force = run.row(speed, FIRST_WEAR, 1.0)
        for name, ours in (
            ("feed_mm_rev", feed),
            ("wear_at_t_mm", float(law(speed, feed, depth, time=2.0))),
            ("wear_at_t_minus_1_mm", float(law(speed, feed, depth, time=1.0))),
            ("wear_increase_mm", wear - FIRST_WEAR),
            ("total_wear_mm", wear),
            ("power_kw", power),
            ("thrust_force_n", force),
            ("mrr_mm3_min", 1000 * speed * feed * depth),
        ):
            printed = MISPRINTS.get((row["speed_m_min"], name), row[name])
            tolerance = 1e-9 if name == "feed_mm_rev" else last_digit(printed)
            yield Check(f"Table 2, {speed:.0f} m/min, {name}", float(printed), ours, tolerance)


@dataclass(frozen=True)
class Interval:
    """One minute of the whole run: the grid's pair, and the environment's response to the controller's action."""

    pair: tuple[float, float]
    commanded: tuple[float, float]
    """Both: cutting speed [m/min], feed [mm/rev]."""
    removed: float
    """[cm3]"""
    wear: float
    """[mm]"""
    thrust_force: float
    """[N]"""
    power: float
    """[kW]"""
    finished: bool
    """Whether the edge was worn out or broken."""


@cache
def whole_run() -> tuple[Interval, ...]:
    """Return the edge's whole life, played on the environment until no pair is feasible."""
    run = PaperRun()
    env = RoughTurningEnv("paper")
    policy = GridSearch(run.scenario, 1)
    observation, info = env.reset(seed=0)
    intervals: list[Interval] = []
    while (pair := run.chosen(info["wear"], len(intervals))) is not None:
        observation, _, terminated, _, info = env.step(policy.act(observation[np.newaxis])[0])
        commanded = (info["cutting_speed"], info["feed"])
        state = (info["removed"], info["wear"], info["thrust_force"], info["power"])
        intervals.append(Interval(pair, commanded, *state, terminated))
    return tuple(intervals)


def run_checks() -> Iterator[Check]:
    """Yield the checks of the whole run."""
    intervals = whole_run()
    for number, interval in enumerate(intervals, 1):
        what = f"interval {number}: {{}} the controller commands"
        yield Check(what.format("cutting speed"), interval.pair[0], interval.commanded[0], 1e-4)
        yield Check(what.format("feed"), interval.pair[1], interval.commanded[1], 1e-6)
        yield Check(f"interval {number}: edge finished", 0, interval.finished)
    yield Check("intervals until no pair is feasible", 14, len(intervals))
    for number, speed, feed in ((1, 150.0, 0.58), (2, 140.0, 0.58), (14, 200.0, 0.205)):
        yield Check(f"interval {number}: cutting speed [m/min]", speed, intervals[number - 1].pair[0], 1e-9)
        yield Check(f"interval {number}: feed [mm/rev]", feed, intervals[number - 1].pair[1], 1e-9)
    yield Check("wear after interval 14 [mm], just under 0.3", 0.2975, intervals[-1].wear, 0.0025)
    yield Check("mean removal rate [cm3/min], 158 to 159", 158.5, adaptive_control().rate, 1.5)


def adaptive_control() -> verification.Outcome:
    """Return the result of the grid search's edge."""
    intervals = whole_run()
    return verification.Outcome(sum(interval.removed for interval in intervals) / len(intervals), float(len(intervals)))


@dataclass(frozen=True)
class Rival:
    """One of the tests T1 to T9, played."""

    test: verification.VerificationTest
    nominal: verification.Outcome
    """Result with nominal wear."""
    wear_factor: float | None
    """Factor on the nominal wear with which the edge lasts as long as measured [-]."""
    measured: verification.Outcome | None
    """Result with the wear factor."""


@cache
def rivals() -> tuple[Rival, ...]:
    """Return all tests, played with nominal wear and, where the paper gives a life, with the wear that this implies."""
    found = []
    for test, nominal in zip(TESTS, verification.played(TESTS), strict=True):
        factor = None if test.life is None else verification.implied_wear_factor(test, test.life)
        measured = None if factor is None else verification.played([test], factor)[0]
        found.append(Rival(test, nominal, factor, measured))
    return tuple(found)


def rival_checks() -> Iterator[Check]:
    """Yield the checks of the grid search against the tests."""
    control = adaptive_control()
    for rival in rivals():
        test, name = rival.test, rival.test.name
        tolerance = ROUNDED * test.rate_ratio
        yield Check(f"grid search / {name}, metal per minute", test.rate_ratio, control.rate / rival.nominal.rate, tolerance)
        if test.life is None or rival.measured is None:
            continue
        yield Check(
            f"{name}: life [min], wear as measured (factor {rival.wear_factor:.2f})", test.life, rival.measured.life, 0.02
        )
        yield Check(
            f"{name}: life [min], nominal wear",
            test.life,
            rival.nominal.life,
            ROUNDED * test.life,
            not_reproduced=f"the paper's edge wore {rival.wear_factor:.2f} times as much as its models say",
        )
        if test.total_ratio is None:
            continue
        tolerance = ROUNDED * test.total_ratio
        what = f"grid search / {name}, metal per edge, {{}}"
        stated = control.rate * STATED_LIFE / rival.measured.total
        yield Check(what.format("life as measured; grid search 15 min"), test.total_ratio, stated, tolerance)
        yield Check(
            what.format("life as measured"),
            test.total_ratio,
            control.total / rival.measured.total,
            tolerance,
            not_reproduced="the ratio takes 15 min for the grid search, whose fifteenth minute has no feasible pair",
        )
        yield Check(
            what.format("nominal wear"),
            test.total_ratio,
            control.total / rival.nominal.total,
            tolerance,
            not_reproduced="the grid search is given nominal wear, the test its measured wear",
        )
    by_name = {test.name: test for test in TESTS}
    for name in ("T5", "T8"):
        _, power = verification.force_and_power(by_name[name], 0.3)
        yield at_most(f"{name}: power when worn out [kW], the available not fully used", 7.0, power)
    last = next(rival for rival in rivals() if rival.test.name == "T9")
    assert last.wear_factor is not None
    flank_wear = last.wear_factor * verification.wear(last.test, COLLAPSE_TIME)
    force, _ = verification.force_and_power(last.test, flank_wear)
    yield Check(
        "T9: thrust force when its edge collapsed [N]",
        COLLAPSE_FORCE,
        force,
        ROUNDED * COLLAPSE_FORCE,
        not_reproduced=f"at {flank_wear:.2f} mm of wear the force law gives less: it knows no plastic deformation",
    )


def tables() -> Iterator[str]:
    """Yield the tables of the whole run and of the comparison with the tests."""
    for number, interval in enumerate(whole_run(), 1):
        speed, feed = interval.pair
        yield (
            f"interval {number:2d}: {speed:.0f} m/min, {feed:.3f} mm/rev, {interval.removed:6.2f} cm3, "
            f"{interval.wear:.4f} mm, {interval.thrust_force:.0f} N, {interval.power:.2f} kW"
        )
    control = adaptive_control()
    yield ""
    yield "Fixed speed and feed against the grid search (AC), at 2.5 mm; T6 and T7 cannot be recovered."
    yield "Wear factor: measured over nominal wear. Force and power: of the models, when worn out."
    heads: tuple[str, ...] = ("", "m/min", "mm/rev", "cm3/min", "AC/test", "paper")
    heads += ("nominal min", "AC/test", "measured min", "wear", "AC/test", "at 15 min", "paper", "N", "kW")
    rows = []
    for rival in rivals():
        test, nominal, measured = rival.test, rival.nominal, rival.measured
        row = [test.name, f"{test.cutting_speed:.0f}", f"{test.feed:.3f}", f"{nominal.rate:.1f}"]
        row += [f"{control.rate / nominal.rate:.2f}", f"{test.rate_ratio:.2f}"]
        row += [f"{nominal.life:.1f}", f"{control.total / nominal.total:.2f}"]
        if measured is None:
            row += ["-"] * 5
        else:
            row += [f"{measured.life:.1f}", f"{rival.wear_factor:.2f}", f"{control.total / measured.total:.2f}"]
            row += [f"{control.rate * STATED_LIFE / measured.total:.2f}", f"{test.total_ratio:.2f}" if test.total_ratio else "-"]
        force, power = verification.force_and_power(test, 0.3)
        rows.append([*row, f"{force:.0f}", f"{power:.2f}"])
    rows.append(["AC", "", "", f"{control.rate:.1f}", "", "", f"{control.life:.1f}", *[""] * 8])
    yield from table(heads, rows)


def checks() -> Iterator[Check]:
    """Yield all checks of the paper."""
    run = PaperRun()
    yield from table_1(run)
    yield from table_2(run)
    yield from run_checks()
    yield from rival_checks()
