"""Intervals per second on a GPU, and of PPO that stays there.

    python -m benchmarks.accelerator --most 1048576 --most-learning 65536 --json

From 1 k to 4 M lanes of ``RoughTurning-v0``: of stepping alone, with random actions that were drawn beforehand on the device, and
of all of PPO (rollouts, advantages and updates: ``train.resident``). ``--device cpu`` measures the same loops on the processor.
The accelerator is waited for after every ``INTERVALS`` intervals or every update.

The exit status is 2 if there is no GPU.
"""

import argparse
import statistics
import sys
from collections.abc import Iterator, Sequence
from itertools import cycle
from typing import Any

import torch

from benchmarks.throughput import MAIN
from benchmarks.timing import Case, measure
from train.resident.lathes import TensorLathes, lathes_on
from train.resident.ppo import Learner, Progress
from train.run import hyperparameters
from turning_env import IDS, Scenario
from turning_env.console import described, exits, print_json

LANES = tuple(1024 * 4**power for power in range(7))
INTERVALS = 16
"""Between two waits, and of a rollout."""
LEARNING: dict[str, Any] = {"rollout": INTERVALS, "epochs": 2}
BATCHES_OF_ROLLOUT = 4
"""PPO for many lanes: long batches, few epochs, as in ``benchmarks.training``."""


def stepping(lathes: TensorLathes) -> Case:
    """Random actions."""
    lathes.reset(0)
    generator = torch.Generator(lathes.device).manual_seed(0)
    shape = 2, lathes.lanes, lathes.actions
    drawn = 2.0 * torch.rand(shape, generator=generator, device=lathes.device) - 1.0
    actions = cycle(drawn)

    def step() -> None:
        for _ in range(INTERVALS):
            lathes.step(next(actions))
        lathes.wait()

    return Case(f"{lathes.device.type}, stepping", lathes.lanes, INTERVALS * lathes.lanes, step)


def learning(lathes: TensorLathes) -> Case:
    """All of PPO."""
    collected = INTERVALS * lathes.lanes
    parameters = hyperparameters("ppo", MAIN) | LEARNING | {"batch_size": collected // BATCHES_OF_ROLLOUT}
    learner = Learner(lathes, parameters, 0)
    updates: Iterator[Progress] = iter(learner.learn(sys.maxsize))

    def step() -> None:
        next(updates)
        lathes.wait()

    return Case(f"{lathes.device.type}, learning", lathes.lanes, collected, step)


@exits(RuntimeError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.accelerator",
        **described(__doc__),
    )
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cuda", help="where (default: %(default)s)")
    parser.add_argument("--most", type=int, default=LANES[-1], help="most lanes (default: %(default)s)")
    parser.add_argument(
        "--most-learning", type=int, default=LANES[-3], help="most lanes of PPO, which keeps its rollouts (default: %(default)s)"
    )
    parser.add_argument("--repeats", type=int, default=5, help="turns that every case gets (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=0.5, help="length of one turn in s (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print the median rates [intervals/s] as JSON, at the end")
    options = parser.parse_args(arguments)
    if min(options.most, options.most_learning) < LANES[0] or options.repeats < 1 or not options.seconds > 0:
        parser.error(f"--most and --most-learning must be at least {LANES[0]}, --repeats at least 1, and --seconds above 0")

    torch.set_num_threads(1)
    scenario = Scenario.load(IDS[MAIN])
    lathes_on(options.device, scenario, 1)
    if not options.json:
        print(f"{'lanes':>9}  {'stepping [intervals/s]':>34}  {'PPO [intervals/s]':>34}")
    found: list[dict[str, float]] = []
    for lanes in LANES:  # one count after the other, since the memory would not hold all of them
        if lanes > options.most:
            break
        makers = [stepping, *([learning] if lanes <= options.most_learning else [])]
        cases = [maker(lathes_on(options.device, scenario, lanes)) for maker in makers]
        rates = [[turn.rate for turn in turns] for turns in measure(cases, options.repeats, options.seconds)]
        found.append({"lanes": lanes} | dict(zip(("stepping", "ppo"), map(statistics.median, rates), strict=False)))
        if options.json:
            continue
        told = [f"{statistics.median(row):,.0f} ({min(row):,.0f} to {max(row):,.0f})" for row in rates]
        print(f"{lanes:>9}" + "".join(f"  {text:>34}" for text in told), flush=True)
    if options.json:
        print_json(found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
