"""Trace cost-limit curves: what agents remove, cost and return at several targets of severe overload.

    python -m studies.cost_limits
    python -m studies.cost_limits --seeds 3 --shares 0.5 1 2 --out docs/cost_limits.png
    python -m studies.cost_limits --steps 6000000

Every constrained algorithm trains at each target, a share of ``limits.overload_allowance``, and plays the same held-out seeds.
Training explores and finished agents do not, so the severely overloaded share of cutting time that an agent reaches differs from
its target. The curves are over the share reached. The table has 95 % bootstrap intervals over held-out seeds and training seeds.
``RUNS/cost_limits`` keeps the trainings: the same command continues where it stopped, and one with more seeds adds to them.
"""

import argparse
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator
from numpy.typing import NDArray
from tqdm import tqdm

from leaderboard.ranking import read_leaderboard
from leaderboard.result import Result, Task, result_folder
from leaderboard.shipped import RESULTS
from leaderboard.standings import Standing, rank
from train import lagrangian_ppo
from train.actor import ActorPolicy
from train.run import Run
from train.training import SEEDS, train
from turning_env import IDS, Scenario
from turning_env.console import described, exits, picture_path
from turning_env.scoring.play import play
from turning_env.scoring.policy import PolicySpec
from turning_env.scoring.seeds import held_out_seeds
from turning_env.scoring.statistics import Estimate
from turning_shop import plot_style as style

ENV_ID = "RoughTurning-v0"
ALGORITHMS = {module.ALGORITHM.name: module.ALGORITHM for module in (lagrangian_ppo,)}
SHARES = (0.25, 0.5, 1.0, 2.0, 4.0)
"""Targets as shares of the allowance [-]."""
SHIPPED = {"ppo": "s", "predictive": "^", "analytic_gradient": "D"}
"""Shipped policies in the picture, with their markers."""
PANELS = {"removal rate [cm³/min]": "removal_rate", "cost [min/dm³]": "cost", "return [s]": "mean_return"}


@dataclass(frozen=True)
class Point:
    """The agents of an algorithm at one target."""

    algorithm: str
    target: float
    """Severely overloaded share of cutting time [-]."""
    trained: tuple[NDArray[np.float64], ...]
    """Severely overloaded share of cutting time after each rollout in the last fifth of each training [-]."""
    seeds: tuple[Standing, ...]
    """Each training seed's numbers on the held-out seeds."""
    all_seeds: Standing
    """The numbers of all training seeds."""


def value(standing: Standing, name: str) -> float:
    """Return a number of a standing; of an estimate, its value; NaN if it is not known."""
    found = getattr(standing, name)
    return found.value if isinstance(found, Estimate) else np.nan if found is None else found


def point(algorithm: str, share: float, results: Sequence[tuple[Result, NDArray[np.float64]]]) -> Point:
    """Return the numbers of one target's agents, given their results and their severe shares in training."""
    played = [result for result, _ in results]
    target = share * played[0].task.scenario.limits.overload_allowance
    seeds = tuple(rank([each])[0] for each in played)
    return Point(algorithm, target, tuple(trained for _, trained in results), seeds, rank(played)[0])


def played(run: Run, task: Task) -> tuple[Result, NDArray[np.float64]]:
    """Train an agent unless that is finished, and play it; return its result and its severe shares late in training [-]."""
    algorithm = ALGORITHMS[run.algorithm]
    actor = algorithm.actor(train(run, algorithm))
    shares = np.array([row["severe_share"] for row in run.read_learning_curve()])
    spec = PolicySpec(name=run.algorithm, kind="agent", parameters=run.parameters, training_seed=run.seed)
    episodes = play(partial(ActorPolicy, actor), run.scenario, task.seeds)
    return Result.of(task, spec, episodes), shares[-max(1, len(shares) // 5) :]


def table(points: Sequence[Point]) -> list[str]:
    """Return the lines of a Markdown table of the points."""
    lines = [
        "| Algorithm | Target [%] | In training [%] | Off target there [%] | Reached [%] | Removal rate [cm3/min] "
        "| Cost [min/dm3] | Return [s] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for each in points:
        off = [np.abs(shares - each.target).mean() for shares in each.trained]
        shares = ([shares.mean() for shares in each.trained], off, [seed.severe_share for seed in each.seeds])
        cells = [f"`{each.algorithm}`", f"{100 * each.target:.3g}"]
        cells += [", ".join(f"{100 * share:.1f}" for share in seeds) for seeds in shares]
        cells += [", ".join(f"{seed.removal_rate:.1f}" for seed in each.seeds)]
        cells += [_text(each.all_seeds.cost, 2), _text(each.all_seeds.mean_return, 0)]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _text(estimate: Estimate | None, decimals: int) -> str:
    if estimate is None:
        return ""
    number, low, high = (f"{number:.{decimals}f}" for number in (estimate.value, estimate.low, estimate.high))
    return f"{number} ({low} to {high})"


def draw(points: Sequence[Point], shipped: Sequence[Standing], allowance: float) -> Figure:
    """Return a figure of removal rate, cost and return over the severe share reached; call it within ``style.for_print``."""
    figure = Figure(figsize=(style.DOUBLE, 3.0), layout="constrained")
    names = list(dict.fromkeys(each.algorithm for each in points))
    for axes, (title, name) in zip(figure.subplots(1, len(PANELS)), PANELS.items(), strict=True):
        for algorithm, (colour, dashes) in zip(names, style.policy_looks(names), strict=True):
            own = [each for each in points if each.algorithm == algorithm]
            seeds = [seed for each in own for seed in each.seeds]
            axes.plot(*_line(seeds, name), "o", markersize=2.4, color=colour, alpha=0.6)
            axes.plot(*_line([each.all_seeds for each in own], name), color=colour, linestyle=dashes, label=algorithm)
        for standing in shipped:
            marker = SHIPPED[standing.name]
            looks = {"markersize": 4.0, "color": style.BLACK, "markerfacecolor": "none"}
            axes.plot(*_line([standing], name), marker, label=f"{standing.name}, shipped", **looks)
        axes.axvline(100 * allowance, **style.LIMIT, label="allowance")
        axes.set_title(title, loc="left")
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(FixedLocator([0.1, 0.3, 1, 3, 10, 30]))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter("{x:g}")
        axes.grid(alpha=0.4)
        if name == "mean_return":  # falls to -1000 s at lax targets
            axes.set_yscale("symlog", linthresh=100.0)
            axes.yaxis.set_major_locator(FixedLocator([-2000, -1000, -500, -200, -100, -50, 0]))
            axes.yaxis.set_minor_locator(NullLocator())
            axes.yaxis.set_major_formatter("{x:g}")
        axes.set_xlabel("severe overload [% of cutting time]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _line(standings: Sequence[Standing], name: str) -> tuple[list[float], list[float]]:
    return [100 * each.severe_share for each in standings], [value(each, name) for each in standings]


@exits(ValueError, interrupted="interrupted: run the same command again to go on")
def main(arguments: Sequence[str] | None = None) -> int:
    """Train the missing agents, play all, print the table and draw; return the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    parser = argparse.ArgumentParser(prog="python -m studies.cost_limits", **described(__doc__))
    which = f"algorithms to train, from {', '.join(ALGORITHMS)} (default: all)"
    parser.add_argument("--algorithms", nargs="+", choices=ALGORITHMS, default=list(ALGORITHMS), metavar="NAME", help=which)
    shares = f"targets as shares of the allowance (default: {' '.join(f'{share:g}' for share in SHARES)})"
    parser.add_argument("--shares", nargs="+", type=float, default=list(SHARES), metavar="SHARE", help=shares)
    parser.add_argument("--seeds", type=int, default=2, help="trainings per algorithm and target (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=2_000_000, help="environment steps per training (default: %(default)s)")
    parser.add_argument("--episodes", type=int, default=256, help="held-out seeds that each agent plays (default: %(default)s)")
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of all runs (default: %(default)s)")
    parser.add_argument("--out", type=picture_path, metavar="PLOT", help="file to draw to: PNG, SVG or PDF, by its suffix")
    parsed = parser.parse_args(arguments)
    for name, most in (("seeds", SEEDS), ("steps", 10**12), ("episodes", 10**6)):
        if not 1 <= (number := getattr(parsed, name)) <= most:
            parser.error(f"--{name} is {number}, but must be 1 to {most}")
    if unfit := [share for share in parsed.shares if not 0.0 < share < np.inf]:
        parser.error(f"--shares has {unfit[0]}, but must be above 0")
    command = f"python -m studies.cost_limits {shlex.join(arguments)}".strip()
    scenario = Scenario.load(IDS[ENV_ID])
    task = Task(env_id=ENV_ID, scenario=scenario, seeds=held_out_seeds(parsed.episodes))
    # One training seed after the other, so that an interrupted command leaves whole curves.
    names, targets = dict.fromkeys(parsed.algorithms), sorted(set(parsed.shares))
    agents = [(name, share, seed) for seed in range(parsed.seeds) for name in names for share in targets]
    found: dict[tuple[str, float], list[tuple[Result, NDArray[np.float64]]]] = {}
    for name, share, seed in (bar := tqdm(agents, unit="agent", disable=None)):
        bar.set_postfix_str(f"{name} at {share:g}, seed {seed}")
        values = {"steps": parsed.steps, "share_of_allowance": share}
        folder = parsed.runs / "cost_limits" / f"{share:g}"
        run = Run.plan(name, ENV_ID, scenario, seed, folder, command, values)
        found.setdefault((name, share), []).append(played(run, task))
    points = [point(*key, results) for key, results in found.items()]
    print("\n".join(table(points)))
    if parsed.out:
        standings = read_leaderboard(result_folder(RESULTS, ENV_ID, scenario.name)).standings
        with style.for_print():
            shipped = [each for each in standings if each.name in SHIPPED]
            style.save(draw(points, shipped, scenario.limits.overload_allowance), parsed.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
