"""Measure steps per second beside Gymnasium's own Pendulum.

    python -m studies.throughput
    python -m studies.throughput --repeats 5 --json

It measures processor time in one process on one thread. All cases take turns, so other load on the machine affects them equally.
Ratios are taken within a turn. Actions are random and drawn beforehand. Resets count.

The exit status is 1 if the ratio to Pendulum is below two thirds of the recorded ratio, for 1024 environments or for the
unwrapped single one.
"""

import argparse
import statistics
import sys
from collections.abc import Sequence

import gymnasium

from studies.timing import BATCHES, Case, judge, many, measure, one
from turning_env import FAMILY_ID, IDS, FamilyVectorEnv, RoughTurningVectorEnv
from turning_env.console import described, exits

PEER = "Pendulum-v1"
MAIN = "RoughTurning-v0"
RECORDED = {"single": 2.05, "batch": 32.4}
"""Recorded ratios to Pendulum's rate in the same run, on the machine of docs/peers.md."""
MIN_SHARE = 2.0 / 3.0
"""Smallest share of the recorded ratios; noise alone does not go below it."""


def single(env_id: str) -> Case:
    """Return the case of one environment without wrappers."""
    return one(f"{env_id}, single", gymnasium.make(env_id).unwrapped)


def vector(env_id: str, num_envs: int, batches: int = BATCHES, threads: int = 1) -> Case:
    """Return the case of many environments in one batch."""
    if env_id == FAMILY_ID:
        env: RoughTurningVectorEnv = FamilyVectorEnv(num_envs, threads=threads)
    else:
        env = RoughTurningVectorEnv(num_envs, IDS[env_id], threads=threads)
    env.reset(seed=0)
    return many(f"{env_id}, {num_envs} environments", env, num_envs, env.single_action_space, batches)


@exits(checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.throughput", **described(__doc__))
    parser.add_argument("--repeats", type=int, default=9, help="turns that every case gets (default: %(default)s)")
    parser.add_argument("--num-envs", type=int, default=1024, help="size of the vector environments (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=0.25, help="length of one turn in s (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print the medians as JSON")
    options = parser.parse_args(arguments)
    if options.repeats < 1 or options.num_envs < 1 or not options.seconds > 0:
        parser.error("--repeats and --num-envs must be at least 1, and --seconds above 0")

    cases = [single(PEER), single(MAIN), *(vector(env_id, options.num_envs) for env_id in (*IDS, FAMILY_ID))]
    measured = [[turn.cpu_rate for turn in turns] for turns in measure(cases, options.repeats, options.seconds)]
    ratios = [[rate / peer for rate, peer in zip(row, measured[0], strict=True)] for row in measured]

    if not options.json:
        _print(cases, measured, ratios, options.repeats)

    found = {"single": statistics.median(ratios[1]), "batch": statistics.median(ratios[2 + list(IDS).index(MAIN)])}
    names = {"single": f"one {MAIN}", "batch": f"{options.num_envs} environments of {MAIN}"}
    verdicts = [
        (
            f"{names[key]}: {found[key]:.2f} times {PEER}'s steps per second, at least {MIN_SHARE * recorded:.2f}",
            found[key] >= MIN_SHARE * recorded,
        )
        for key, recorded in RECORDED.items()
    ]
    rows = [
        {"case": case.name, "steps_per_cpu_second": statistics.median(row), "ratio": statistics.median(ratio)}
        for case, row, ratio in zip(cases, measured, ratios, strict=True)
    ]
    return judge(verdicts, {"cases": rows} if options.json else None)


def _print(cases: Sequence[Case], rates: list[list[float]], ratios: list[list[float]], repeats: int) -> None:
    width = max(len(case.name) for case in cases)
    print(f"{'medians of ' + str(repeats) + ' turns (range)':<{width}}  {'steps per second':>33}  {'x ' + PEER:>25}")
    for case, row, ratio in zip(cases, rates, ratios, strict=True):
        speed = f"{statistics.median(row):,.0f} ({min(row):,.0f} to {max(row):,.0f})"
        print(f"{case.name:<{width}}  {speed:>33}  {statistics.median(ratio):>9.2f} ({min(ratio):.2f} to {max(ratio):.2f})")


if __name__ == "__main__":
    sys.exit(main())
