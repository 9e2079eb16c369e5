"""What the overload price does: which margin on the limits pays best at each price.

    python -m benchmarks.overload_price

The rescaled grid search plays tuning draws at several margins. It does not know the price, so each margin is played once, and
its return at another price follows from the same episodes.
"""

import argparse
import sys
from functools import partial

import numpy as np
from tqdm import tqdm

from baselines import tuned
from baselines.grid_search import RescaledGridSearch
from baselines.play import Episodes, play
from turning_env import Scenario
from turning_env.draws import tuning_draws

PRICES = (1.0, 3.0, 5.0, 10.0, 20.0, 40.0)
MARGINS = (0.85, 0.90, 0.925, 0.95, 0.975, 1.0, 1.05, 1.1)


def mean_return(episodes: Episodes, price: float) -> float:
    """Mean return [s] of the episodes if overload were charged at ``price``: ``excess`` is the integral that it multiplies."""
    return float((episodes["return"] - episodes["reward_overload"] - price * episodes["excess"]).mean())


def main(arguments: list[str] | None = None) -> int:
    """Print, for each price, the best margin and what it does; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.overload_price", description=__doc__.split("\n")[0])
    parser.add_argument("--draws", type=int, default=128, help="tuning draws")
    draws = tuning_draws(parser.parse_args(arguments).draws)
    scenario = Scenario.load("rough_turning")
    smoothing = tuned.parameters(scenario)["rescaled_grid_search"]["smoothing"]
    played = [
        play(partial(RescaledGridSearch, scenario, margin=margin, smoothing=smoothing), scenario, draws)
        for margin in tqdm(MARGINS, unit="margin")
    ]
    print(f"{'price':>6} {'best margin':>12} {'return [s]':>11} {'over limit':>11} {'over by > 5 %':>14}")
    for price in PRICES:
        best = int(np.argmax([mean_return(episodes, price) for episodes in played]))
        cut = played[best]["engaged_time"].sum()
        over, severe = (played[best][name].sum() / cut for name in ("overload_time", "severe_overload_time"))
        score = mean_return(played[best], price)
        print(f"{price:>6g} {MARGINS[best]:>12.1%} {score:>11.0f} {over:>11.1%} {severe:>14.1%}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
