"""Options that several commands of the leaderboard have, and what they select."""

import argparse
from pathlib import Path

from leaderboard.result import MANIFEST_FILE
from turning_env import IDS, Scenario
from turning_env.console import positive
from turning_env.scenario.arguments import refuse_family

OWN_RESULTS = Path("results")  # folder that a user's runs write to
PROJECT_RESULTS = Path("leaderboard/results")
SPLITS_ENV_ID = "RoughTurning-v0"  # the id that has splits


def chosen_scenario(options: argparse.Namespace) -> Scenario:
    """Return the scenario of the options, by default the id's own preset."""
    refuse_family(options.scenario)
    return Scenario.load(options.scenario or IDS[options.env])


def result_folders(results: Path) -> list[Path]:
    """Return the folders of results that have a manifest."""
    return sorted(path.parent for path in results.glob(f"*/*/{MANIFEST_FILE}"))


def add_results(parser: argparse.ArgumentParser) -> None:
    """Add the folder of results to a command that reads or writes a user's own."""
    parser.add_argument(
        "--results",
        type=Path,
        default=OWN_RESULTS,
        help="folder of results (default: %(default)s; the project's own are in "
        f"{PROJECT_RESULTS})",
    )


def add_project_results(parser: argparse.ArgumentParser) -> None:
    """Add the folder of results to a command that works on the project's."""
    parser.add_argument(
        "--results",
        type=Path,
        default=PROJECT_RESULTS,
        help="folder of results (default: %(default)s)",
    )


def add_agents_folder(parser: argparse.ArgumentParser) -> None:
    """Add the folder of agents' files."""
    parser.add_argument(
        "--agents",
        type=Path,
        default=Path("agents"),
        help="folder of agents' ONNX files (default: %(default)s)",
    )


def add_json(parser: argparse.ArgumentParser) -> None:
    """Add the choice of JSON as output."""
    parser.add_argument(
        "--json", action="store_true", help="print JSON with all numbers and their units"
    )


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add processes or a cluster that play."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        "--jobs", type=positive, default=1, metavar="N", help="number of processes (default: 1)"
    )
    group.add_argument(
        "--scheduler",
        metavar="URL",
        help="play on the workers of a Dask cluster, such as tcp://host:8786",
    )
