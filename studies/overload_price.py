"""Show which margin on the limits pays best at each overload price.

    python -m studies.overload_price
    python -m studies.overload_price --seeds 16 --json

The rescaled grid search plays tuning seeds at several margins. It does not know the price. So each margin is played once, and its
returns at all prices follow from the same episodes.
"""

import argparse
import sys
from functools import partial

import numpy as np
from tqdm import tqdm

from baselines import tuned
from baselines.grid_search import RescaledGridSearch
from turning_env import Scenario
from turning_env.console import described, exits, print_json
from turning_env.scoring.play import Episodes, play
from turning_env.scoring.seeds import tuning_seeds

PRICES = (1.0, 3.0, 5.0, 10.0, 20.0, 40.0)
MARGINS = (0.85, 0.90, 0.925, 0.95, 0.975, 1.0, 1.05, 1.1)


def mean_return(episodes: Episodes, price: float) -> float:
    """Return the mean return [s] of the episodes if overload were charged at ``price`` [-]."""
    return float((episodes["return"] - episodes["reward_overload"] - price * episodes["excess"]).mean())


@exits(ValueError)
def main(arguments: list[str] | None = None) -> int:
    """Print the best margin at each price and its overload; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.overload_price", **described(__doc__))
    parser.add_argument("--seeds", type=int, default=128, help="number of tuning seeds (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print the table as JSON")
    options = parser.parse_args(arguments)
    seeds = tuning_seeds(options.seeds)
    scenario = Scenario.load("rough_turning")
    smoothing = tuned.contents(scenario)["rules"]["rescaled_grid_search"]["parameters"]["smoothing"]
    played = [
        play(partial(RescaledGridSearch, scenario, margin=margin, smoothing=smoothing), scenario, seeds)
        for margin in tqdm(MARGINS, unit="margin", disable=None)
    ]
    rows = []
    for price in PRICES:
        best = int(np.argmax([mean_return(episodes, price) for episodes in played]))
        cut = played[best]["engaged_time"].sum()
        over, severe = (float(played[best][name].sum() / cut) for name in ("overload_time", "severe_overload_time"))
        rows.append((price, MARGINS[best], mean_return(played[best], price), over, severe))
    if options.json:
        names = ("price", "best_margin", "return", "overload_share", "severe_share")
        print_json([dict(zip(names, row, strict=True)) for row in rows])
        return 0
    print(f"{'price':>6} {'best margin':>12} {'return [s]':>11} {'over limit':>11} {'over by > 5 %':>14}")
    for price, margin, score, over, severe in rows:
        print(f"{price:>6g} {margin:>12.1%} {score:>11.0f} {over:>11.1%} {severe:>14.1%}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
