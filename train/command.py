"""The command line of every algorithm."""

import argparse
import shlex
import sys
from pathlib import Path

from train.run import Run
from train.training import SEEDS, Algorithm, train
from turning_env import IDS, Scenario
from turning_env.console import described, exits

_HELP = """Train an agent by {title} for one training seed.

    {program} --seed 1
    {program} --env RoughTurning-v0 --scenario forging --seed 1 --steps 8000000

Running the same command again resumes an interrupted training, and does nothing if it is finished. Prints the path of the agent.
"""


@exits(ValueError, interrupted="interrupted: run the same command again to resume from the last checkpoint")
def main(algorithm: Algorithm, arguments: list[str] | None = None) -> int:
    """Train one agent for one training seed; returns the exit status."""
    program = f"python -m train.{algorithm.name}"
    parser = argparse.ArgumentParser(prog=program, **described(_HELP.format(title=algorithm.title, program=program)))
    parser.add_argument("--env", default="RoughTurning-v0", choices=list(IDS), help="environment id (default: %(default)s)")
    parser.add_argument("--scenario", help="preset or TOML file (default: the id's preset)")
    parser.add_argument("--seed", type=int, default=0, help="training seed (default: %(default)s)")
    parser.add_argument("--steps", type=int, help="environment steps (default: the hyperparameter file's)")
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of all runs (default: %(default)s)")
    parsed = parser.parse_args(arguments)
    if not 0 <= parsed.seed < SEEDS:
        parser.error(f"--seed is {parsed.seed}, but must be 0 to {SEEDS - 1}")
    if parsed.steps is not None and parsed.steps < 1:
        parser.error(f"--steps is {parsed.steps}, but must be at least 1")
    command = f"{program} {shlex.join(sys.argv[1:] if arguments is None else arguments)}".strip()
    scenario = Scenario.load(parsed.scenario or IDS[parsed.env])
    overrides = {} if parsed.steps is None else {"steps": parsed.steps}
    print(train(Run.plan(algorithm.name, parsed.env, scenario, parsed.seed, parsed.runs, command, overrides), algorithm))
    return 0
