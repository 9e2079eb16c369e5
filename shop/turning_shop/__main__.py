"""Advise cuts, fit laws to measured ones, and play part programs.

python -m turning_shop advise --material 42CrMo4 --tool CNMG120408-PM --grade P25 --stock 80x200
python -m turning_shop calibrate cuts.csv --out my_tool.toml --base machine.toml
python -m turning_shop program part.mpf --scenario my_tool.toml --stock bar:80x120+1
"""

import argparse
from collections.abc import Callable

from turning_shop import command as commands_of_shop

from turning_env.console import Parser, described, exits
from turning_env.scenario import ScenarioError


@exits(ScenarioError)
def main(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit status."""
    # The command line stands above the packages of the shop, so that `program` is found here.
    from turning_nc import command as commands_of_programs

    parser = Parser(prog="python -m turning_shop", **described(__doc__))
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    def command(
        run: Callable[[argparse.Namespace], int], summary: str, scenario: bool = True
    ) -> argparse.ArgumentParser:
        """Add a command, which is called like the function that runs it."""
        name = run.__name__.removeprefix("_")
        added = commands.add_parser(name, help=summary, **described(run.__doc__))
        added.set_defaults(run=run)
        if scenario:
            added.add_argument("scenario", metavar="SCENARIO", help="preset or TOML file")
        return added

    commands_of_shop.add_commands(command)
    commands_of_programs.add_commands(command)
    options = parser.parse_args(arguments)
    status: int = options.run(options)
    return status


if __name__ == "__main__":
    raise SystemExit(main())
