"""Sets the figures of Alaskari and Oraby (2018) beside the project's, and fails on any mismatch.

    python -m baselines.reproduce

Table 1 (first interval) and Table 2 (second interval): for each of 16 cutting speeds the feed that the grid search chooses,
and wear, force, power and removal rate there. Then the whole run, interval by interval, played by the grid search on
RoughTurning-Paper-v0.
"""

import csv
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from baselines.grid_search import GridSearch, best_pair, grid, highest_feed, predict
from turning_env import RoughTurningEnv, Scenario
from turning_env.records import parameter_records

PAPER = Path(__file__).parent / "paper"
FIRST_WEAR = 0.157219
"""Wear after the paper's first interval, from which its Table 2 starts [mm]."""

MISPRINTS = {("50", "wear_increase_mm"): "0.01250"}
"""Table 2 prints 0.01255 here, but 0.08003 - 0.06753 in the same row, and its total wear, give 0.01250."""


@dataclass(frozen=True)
class Check:
    """One printed figure and the project's."""

    what: str
    paper: float
    ours: float
    tolerance: float
    """Largest absolute difference allowed."""

    @property
    def passed(self) -> bool:
        """Whether the two agree."""
        return abs(self.ours - self.paper) <= self.tolerance

    def __str__(self) -> str:
        verdict = "ok" if self.passed else "MISMATCH"
        return f"{self.what:<46} {self.paper:>14.8g} {self.ours:>14.8g}  {verdict}"


def rows(table: str) -> list[dict[str, str]]:
    """A table of the paper as printed."""
    with (PAPER / table).open(newline="") as file:
        return list(csv.DictReader(file))


def last_digit(printed: str) -> float:
    """One unit in the last printed digit: Table 2 cuts some figures off (0.164745 to 0.16474) and adds rounded ones."""
    return 10.0 ** -len(printed.partition(".")[2])


class PaperRun:
    """The paper's grid and limits on its nominal models."""

    def __init__(self) -> None:
        self.scenario = Scenario.load("paper")
        self.parameters = parameter_records(self.scenario)[0]
        self.speeds, self.feeds = grid(self.scenario)
        self.limits = (self.scenario.limits.thrust_force, self.scenario.limits.power, 1.0)

    def used_life(self, wear: float) -> float:
        """Used life share [-] at a wear [mm]."""
        return float((wear / self.scenario.tool.wear_criterion) ** (1.0 / self.scenario.material.wear.time))

    def wear(self, used_life: float) -> float:
        """Wear [mm] at a used life share [-]."""
        return float(self.scenario.tool.wear_criterion * used_life**self.scenario.material.wear.time)

    def row(self, speed: float, wear: float, start: float) -> tuple[float, float, float, float]:
        """(feed [mm/rev], wear [mm], power [kW], force [N]) of the best feed at a speed after one more minute."""
        life = self.used_life(wear)
        index = highest_feed(self.parameters, speed, self.feeds, life, start, start + 1.0, *self.limits)
        feed = self.feeds[index]
        used, force, power = predict(self.parameters, speed, feed, life, start, start + 1.0)
        return float(feed), self.wear(used), float(power), float(force)

    def chosen(self, wear: float, start: float) -> tuple[float, float] | None:
        """The pair (cutting speed [m/min], feed [mm/rev]) for the next minute, or None where none is feasible."""
        life = self.used_life(wear)
        speed, feed = best_pair(self.parameters, self.speeds, self.feeds, life, start, start + 1.0, *self.limits)
        return None if speed < 0 else (float(self.speeds[speed]), float(self.feeds[feed]))


def table_1(run: PaperRun) -> Iterator[Check]:
    """The first interval: chosen feeds exactly, responses to 1e-5 of their value."""
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
    """The second interval: chosen feeds exactly, responses to the last printed digit."""
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


def whole_run(run: PaperRun) -> Iterator[Check]:
    """The edge's whole life, played on the environment, against what the text says of it."""
    env = RoughTurningEnv("paper")
    policy = GridSearch(run.scenario, 1)
    observation, info = env.reset(seed=0)
    pairs: list[tuple[float, float]] = []
    removed = 0.0
    while (pair := run.chosen(info["wear"], len(pairs))) is not None:
        observation, _, terminated, _, info = env.step(policy.act(observation[np.newaxis])[0])
        number = len(pairs) + 1
        yield Check(f"interval {number}: cutting speed the controller commands", pair[0], info["cutting_speed"], 1e-4)
        yield Check(f"interval {number}: feed the controller commands", pair[1], info["feed"], 1e-6)
        yield Check(f"interval {number}: edge finished", 0, terminated, 0)
        pairs.append(pair)
        removed += info["removed"]
        print(
            f"interval {number:2d}: {pair[0]:.0f} m/min, {pair[1]:.3f} mm/rev, {info['removed']:6.2f} cm3, "
            f"{info['wear']:.4f} mm, {info['thrust_force']:.0f} N, {info['power']:.2f} kW"
        )
    yield Check("intervals until no pair is feasible", 14, len(pairs), 0)
    for number, speed, feed in ((1, 150.0, 0.58), (2, 140.0, 0.58), (14, 200.0, 0.205)):
        yield Check(f"interval {number}: cutting speed [m/min]", speed, pairs[number - 1][0], 1e-9)
        yield Check(f"interval {number}: feed [mm/rev]", feed, pairs[number - 1][1], 1e-9)
    yield Check("wear after interval 14 [mm], just under 0.3", 0.2975, info["wear"], 0.0025)
    yield Check("mean removal rate [cm3/min], 158 to 159", 158.5, removed / len(pairs), 1.5)


def main() -> int:
    """Print all checks; return the exit status."""
    run = PaperRun()
    checks = [*table_1(run), *table_2(run), *whole_run(run)]
    print(f"\n{'figure':<46} {'paper':>14} {'project':>14}")
    for check in checks:
        print(check)
    failed = sum(not check.passed for check in checks)
    print(f"\n{len(checks) - failed} of {len(checks)} figures agree")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
