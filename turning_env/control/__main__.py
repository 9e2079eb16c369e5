"""Guard policies, and run them on a real control.

python -m turning_env.control shield --episodes 8
"""

import argparse
import sys
from pathlib import Path

from turning_env import IDS
from turning_env.console import described, exits, number_within, print_json
from turning_env.control import measure
from turning_env.control.shield import Settings


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return its exit status."""
    parser = argparse.ArgumentParser(prog="python -m turning_env.control", **described(__doc__))
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    guard = commands.add_parser("shield", help="measure the shield in simulation", **described(_shield.__doc__))
    guard.add_argument(
        "--episodes", type=int, default=32, metavar="N", help="held-out seeds of every task (default: %(default)s)"
    )
    guard.add_argument("--env", nargs="+", choices=IDS, default=GUARDED, metavar="ID", help="tasks (default: all but Paper-v0)")
    guard.add_argument("--agents", type=Path, default=Path("agents"), metavar="FOLDER", help="agents (default: %(default)s)")
    guard.add_argument("--target", type=number_within(0.1, 2, "-"), default=Settings.target, metavar="X",
                       help="expected load over its limit that is allowed (default: %(default)s)")  # fmt: skip
    guard.add_argument("--json", action="store_true", help="print JSON")
    guard.set_defaults(run=_shield)

    options = parser.parse_args(arguments)
    return exits(ValueError)(options.run)(options)


GUARDED = [env_id for env_id in IDS if env_id != "RoughTurning-Paper-v0"]


def _shield(options: argparse.Namespace) -> int:
    """Play uniform random actions and the best shipped agent of every task, with and without the shield.

    python -m turning_env.control shield --episodes 8
    python -m turning_env.control shield --env RoughTurning-v0 --episodes 4 --json
    """
    measured = []
    for row in measure.rows(options.env, options.episodes, options.agents, Settings(target=options.target)):
        print(f"{row.env_id}: {row.policy}{', shielded' if row.shielded else ''} played", file=sys.stderr)
        measured.append(row)
    print_json([row._asdict() for row in measured]) if options.json else print(measure.markdown(measured))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
