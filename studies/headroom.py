"""Measure how much is left above the best agent on RoughTurning-v0, and which information is worth most.

    python -m studies.headroom
    python -m studies.headroom --seeds 8 --rows bound planner

From above: the clairvoyant bound, and the belief-state bound (``belief_bound.py``) for policies that know a bar only by its
readings. From below: the best agent that ships, and a planner with the exact filter of the bars (``exact_filter.py``). Between
them: the planner if nothing lags, and if it is told hidden states after every step. All play the same held-out seeds.
"""

import argparse
import sys
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from leaderboard.ranking import read_leaderboard
from leaderboard.result import result_folder
from leaderboard.shipped import RESULTS
from studies import belief_bound
from studies.exact_filter import HIDDEN, Planner
from turning_env import IDS, Scenario
from turning_env.console import described, exits
from turning_env.scoring.play import play
from turning_env.scoring.seeds import held_out_seeds
from turning_env.scoring.statistics import Bootstrap, Estimate

ENV_ID = "RoughTurning-v0"
Returns = NDArray[np.float64]
_LAGS = {
    "machine": ("feed_time_constant", "spindle_time_constant"),
    "sensors": ("power_time_constant", "force_time_constant"),
}


def without_lags(scenario: Scenario) -> Scenario:
    """Return the scenario with drives and sensors that follow at once."""
    values = scenario.model_dump()
    for section, names in _LAGS.items():
        values[section] |= dict.fromkeys(names, 0.0)
    return Scenario.model_validate(values)


def planned(scenario: Scenario, seeds: list[int], *told: str) -> Returns:
    """Return the planner's return [s] on each seed, told some of ``HIDDEN``."""
    return play(lambda num_envs: Planner(scenario, num_envs, told), scenario, seeds, tell=True)["return"]


def bounded(scenario: Scenario, seeds: list[int], stretch: float) -> Returns:
    """Return the belief-state bound [s] on each seed."""
    return np.array([belief_bound.bound(scenario, seed, stretch) for seed in seeds])


def shipped(seeds: list[int], name: str | None) -> Returns:
    """Return a shipped policy's return [s] on each seed, mean over training seeds; None: the best agent's.

    Raises:
        ValueError: it has not played a seed.
    """
    found = read_leaderboard(result_folder(RESULTS, ENV_ID, IDS[ENV_ID]))
    name = name or next(each.name for each in found.standings if each.kind == "agent")
    results = [each for each in found.results if found.names[each.policy.label] == name]
    places = [results[0].task.seeds.index(seed) for seed in seeds]
    returns = np.array([each.episodes["return"] for each in results])
    return np.asarray(returns[:, places].mean(axis=0))


def rows(scenario: Scenario, seeds: list[int]) -> dict[str, tuple[str, Callable[[], Returns]]]:
    """Return the rows of the table: what each is, and its returns, which take minutes."""
    told = {f"told_{name}": (f"planner, told {name}", partial(planned, scenario, seeds, name)) for name in HIDDEN}
    return {
        "clairvoyant": ("clairvoyant bound", partial(shipped, seeds, "clairvoyant")),
        "bound": ("belief-state bound", partial(bounded, scenario, seeds, 3.2)),
        "told_all": (f"planner, told {', '.join(HIDDEN)}", partial(planned, scenario, seeds, *HIDDEN)),
        **told,
        "no_lags": ("planner, nothing lags", partial(planned, without_lags(scenario), seeds)),
        "planner": ("planner", partial(planned, scenario, seeds)),
        "agent": ("best agent", partial(shipped, seeds, None)),
        "predictive": ("best rule", partial(shipped, seeds, "predictive")),
    }


@exits(ValueError)
def main(arguments: list[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.headroom", **described(__doc__))
    parser.add_argument("--seeds", type=int, default=64, help="number of held-out seeds, at most 256 (default: 64)")
    scenario = Scenario.load(IDS[ENV_ID])
    names = list(rows(scenario, []))
    which = f"{', '.join(names)} (default: all)"
    parser.add_argument("--rows", nargs="+", choices=names, default=names, metavar="ROW", help=which)
    parsed = parser.parse_args(arguments)
    if not 1 <= parsed.seeds <= 256:
        parser.error(f"--seeds is {parsed.seeds}, but must be 1 to 256")
    seeds = held_out_seeds(parsed.seeds)
    table, agent = rows(scenario, seeds), shipped(seeds, None)
    bootstrap = Bootstrap(len(seeds))
    print(f"{'':36}  {'return [s]':>10}  over the best agent [s]")
    for name in parsed.rows:
        title, measure = table[name]
        returns = measure()
        over = returns - agent
        gap = Estimate.of(float(over.mean()), bootstrap.means(over[np.newaxis], name))
        print(f"{title:36}  {returns.mean():10.1f}  {gap.value:.1f} ({gap.low:.1f} to {gap.high:.1f})", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
