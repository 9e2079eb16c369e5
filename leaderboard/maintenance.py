"""Commands with which maintainers publish results: ``pack``, ``cards`` and ``figure``."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from leaderboard import pack, validation
from leaderboard.ranking import read_leaderboard
from leaderboard.result import RESULTS, ResultError, result_folder
from leaderboard.shared_options import (
    SPLITS_ENV_ID,
    add_agents_folder,
    add_project_results,
    add_results,
    chosen_scenario,
    result_folders,
)
from turning_env import IDS
from turning_env.console import described
from turning_env.scenario.arguments import environment_id

PICTURE = Path("docs/leaderboard.png")


def add_to(commands: Any) -> None:
    """Add the commands to the subparsers of a command line."""

    def add(command: Callable[[argparse.Namespace], None], brief: str) -> argparse.ArgumentParser:
        name = command.__name__.removeprefix("_")
        added: argparse.ArgumentParser = commands.add_parser(
            name, help=f"for maintainers: {brief}", **described(command.__doc__)
        )
        added.set_defaults(command=command)
        return added

    _add_pack_options(add(_pack, "move the results of each leaderboard into one file"))
    _add_cards_options(add(_cards, "write the model card of every agent"))
    _add_figure_options(add(_figure, "draw the ranking for print"))


def _pack(options: argparse.Namespace) -> None:
    """Move the results of each leaderboard into one file, and copy the returns into the wheel.

    ``leaderboard.score`` compares a policy with the returns in the wheel.

    python -m leaderboard pack --results results
    python -m leaderboard pack --without lagrangian_ppo
    python -m leaderboard pack --validation
    """
    folders = result_folders(options.results)
    if not folders:
        raise ResultError(f"{options.results} holds no results")
    for folder in folders:
        if pack.pack(folder, options.without):
            print(f"packed {folder}")
    if options.results.resolve() == RESULTS:
        for path in pack.write_shipped(pack.contents(RESULTS)):
            print(f"wrote {path}")
        if options.validation:
            for path in validation.write(RESULTS):
                print(f"wrote {path}", flush=True)


def _add_pack_options(parser: argparse.ArgumentParser) -> None:
    add_project_results(parser)
    parser.add_argument(
        "--without",
        nargs="+",
        default=[],
        metavar="NAME",
        help="policies whose results are deleted",
    )
    parser.add_argument(
        "--validation",
        action="store_true",
        help="also play what score compares with on validation seeds, for minutes, and copy that",
    )


def _cards(options: argparse.Namespace) -> None:
    """Write the model card of every agent in the agents' folder.

    python -m leaderboard cards --results leaderboard/results --agents agents
    """
    from leaderboard import cards  # needed only here: imports Jinja2 and ONNX

    for path in cards.write_all(options.results, options.agents):
        print(f"wrote {path}")


def _add_cards_options(parser: argparse.ArgumentParser) -> None:
    add_project_results(parser)
    add_agents_folder(parser)


def _figure(options: argparse.Namespace) -> None:
    """Draw the ranking for print, or scores over the tasks.

    python -m leaderboard figure --results leaderboard/results --out docs/leaderboard.png
    python -m leaderboard figure --aggregate --results leaderboard/results --out scores.png
    """
    from leaderboard import aggregate, figure  # needed only here: imports Matplotlib

    if options.aggregate:
        figure.write_scores(aggregate.read(options.results), options.out)
        print(f"wrote {options.out}")
        return
    folder = result_folder(options.results, options.env, chosen_scenario(options).name)
    figure.write(read_leaderboard(folder), options.out)
    print(f"wrote {options.out}")


def _add_figure_options(parser: argparse.ArgumentParser) -> None:
    add_results(parser)
    add = parser.add_argument
    add(
        "--env",
        type=environment_id,
        choices=IDS,
        default=SPLITS_ENV_ID,
        help="the environment's id (default: %(default)s)",
    )
    add("--scenario", metavar="PRESET_OR_TOML", help="scenario instead of the id's own")
    add("--aggregate", action="store_true", help="draw scores over the tasks instead")
    add(
        "--out",
        type=Path,
        default=PICTURE,
        help="picture to write (default: %(default)s)",
    )
