"""The command ``python -m leaderboard score``."""

import argparse
from dataclasses import replace
from typing import Any, get_args

from leaderboard.adapt import place_in_module
from leaderboard.agents.sandbox import LIMITS
from leaderboard.scoring import DEFAULT_FAMILY, Split, score
from turning_env import ALL_IDS, FAMILY_ID, ScenarioError
from turning_env.console import UserError, described, exits, positive, print_json
from turning_env.scenario.arguments import environment_id


def add_to(commands: Any) -> None:
    """Add the command to the subparsers of a command line."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "score",
        help="play a policy and rank it among those that ship",
        **described(score_policy.__doc__),
    )
    parser.set_defaults(command=score_policy)
    parser.add_argument("policy", metavar="POLICY", help="ONNX file, or module:object")
    parser.add_argument(
        "--env",
        type=environment_id,
        choices=ALL_IDS,
        default="RoughTurning-v0",
        metavar="ID",
        help="environment (default: %(default)s)",
    )
    parser.add_argument(
        "--family",
        metavar="NAME",
        help=f"preset of a family, with --env {FAMILY_ID} (default: {DEFAULT_FAMILY})",
    )
    parser.add_argument(
        "--seeds",
        type=positive,
        metavar="N",
        help="number of seeds (default: those of the leaderboard; 256 for validation)",
    )
    parser.add_argument(
        "--split",
        choices=get_args(Split),
        default="held_out",
        help="validation: seeds for choices, which few policies have played (default: %(default)s)",
    )
    parser.add_argument(
        "--agent-time",
        type=positive,
        default=LIMITS.computing,
        metavar="SECONDS",
        help="processor time that an ONNX file may use for all episodes (default: %(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="print all results as JSON")


@exits(ScenarioError)
def score_policy(options: argparse.Namespace) -> int:
    """Play a policy on held-out seeds and rank it among the policies that ship.

    The score is 0 for the best fixed speed and feed, and 100 for causal, an oracle that sees the
    hidden state. Brackets hold 95 % intervals. While you develop, play the seeds of --split
    validation: they give a score, and a rank among the few policies that have played them.

    A policy is an ONNX file or an object in a module. The object may be a function of observations,
    a class with reset and act, a model of Stable-Baselines3 or a module of PyTorch. It runs in this
    process: score only code that you trust. An ONNX file may come from anywhere: it runs in a
    process of its own, which can read and write no file and has limited time and memory
    (docs/soundness.md). Its weights must be inside.

    python -m leaderboard score my_agent.onnx
    python -m leaderboard score my_agent.onnx --split validation
    python -m leaderboard score my_module:MyPolicy --env RoughTurning-Override-v1 --seeds 32
    """
    try:
        result = score(
            options.policy,
            options.env,
            seeds=options.seeds,
            family=options.family,
            limits=replace(LIMITS, computing=options.agent_time),
            split=options.split,
        )
    except (TypeError, ValueError) as error:
        place = place_in_module(error, options.policy)
        raise UserError(f"{options.policy}: {error}{place}") from error
    if options.json:
        print_json(result.numbers())
    else:
        print(result.table(), result.load(), result, sep="\n\n")
    return 0
