"""Run a command of the leaderboard; ``python -m leaderboard COMMAND --help`` explains it."""

import sys
from collections.abc import Sequence

from leaderboard import game, score_command
from turning_env.console import Parser

WHEEL_COMMANDS = {"score": score_command.add_to, "play": game.add_to}
"""Commands that need no package beside those of the wheel and its extras."""
OTHER_COMMANDS = "Others, such as run and show, need a clone: pip install -e '.[benchmark]'"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    if not words or words[0] not in WHEEL_COMMANDS:
        try:
            from leaderboard.commands import main as run_other
        except ModuleNotFoundError:
            # Help on the wheel's commands needs no package of the others.
            if words and words[0] not in ("-h", "--help"):
                raise
        else:
            return run_other(words)
    parser = Parser(prog="python -m leaderboard", epilog=OTHER_COMMANDS)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for add_to in WHEEL_COMMANDS.values():
        add_to(commands)
    options = parser.parse_args(words)
    status: int = options.command(options)
    return status


if __name__ == "__main__":
    sys.exit(main())
