"""Run a command of the leaderboard; ``python -m leaderboard COMMAND --help`` explains it."""

import sys
from collections.abc import Sequence

from leaderboard import game, score_command
from turning_env.console import Parser

WHEEL_COMMANDS = {"score": score_command.add_to, "play": game.add_to}
"""Commands that need no package beside those of the wheel and its extras."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    if not words or words[0] not in WHEEL_COMMANDS:
        from leaderboard.commands import main as run_other

        return run_other(words)
    parser = Parser(prog="python -m leaderboard")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    WHEEL_COMMANDS[words[0]](commands)
    options = parser.parse_args(words)
    status: int = options.command(options)
    return status


if __name__ == "__main__":
    sys.exit(main())
