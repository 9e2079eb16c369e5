"""The command line of every algorithm."""

import argparse
import shlex
import sys
from pathlib import Path

from train.run import Run
from train.training import SEEDS, Algorithm, train
from turning_env import IDS, Scenario


def main(algorithm: Algorithm, arguments: list[str] | None = None) -> int:
    """Train one agent for one training seed; returns the exit status."""
    program = f"python -m train.{algorithm.name}"
    parser = argparse.ArgumentParser(prog=program, description=f"Train a {algorithm.title} agent.")
    parser.add_argument("--env", default="RoughTurning-v0", choices=list(IDS), help="environment id")
    parser.add_argument("--scenario", help="preset or TOML file (default: the id's preset)")
    parser.add_argument("--seed", type=int, default=0, help="training seed")
    parser.add_argument("--intervals", type=int, help="environment steps (default: the hyperparameter file's)")
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of all runs")
    parsed = parser.parse_args(arguments)
    if not 0 <= parsed.seed < SEEDS:
        parser.error(f"--seed is {parsed.seed}, but must be 0 to {SEEDS - 1}")
    if parsed.intervals is not None and parsed.intervals < 1:
        parser.error(f"--intervals is {parsed.intervals}, but must be at least 1")
    command = f"{program} {shlex.join(sys.argv[1:] if arguments is None else arguments)}".strip()
    try:
        scenario = Scenario.load(parsed.scenario or IDS[parsed.env])
        overrides = {} if parsed.intervals is None else {"intervals": parsed.intervals}
        path = train(Run.plan(algorithm.name, parsed.env, scenario, parsed.seed, parsed.runs, command, overrides), algorithm)
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted: run the same command again to resume from the last checkpoint", file=sys.stderr)
        return 130
    print(path)
    return 0
