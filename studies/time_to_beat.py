"""Measure how long an untrained agent trains until it beats the best tuned rule.

    python -m studies.time_to_beat --seeds 5
    python -m studies.time_to_beat --algorithm ppo --rule rescaled_grid_search --json

Every ``--every`` steps the clock stops while the agent plays the rule's tuning seeds. The agent beats the rule if its mean
return is higher and the paired 95 % bootstrap interval lies above zero. The clock starts when environments and network have
been made. Each training uses one core, and its learning rate falls as in a whole training.

The exit status is 1 if an agent never beats the rule.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from baselines import catalogue
from train import analytic_gradient, ppo
from train.actor import ActorPolicy
from train.run import Run
from train.training import SEEDS, Algorithm, new_model
from turning_env import IDS, Scenario
from turning_env.console import DONE, FAILED, described, exits, print_json
from turning_env.scoring.play import play
from turning_env.scoring.seeds import tuning_seeds
from turning_env.scoring.statistics import Bootstrap, Estimate

ENV_ID = "RoughTurning-v0"
ALGORITHMS = {module.ALGORITHM.name: module.ALGORITHM for module in (analytic_gradient, ppo)}


class Beaten(Exception):
    """The agent beats the rule: ends the training."""


class Clock(BaseCallback):
    """A callback that tests every ``every`` steps, with the clock stopped, whether the model beats the rule, and then stops."""

    def __init__(self, every: int, beats: Callable[[Any], bool], total: int, label: str) -> None:
        super().__init__()
        self.every, self.beats = every, beats
        self.seconds = 0.0
        """Time of training so far [s]."""
        self._since = time.perf_counter()
        self._asked = 0
        self._bar: Any = tqdm(total=total, unit="step", unit_scale=True, desc=label, dynamic_ncols=True, disable=None)

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        self._bar.update(self.num_timesteps - self._bar.n)
        if self.num_timesteps - self._asked >= self.every:
            self.ask()

    def ask(self) -> None:
        """Stop the clock and test."""
        self._asked = self.num_timesteps
        self.seconds += time.perf_counter() - self._since
        if self.beats(self.model):
            raise Beaten
        self._since = time.perf_counter()

    def close(self) -> None:
        """Close the progress bar."""
        self._bar.close()


def difference(ours: NDArray[np.float64], theirs: NDArray[np.float64]) -> Estimate:
    """Return the mean difference of returns on the same seeds, both of shape (seeds,) [s]."""
    replicates = Bootstrap(len(ours)).means((ours - theirs)[np.newaxis], "difference")
    return Estimate.of(float(np.mean(ours - theirs)), replicates)


def time_to_beat(algorithm: Algorithm, seed: int, rule: NDArray[np.float64], every: int, overrides: dict[str, Any]) -> float:
    """Return the training time [s] until an agent beats a rule's returns [s] on the first tuning seeds; inf if never."""
    scenario = Scenario.load(IDS[ENV_ID])
    torch.set_num_threads(1)
    with TemporaryDirectory() as folder:
        run = Run.plan(algorithm.name, ENV_ID, scenario, seed, Path(folder), "", overrides)
        saved = Path(folder) / "policy.zip"

        def beats(model: Any) -> bool:
            model.save(saved)
            agent = partial(ActorPolicy, algorithm.actor(saved).eval())
            return difference(play(agent, scenario, tuning_seeds(len(rule)))["return"], rule).low > 0.0

        clock = Clock(every, beats, run.parameters["steps"], run.label)
        try:
            model = new_model(run, algorithm)
            model.learn(run.parameters["steps"], callback=[*algorithm.callbacks(run), clock])
            clock.ask()
        except Beaten:
            return clock.seconds
        finally:
            clock.close()
    return np.inf


@exits(checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Train, print the times; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.time_to_beat", **described(__doc__))
    parser.add_argument(
        "--algorithm", choices=ALGORITHMS, default="analytic_gradient", help="algorithm of the agent (default: %(default)s)"
    )
    parser.add_argument("--rule", default="predictive", help="rule to beat (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=5, help="number of trainings (default: %(default)s)")
    parser.add_argument("--tuning-seeds", type=int, default=64, help="number of tuning seeds (default: %(default)s)")
    parser.add_argument("--every", type=int, default=500_000, help="steps between two tests of the agent (default: %(default)s)")
    parser.add_argument("--steps", type=int, help="steps of a whole training (default: those of the hyperparameters)")
    parser.add_argument("--json", action="store_true", help="print the times [s] as JSON; null for never")
    options = parser.parse_args(arguments)
    for name, most in (("seeds", SEEDS), ("tuning_seeds", 10**6), ("every", 10**12)):
        if not 1 <= (value := getattr(options, name)) <= most:
            parser.error(f"--{name.replace('_', '-')} is {value}, but must be 1 to {most}")
    scenario = Scenario.load(IDS[ENV_ID])
    try:
        rule = play(catalogue.spec(options.rule, scenario).make, scenario, tuning_seeds(options.tuning_seeds))["return"]
    except (KeyError, ValueError) as error:
        parser.error(str(error.args[0]))
    overrides = {} if options.steps is None else {"steps": options.steps}
    times = []
    for seed in range(options.seeds):
        times.append(time_to_beat(ALGORITHMS[options.algorithm], seed, rule, options.every, overrides))
        if not options.json:
            print(f"{options.algorithm}, seed {seed}: {times[-1]:.0f} s until it beats {options.rule}", flush=True)
    if options.json:
        print_json({"algorithm": options.algorithm, "rule": options.rule, "times": times, "median": statistics.median(times)})
    else:
        print(f"median {statistics.median(times):.0f} s ({min(times):.0f} to {max(times):.0f})")
    return DONE if max(times) < np.inf else FAILED


if __name__ == "__main__":
    sys.exit(main())
