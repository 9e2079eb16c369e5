"""Tune an agent's hyperparameters, the parameters of rules, or the numbers of a load loop.

python -m train.tune agent --algorithm sac --trials 20 --total-timesteps 500000
python -m train.tune rules --scenario my_mill.toml --quick
python -m train.tune loop --family shop
"""

import sys

from train import tune_agent, tune_loop, tune_rules
from turning_env.console import Parser, described


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    words = sys.argv[1:] if arguments is None else arguments
    parser = Parser(prog="python -m train.tune", **described(__doc__))
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    tune_agent.add_to(commands)
    tune_rules.add_to(commands)
    tune_loop.add_to(commands)
    options = parser.parse_args(words)
    options.words = words
    status: int = options.command(options)
    return status


if __name__ == "__main__":
    sys.exit(main())
