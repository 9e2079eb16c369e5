"""Alaskari and Oraby (2018): the grid search, its tables, the life of its edge, and the tests that it was compared with.

Table 1 (first minute) and Table 2 (second minute): the feed that the grid search chooses for each of 16 cutting speeds, and wear,
force, power and removal rate there. Then the edge's whole life, played by the grid search on RoughTurning-Paper-v0, and compared
with the tests at fixed speed and feed: first with the paper's wear, then with the same wear for all. The paper calls a minute a
time interval.
"""

import csv
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from baselines.fixed import FixedParameters
from baselines.grid_search import GridSearch, RescaledGridSearch, best_pair, grid, highest_feed, predict
from papers import verification
from papers.reproduce.checks import Check, at_least, at_most, table
from papers.verification import COLLAPSE_FORCE, COLLAPSE_TIME, STATED_LIFE, TESTS, Outcome, VerificationTest
from turning_env import RoughTurningEnv, Scenario
from turning_env.physics.records import parameter_records
from turning_env.scoring.play import play
from turning_env.scoring.policy import PolicyFactory
from turning_env.scoring.seeds import tuning_seeds

PAPER = Path(__file__).parents[1] / "data"
WEAR_BEFORE = {1: 0.0, 2: 0.157219}
"""Wear from which Tables 1 and 2 start [mm]."""
EXACT = {"feed_mm_rev": 1e-9, "mrr_mm3_min": 1e-6}
"""Tolerances of the columns that are no response."""

MISPRINTS = {("50", "wear_increase_mm"): "0.01250"}
"""Table 2 prints 0.01255 here, but the row's 0.08003 - 0.06753 and its total wear give 0.01250."""

ROUNDED = 0.015
"""Relative tolerance for the tests: their feeds are rounded, and so are the paper's ratios."""

NUM_EDGES = 32
"""Edges of the comparison with equal wear."""


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


def table_checks(run: PaperRun, minute: int) -> Iterator[Check]:
    """Yield the checks of Table 1 or 2: chosen feeds exactly, responses to 1e-5 of their value or to the last printed digit."""
    depth, law = run.scenario.workpiece.depth_of_cut, run.scenario.material.wear
    for row in rows(f"table{minute}.csv"):
        speed = float(row["speed_m_min"])
        feed, wear, power, force = run.row(speed, WEAR_BEFORE[minute], minute - 1.0)
        found = {"feed_mm_rev": feed, "power_kw": power, "thrust_force_n": force, "mrr_mm3_min": 1000 * speed * feed * depth}
        if minute == 1:
            found["wear_mm"] = wear
        else:
            found |= {
                "wear_at_t_mm": float(law(speed, feed, depth, time=2.0)),
                "wear_at_t_minus_1_mm": float(law(speed, feed, depth, time=1.0)),
                "wear_increase_mm": wear - WEAR_BEFORE[minute],
                "total_wear_mm": wear,
            }
        for name, ours in found.items():
            printed = MISPRINTS.get((row["speed_m_min"], name), row[name])
            tolerance = EXACT.get(name, 1e-5 * ours if minute == 1 else last_digit(printed))
            yield Check(f"Table {minute}, {speed:.0f} m/min, {name}", float(printed), ours, tolerance)


class Minute(NamedTuple):
    """One minute of the edge's life: the grid's pair, and the environment's response to the controller's action."""

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
def whole_life() -> tuple[Minute, ...]:
    """Return the edge's whole life, played on the environment until no pair is feasible."""
    run = PaperRun()
    env = RoughTurningEnv("paper")
    policy = GridSearch(run.scenario, 1)
    observation, info = env.reset(seed=0)
    minutes: list[Minute] = []
    while (pair := run.chosen(info["wear"], len(minutes))) is not None:
        observation, _, terminated, _, info = env.step(policy.act(observation[np.newaxis])[0])
        commanded = (info["cutting_speed"], info["feed"])
        state = (info["removed"], info["wear"], info["thrust_force"], info["power"])
        minutes.append(Minute(pair, commanded, *state, terminated))
    return tuple(minutes)


def life_checks() -> Iterator[Check]:
    """Yield the checks of the edge's life."""
    minutes = whole_life()
    for number, minute in enumerate(minutes, 1):
        yield Check(f"minute {number}: cutting speed the controller commands", minute.pair[0], minute.commanded[0], 1e-4)
        yield Check(f"minute {number}: feed the controller commands", minute.pair[1], minute.commanded[1], 1e-6)
        yield Check(f"minute {number}: edge finished", 0, minute.finished)
    yield Check("minutes until no pair is feasible", 14, len(minutes))
    for number, speed, feed in ((1, 150.0, 0.58), (2, 140.0, 0.58), (14, 200.0, 0.205)):
        yield Check(f"minute {number}: cutting speed [m/min]", speed, minutes[number - 1].pair[0], 1e-9)
        yield Check(f"minute {number}: feed [mm/rev]", feed, minutes[number - 1].pair[1], 1e-9)
    yield Check("wear after minute 14 [mm], just under 0.3", 0.2975, minutes[-1].wear, 0.0025)
    yield Check("mean removal rate [cm3/min], 158 to 159", 158.5, adaptive_control().rate, 1.5)


def adaptive_control() -> Outcome:
    """Return the result of the grid search's edge."""
    minutes = whole_life()
    return Outcome(sum(minute.removed for minute in minutes) / len(minutes), float(len(minutes)))


class Rival(NamedTuple):
    """One of the tests T1 to T9, played."""

    test: VerificationTest
    nominal: Outcome
    """Result with nominal wear."""
    wear_factor: float
    """Factor on the nominal wear with which the edge lasts as long as measured [-]; NaN where the paper gives no life."""
    measured: Outcome | None
    """Result with the wear factor."""


@cache
def rivals() -> tuple[Rival, ...]:
    """Return all tests, played with nominal wear and, where the paper gives a life, with the wear that this implies."""
    found = []
    for test, nominal in zip(TESTS, verification.played(TESTS), strict=True):
        factor = np.nan if test.life is None else verification.implied_wear_factor(test, test.life)
        found.append(Rival(test, nominal, factor, None if test.life is None else verification.played([test], factor)[0]))
    return tuple(found)


def rival_checks() -> Iterator[Check]:
    """Yield the checks of the grid search against the tests."""
    control = adaptive_control()
    stated = Outcome(control.rate, STATED_LIFE)
    for test, nominal, factor, measured in rivals():
        what, ratio = f"grid search / {test.name}, metal per", test.rate_ratio
        yield Check(f"{what} minute", ratio, control.rate / nominal.rate, ROUNDED * ratio)
        if test.life is None or measured is None:
            continue
        yield Check(f"{test.name}: life [min], wear as measured (factor {factor:.2f})", test.life, measured.life, 0.02)
        reason = f"the paper's edge wore {factor:.2f} times as much as its models say"
        yield Check(f"{test.name}: life [min], nominal wear", test.life, nominal.life, ROUNDED * test.life, not_reproduced=reason)
        if test.total_ratio is None:
            continue
        for given, ours, rival, reason in (
            ("life as measured; grid search 15 min", stated, measured, ""),
            (
                "life as measured",
                control,
                measured,
                "the ratio takes 15 min for the grid search, whose fifteenth minute has no feasible pair",
            ),
            ("nominal wear", control, nominal, "the grid search is given nominal wear, the test its measured wear"),
        ):
            tolerance = ROUNDED * test.total_ratio
            yield Check(f"{what} edge, {given}", test.total_ratio, ours.total / rival.total, tolerance, not_reproduced=reason)
    by_name = {rival.test.name: rival for rival in rivals()}
    for name in ("T5", "T8"):
        _, power = verification.force_and_power(by_name[name].test, 0.3)
        yield at_most(f"{name}: power when worn out [kW], the available not fully used", 7.0, power)
    last = by_name["T9"]
    for test in TESTS:
        minutes, collapsed = verification.until_failure(test)
        yield Check(f"{test.name}: edge collapses, preset practitioner", test.name == "T9", collapsed)
        if collapsed:
            yield Check(f"{test.name}: collapse after [min], preset practitioner", COLLAPSE_TIME, minutes, 0.1)
    flank_wear = last.wear_factor * verification.wear(last.test, COLLAPSE_TIME)
    force, _ = verification.force_and_power(last.test, flank_wear)
    reason = f"at {flank_wear:.2f} mm of wear the force law gives less: it knows no plastic deformation"
    what = "T9: thrust force when its edge collapsed [N]"
    yield Check(what, COLLAPSE_FORCE, force, ROUNDED * COLLAPSE_FORCE, not_reproduced=reason)


class EqualWear(NamedTuple):
    """Means over edges that wear as those of the tests did, on the preset `measured_wear`."""

    outcome: Outcome
    severe: float
    """Share of cutting time over a limit by more than 5 % [-]."""
    excess: float
    """Mean relative excess over the limits [-]."""


@cache
def equal_wear() -> dict[str, EqualWear]:
    """Return the grid searches, planning with nominal wear, and the tests with a known life, on the same edges."""
    by_minute, by_tenth = verification.with_measured_wear(60.0), verification.with_measured_wear(6.0)
    nominal = by_minute.nominal()
    players: dict[str, tuple[Scenario, PolicyFactory]] = {
        "grid search": (by_minute, lambda num_envs: GridSearch(nominal, num_envs)),
        "rescaled grid search": (by_minute, lambda num_envs: RescaledGridSearch(nominal, num_envs, 1.0, 1.0)),
    }
    for test in (test for test in TESTS if test.life is not None):
        fixed = FixedParameters(by_tenth, test.cutting_speed, test.feed)
        players[test.name] = by_tenth, partial(lambda policy, num_envs: policy, fixed)
    results = {}
    for name, (scenario, make) in players.items():
        episodes = play(make, scenario, tuning_seeds(NUM_EDGES))
        seconds = episodes["engaged_time"].sum()
        outcome = Outcome(60.0 * float(episodes["removed"].sum() / seconds), float(seconds) / 60.0 / NUM_EDGES)
        severe, excess = (float(episodes[key].sum() / seconds) for key in ("severe_overload_time", "excess"))
        results[name] = EqualWear(outcome, severe, excess)
    return results


def equal_wear_checks() -> Iterator[Check]:
    """Yield the checks of the paper's comparison with the same wear for the grid search and the tests."""
    results = equal_wear()
    (control, severe, _), rescaled = results["grid search"], results["rescaled grid search"]
    for test in TESTS:
        if test.name not in results:
            continue
        rival = results[test.name].outcome
        yield at_least(f"equal wear, grid search / {test.name}: metal per minute", test.rate_ratio, control.rate / rival.rate)
        if test.total_ratio is None:
            continue
        reason = f"with the same wear for both its edge lasts {control.life:.1f} min, not 15"
        ratio = control.total / rival.total
        yield at_least(f"equal wear, grid search / {test.name}: metal per edge", test.total_ratio, ratio, not_reproduced=reason)
    reason = "it plans with nominal wear, so the worn edge needs more force and power than it expects"
    yield at_most("equal wear, grid search: share of time over a limit by > 5 %", 0.0, severe, not_reproduced=reason)
    yield at_most("equal wear, grid search rescaled by measured force and power: the same share", 0.1, rescaled.severe)


def tables() -> Iterator[str]:
    """Yield the tables of the edge's life and of the comparisons with the tests."""
    for number, ((speed, feed), _, removed, wear, force, power, _) in enumerate(whole_life(), 1):
        pair = f"minute {number:2d}: {speed:.0f} m/min, {feed:.3f} mm/rev"
        yield f"{pair}, {removed:6.2f} cm3, {wear:.4f} mm, {force:.0f} N, {power:.2f} kW"
    control = adaptive_control()
    yield ""
    yield "Fixed speed and feed against the grid search (AC), at 2.5 mm; T6 and T7 cannot be recovered."
    yield "Wear factor: measured over nominal wear. Force and power: of the models, when worn out."
    heads: tuple[str, ...] = ("", "m/min", "mm/rev", "cm3/min", "AC/test", "paper")
    heads += ("nominal min", "AC/test", "measured min", "wear", "AC/test", "at 15 min", "paper", "N", "kW")
    rows = []
    for test, nominal, factor, measured in rivals():
        row = [test.name, f"{test.cutting_speed:.0f}", f"{test.feed:.3f}", f"{nominal.rate:.1f}"]
        row += [f"{control.rate / nominal.rate:.2f}", f"{test.rate_ratio:.2f}"]
        row += [f"{nominal.life:.1f}", f"{control.total / nominal.total:.2f}"]
        if measured is None:
            row += ["-"] * 5
        else:
            row += [f"{measured.life:.1f}", f"{factor:.2f}", f"{control.total / measured.total:.2f}"]
            row += [f"{control.rate * STATED_LIFE / measured.total:.2f}", f"{test.total_ratio:.2f}" if test.total_ratio else "-"]
        force, power = verification.force_and_power(test, 0.3)
        rows.append([*row, f"{force:.0f}", f"{power:.2f}"])
    rows.append(["AC", "", "", f"{control.rate:.1f}", "", "", f"{control.life:.1f}", *[""] * 8])
    yield from table(heads, rows)
    yield ""
    yield f"The same with equal wear for all (preset measured_wear), means over {NUM_EDGES} edges."
    heads = ("", "cm3/min", "min", "cm3", "over a limit by > 5 %", "mean excess")
    yield from table(
        heads,
        [
            [name, f"{edge.rate:.1f}", f"{edge.life:.1f}", f"{edge.total:.0f}", f"{severe:.0%}", f"{excess:.1%}"]
            for name, (edge, severe, excess) in equal_wear().items()
        ],
    )


def checks() -> Iterator[Check]:
    """Yield all checks of the paper."""
    run = PaperRun()
    yield Check("pairs of the grid", 1744, len(run.speeds) * len(run.feeds))
    yield from table_checks(run, 1)
    yield from table_checks(run, 2)
    yield from life_checks()
    yield from rival_checks()
    yield from equal_wear_checks()
