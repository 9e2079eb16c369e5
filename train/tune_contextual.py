"""Tune the rule ``contextual`` for a family, and write its parameters to the family's file.

Files of families are in ``baselines/tuned/families``.

    python -m train.tune_contextual unmodelled
    python -m train.tune_contextual shop --jobs 64 --out my_shop.json

1. ``self_tuning`` plays training jobs with every highest speed of a grid.
2. Linear laws of the speed are fitted to the returns of this grid: a constant; a regression of each
   job's best speed on the catalogue's numbers that the family shows; the law of these numbers that
   earns most in the grid; and that of two of them.
3. These candidates play validation jobs. The highest mean return wins.

No other jobs are played. The same command gives the same file, and resumes an interrupted tuning:
it takes the batches that were played from a log.
"""

import json
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines import tuned
from baselines.contextual import (
    CHANGE_AT,
    MIDDLE,
    RULES,
    SPEED,
    log_speeds,
    slope_name,
    with_highest_speeds,
)
from baselines.rule import Array, Parameters
from leaderboard.play import play_family
from leaderboard.statistics import Bootstrap, Estimate
from train.tune_rules import log_of
from turning_env import MODEL_VERSION, Family
from turning_env.console import Parser, described, exits
from turning_env.files import file_lock, folder_lock, replace_file
from turning_env.progress import progress

NAME = "contextual"
JOBS = 96  # training jobs, and validation jobs, that are played
MIN_JOBS = 16
LOG_SPEEDS = tuple(np.linspace(np.log(0.42), np.log(1.6), 6).round(3).tolist())
"""Log highest speeds over the start speed in the grid: to the machine's highest speed."""
LIFE = 0.8  # used life at the change of edges [-]: that of ``self_tuning`` on ``unmodelled``
BATCH = 128  # environments that are played together, about
STEPS = (0.16, 0.08, 0.04, 0.02, 0.01)  # steps of the search over the parameters of a law
START = -0.3  # log speed at which searches begin
DIGITS = 3
"""Decimals of the parameters: their last bits depend on the processor and do not count."""


@dataclass(frozen=True)
class Grid:
    """The returns of training jobs at all speeds of the grid, and their catalogue numbers."""

    returns: Array  # [s], shape (jobs, speeds)
    numbers: Array  # numbers less ``MIDDLE``, shape (jobs, numbers)
    names: tuple[str, ...]  # names of the numbers

    def columns(self, names: Sequence[str]) -> Array:
        """Return the numbers of these names, shape (jobs, names)."""
        places = [self.names.index(name) for name in names]
        return np.asarray(self.numbers[:, places])

    def mean_return(self, log_speeds: Array) -> float:
        """Return the mean over jobs of the returns at log speeds, shape (jobs,).

        Returns are interpolated linearly. Beyond the ends of the grid, the return is that of the
        end.
        """
        points = np.array(LOG_SPEEDS)
        inside = np.clip(log_speeds, points[0], points[-1])
        below = np.searchsorted(points, inside, side="right") - 1
        below = np.clip(below, 0, len(points) - 2)
        above = below + 1
        low_point = points[below]
        high_point = points[above]
        share = (inside - low_point) / (high_point - low_point)
        job = np.arange(len(self.returns))
        low = self.returns[job, below]
        high = self.returns[job, above]
        returns = low + share * (high - low)
        return float(returns.mean())

    def mean_return_of_law(self, law: Parameters) -> float:
        """Return the mean over jobs of the returns [s] at the speeds of a law."""
        numbers = []
        for row in self.numbers + MIDDLE:
            numbers.append(dict(zip(self.names, row, strict=True)))
        return self.mean_return(log_speeds(law, numbers))

    def best_log_speeds(self) -> Array:
        """Return the best log speed of each job, shape (jobs,)."""
        return np.asarray(np.array(LOG_SPEEDS)[self.returns.argmax(axis=1)])


def climb(value: Callable[[Array], float], start: Array) -> Array:
    """Return the numbers with the highest value that a search from ``start`` finds.

    The search changes one number after the other as long as that helps, then takes smaller steps.
    """
    best = start.round(DIGITS)
    best_value = value(best)
    for step in STEPS:
        improved = True
        while improved:
            improved = False
            for place in range(len(best)):
                for change in (-step, step):
                    trial = best.copy()
                    trial[place] += change
                    trial_value = value(trial)
                    if trial_value > best_value:
                        best = trial
                        best_value = trial_value
                        improved = True
    return best.round(DIGITS)


def with_best_constant(grid: Grid, slopes: Parameters) -> Parameters:
    """Return a law of given slopes, and of the constant with which its mean return is highest.

    The constant is lower than that of least squares, because too fast costs more than too slow.
    """
    prefix = slope_name("")
    names = [name.removeprefix(prefix) for name in slopes]
    values = np.array(list(slopes.values()))
    by_numbers = grid.columns(names) @ values

    def value(constant: Array) -> float:
        return grid.mean_return(constant[0] + by_numbers)

    best = climb(value, np.array([START]))
    constants = {SPEED: float(best[0]), CHANGE_AT: LIFE}
    return constants | slopes


def regression(grid: Grid, names: Sequence[str]) -> Parameters:
    """Return a least-squares law of each job's best log speed, with the best constant."""
    columns = grid.columns(names)
    best_speeds = grid.best_log_speeds()
    # Slopes alone: ``with_best_constant`` finds a better constant than the regression.
    centred = columns - columns.mean(axis=0)
    centred_speeds = best_speeds - best_speeds.mean()
    solution, *_ = np.linalg.lstsq(centred, centred_speeds, rcond=None)
    slopes = {}
    for name, slope in zip(names, solution, strict=True):
        slopes[slope_name(name)] = round(float(slope), DIGITS)
    return with_best_constant(grid, slopes)


def best_law(grid: Grid, names: Sequence[str]) -> Parameters:
    """Return the law of some numbers that earns most in the grid."""
    columns = grid.columns(names)

    def value(numbers: Array) -> float:
        constant = numbers[0]
        slopes = numbers[1:]
        return grid.mean_return(constant + columns @ slopes)

    parameters = [SPEED]
    for name in names:
        parameters.append(slope_name(name))
    law = regression(grid, names)
    start = np.array([law[parameter] for parameter in parameters])
    best = climb(value, start)
    best_values = dict(zip(parameters, best.tolist(), strict=True))
    return best_values | {CHANGE_AT: LIFE}


def best_pair(grid: Grid, names: Sequence[str]) -> Parameters:
    """Return the law of two numbers that earns most in the grid."""
    laws = [best_law(grid, pair) for pair in combinations(names, 2)]
    return max(laws, key=grid.mean_return_of_law)


def candidates(grid: Grid, shown: Sequence[str]) -> dict[str, Parameters]:
    """Return the laws to compare, by name.

    ``shown``: names of the catalogue's numbers that they may use.
    """
    laws = {"constant": with_best_constant(grid, {})}
    if shown:
        laws["regression"] = regression(grid, shown)
        laws["best law"] = best_law(grid, shown)
    if len(shown) > 1:
        laws["best law of two numbers"] = best_pair(grid, shown)
    return laws


class Plays:
    """Plays batches of a family's jobs, and keeps their returns in a log.

    Args:
        family: the family.
        log: file of the batches that were played, one in a line.

    Attributes:
        episodes: number of episodes that the results of this object took.
    """

    def __init__(self, family: Family, log: Path) -> None:
        self._family = family
        self._log = log
        self._known: dict[str, list[float]] = {}
        self.episodes = 0
        lines = log.read_text("utf-8", "replace").splitlines() if log.exists() else []
        for line in lines:
            with suppress(ValueError, TypeError):  # a line that a killed process left incomplete
                batch, returns = json.loads(line)
                self._known[json.dumps(batch)] = returns

    def grid(self, jobs: int) -> Grid:
        """Return the returns of the first training jobs at all speeds of the grid."""
        constants = [{SPEED: speed, CHANGE_AT: LIFE} for speed in LOG_SPEEDS]
        returns = self.laws("grid", constants, "train", jobs).T
        names = self._family.shown
        numbers = np.empty((jobs, len(names)))
        for job in range(jobs):
            known = self._family.job(job).numbers
            numbers[job] = [known[name] for name in names]
        return Grid(returns, numbers - MIDDLE, names=names)

    def laws(self, title: str, laws: Sequence[Parameters], split: str, jobs: int) -> Array:
        """Return the returns of several laws on the first jobs of a split, shape (laws, jobs).

        All laws play a chunk of jobs together. The jobs of a chunk take about as long, so that none
        waits for others.
        """
        limits = [self._family.job(job, split).scenario.control.time_limit for job in range(jobs)]
        # The order of equal limits must not depend on NumPy: it names the batches in the log.
        order = np.argsort(limits, kind="stable").tolist()
        size = max(BATCH // len(laws), 1)
        chunks = [order[first : first + size] for first in range(0, jobs, size)]
        returns = np.empty((len(laws), jobs))
        for chunk in progress(chunks, f"{title}, {split}", unit="batch"):
            played = self._returns(laws, split, chunk)
            returns[:, chunk] = np.reshape(played, (len(laws), len(chunk)))
        return returns

    def _returns(self, laws: Sequence[Parameters], split: str, jobs: Sequence[int]) -> list[float]:
        """Return the returns of all laws on jobs, one law after the other.

        They come from the log, or the laws are played.
        """
        self.episodes += len(laws) * len(jobs)
        batch = [
            MODEL_VERSION,
            RULES[NAME].version,
            self._family.digest(),
            split,
            list(jobs),
            list(laws),
        ]
        key = json.dumps(batch)
        if key not in self._known:
            self._known[key] = self._play(laws, split, jobs)
            with self._log.open("a", encoding="utf-8") as file:
                file.write(f"\n{json.dumps([batch, self._known[key]])}\n")
        return self._known[key]

    def _play(self, laws: Sequence[Parameters], split: str, jobs: Sequence[int]) -> list[float]:
        """Play all laws on jobs, side by side; return their returns, one law after the other."""
        drawn = [self._family.job(job, split) for job in jobs]
        numbers = [job.numbers for job in drawn]
        fixed: Any = RULES[NAME].fixed
        policy = with_highest_speeds(
            [job.scenario.nominal() for job in drawn] * len(laws),
            len(jobs) * len(laws),
            log_speed=np.concatenate([log_speeds(law, numbers) for law in laws]),
            change_at=LIFE,
            **fixed,
        )
        episodes = play_family(
            self._family,
            split,
            seeds=list(jobs) * len(laws),
            make_policy=lambda num_envs: policy,
            context="hidden",
        )
        returns: list[float] = episodes["return"].tolist()
        return returns


def tune(family: Family, plays: Plays, jobs: int) -> dict[str, Any]:
    """Return the entry of the rule in a file of tuned parameters, and print all candidates.

    The candidates are fitted to training jobs; the best on validation jobs is the rule.

    Args:
        family: the family.
        plays: plays the rule on the family's jobs.
        jobs: number of training jobs, and of validation jobs.
    """
    laws = candidates(plays.grid(jobs), family.shown)
    returns_of_laws = plays.laws("candidates", list(laws.values()), split="validation", jobs=jobs)
    # Returns [s] of each candidate by its name, shape (jobs,).
    returns_by_name = dict(zip(laws, returns_of_laws, strict=True))
    means = {}
    for name, returns in returns_by_name.items():
        _print_candidate(name, laws[name], returns_by_name)
        means[name] = float(returns.mean())
    best = max(means, key=means.__getitem__)
    return {
        "version": RULES[NAME].version,
        "parameters": laws[best],
        "candidate": best,
        "validation_returns": {name: round(mean, 1) for name, mean in means.items()},
        "jobs": jobs,
        "episodes_played": plays.episodes,
    }


def _print_candidate(name: str, law: Parameters, returns_by_name: Mapping[str, Array]) -> None:
    """Print a candidate's return on the validation jobs, its lead and its parameters."""
    returns = returns_by_name[name]
    leads = returns - returns_by_name["constant"]
    bootstrap = Bootstrap(len(leads))
    means = bootstrap.means(leads[np.newaxis], "")
    lead = Estimate.of(leads.mean(), means)
    median = np.median(leads)
    interval = f"{lead.low:.0f} to {lead.high:.0f}"
    lead_text = f"{lead.value:.0f} ({interval}), median {median:.0f}"
    result = f"{returns.mean():.0f} s on validation jobs, over the constant {lead_text} s"
    tqdm.write(f"{name}: {result}; {law}")


@exits(ValueError, interrupted="interrupted: run the same command again to go on")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = Parser(prog="python -m train.tune_contextual", **described(__doc__))
    parser.add_argument("family", help="family, or its TOML file")
    parser.add_argument(
        "--jobs",
        type=int,
        default=JOBS,
        metavar="N",
        help="training jobs, and validation jobs, that are played (default: %(default)s)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="JSON file to write (default: the family's, which ships)",
    )
    parsed = parser.parse_args(arguments)
    family = Family.load(parsed.family)
    if not MIN_JOBS <= parsed.jobs <= family.held_out_jobs:
        raise ValueError(
            f"--jobs is {parsed.jobs}, but must be {MIN_JOBS} to {family.held_out_jobs}"
        )
    target = parsed.out or tuned.family_path(family)
    log = log_of(NAME, target)
    words = ["python", "-m", "train.tune_contextual", parsed.family, "--jobs", str(parsed.jobs)]
    command = shlex.join(words)
    with file_lock(log):
        entry = tune(family, Plays(family, log), parsed.jobs)
        entry["command"] = command
        with folder_lock(target.parent, wait=True):
            values = tuned.read(target)
            digest = tuned.family_digest(family)
            if values.get("family_digest") != digest:
                values = {"command": command, "family_digest": digest, "rules": {}}
            values["rules"][NAME] = entry
            text = json.dumps(values, indent=1) + "\n"
            replace_file(target, lambda path: path.write_text(text, "utf-8"))
        log.unlink(missing_ok=True)
    print(target)
    return 0


if __name__ == "__main__":
    sys.exit(main())
