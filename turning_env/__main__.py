"""Show scenarios, play by hand and score policies; other packages add their commands."""

import argparse
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import get_args

import gymnasium
import numpy as np

from turning_env import ALL_IDS, FAMILY_ID, score
from turning_env.console import Parser, UserError, described, exits, positive, print_json
from turning_env.extras import provided
from turning_env.scenario import Scenario, ScenarioError, presets
from turning_env.scenario.arguments import environment_id
from turning_env.scoring.adapt import place_in_module
from turning_env.scoring.sandbox import LIMITS
from turning_env.scoring.score import DEFAULT_FAMILY, Split


@exits(ScenarioError)
def main(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit status."""
    parser = Parser(prog="python -m turning_env", **described(__doc__))
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    def command(
        run: Callable[[argparse.Namespace], int], summary: str, scenario: bool = True
    ) -> argparse.ArgumentParser:
        """Add a command, which is called like the function that runs it."""
        name = run.__name__.removeprefix("_").replace("_", "-")
        added = commands.add_parser(name, help=summary, **described(run.__doc__))
        added.set_defaults(run=run)
        if scenario:
            added.add_argument("scenario", metavar="SCENARIO", help="preset or TOML file")
        # The command's first example joins those of the whole command line.
        _, *lines = (added.epilog or "").splitlines()
        # An example goes on where a line ends in a backslash.
        length = 1
        while lines[length - 1].endswith("\\"):
            length += 1
        parser.epilog = "\n".join([parser.epilog or "examples:", *lines[:length]])
        return added

    command(_presets, "print the names of the presets", scenario=False)
    command(_show, "print all values of a preset or a TOML file")
    command(_schema, "print the JSON schema of a scenario file", scenario=False)
    # Other packages, such as the shop, have commands of their own.
    for add_commands in provided("commands"):
        add_commands(command)
    _add_score_options(
        command(_score, "play a policy and rank it among those that ship", scenario=False)
    )
    command(_warm_up, "compile everything now, for example for a container image", scenario=False)

    options = parser.parse_args(arguments)
    status: int = options.run(options)
    return status


def _add_score_options(parser: argparse.ArgumentParser) -> None:
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
        help="validation: seeds for choices, with a score and no rank (default: %(default)s)",
    )
    parser.add_argument(
        "--agent-time",
        type=positive,
        default=LIMITS.computing,
        metavar="SECONDS",
        help="processor time that an ONNX file may use for all episodes (default: %(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="print all results as JSON")


def _presets(_: argparse.Namespace) -> int:
    """Print the names of the presets, one per line.

    python -m turning_env presets
    """
    print("\n".join(presets()))
    return 0


def _show(options: argparse.Namespace) -> int:
    """Print every value of a scenario as TOML. This also checks a TOML file.

    python -m turning_env show forging
    """
    print(Scenario.load(options.scenario).to_toml(), end="")
    return 0


def _schema(_: argparse.Namespace) -> int:
    """Print the JSON schema of a scenario file: every field with its unit, default and range.

    python -m turning_env schema
    """
    schema = Scenario.model_json_schema()
    # Files may have these two keys, which are no fields of a scenario.
    schema["properties"]["calibration"] = {
        "type": "object",
        "description": "How the laws were measured; calibrate writes it.",
    }
    schema["properties"]["base"] = {
        "anyOf": [{"enum": list(presets())}, {"type": "string", "pattern": r"\.toml$"}],
        "description": (
            "The preset, or the TOML file seen from this one's folder, whose values the file "
            "changes."
        ),
    }
    print_json(schema)
    return 0


def _score(options: argparse.Namespace) -> int:
    """Play a policy on held-out seeds and rank it among the policies that ship.

    The score is 0 for the best fixed speed and feed, and 100 for causal, an oracle that sees the
    hidden state. Brackets hold 95 % intervals. While you develop, play the seeds of --split
    validation, which have a score but no ranking.

    A policy is an ONNX file or an object in a module. The object may be a function of observations,
    a class with reset and act, a model of Stable-Baselines3 or a module of PyTorch. It runs in this
    process: score only code that you trust. An ONNX file may come from anywhere: it runs in a
    process of its own, which can read and write no file and has limited time and memory
    (docs/soundness.md). Its weights must be inside.

    python -m turning_env score my_agent.onnx
    python -m turning_env score my_agent.onnx --split validation
    python -m turning_env score my_module:MyPolicy --env RoughTurning-Override-v1 --seeds 32
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
        values = asdict(result)
        del values["episodes"]
        print_json(values)
    else:
        print(result.table(), result.load(), result, sep="\n\n")
    return 0


def _warm_up(_: argparse.Namespace) -> int:
    """Compile everything that environments, batches, rules, windows and readings of arrays call.

    It prints where the machine code is kept. Run it when you build a container image, or before you
    start many processes that cannot write to the folder: the package's own, or the user's cache
    folder if the package's is read-only. Set NUMBA_CACHE_DIR to use another folder, then and later.

    python -m turning_env warm-up
    """
    from turning_env.batch import driver
    from turning_env.numerics import functions
    from turning_env.numerics.compilation import machine_code_folder
    from turning_env.rendering import fields

    for env_id in ALL_IDS:
        for mode in ("sync", "vector_entry_point"):
            envs = gymnasium.make_vec(env_id, 2, vectorization_mode=mode)
            envs.reset(seed=0)
            envs.step(envs.action_space.sample())
            envs.close()
    fields.warm_up()
    for function in (functions.exp, functions.expm1, functions.log):
        function(np.ones(1))
    # Other packages, such as the rules, have compiled functions of their own.
    for warm_up in provided("warm_ups"):
        warm_up()
    files = (driver.__file__, fields.__file__, functions.__file__)
    sources = [Path(str(file)).parent for file in files]
    folders = [folder for folder in map(machine_code_folder, sources) if folder]
    for folder in folders:
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        print(f"{size / 1e6:.1f} MB of machine code in {folder}")
    if not folders:
        raise UserError(
            "no machine code could be kept on disk: "
            "set NUMBA_CACHE_DIR to a folder that you can write"
        )
    print("set NUMBA_CACHE_DIR to use another folder")
    return 0


if __name__ == "__main__":
    sys.exit(main())
