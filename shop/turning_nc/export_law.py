"""The command line ``python -m turning_nc.export_law``: override laws as programs for a control.

It writes nothing unless the program reads back equal and acts as its controller.
"""

import argparse
import inspect
import json
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from turning_nc import law_programs
from turning_nc.program import Program, read, read_file, write
from turning_nc.simulate import compare, simulate
from turning_nc.words import NcError

from baselines import catalogue
from turning_env import Scenario
from turning_env.console import described, exits
from turning_env.files import replace_file
from turning_env.scoring.seeds import tuning_seeds

PROGRAM = "python -m turning_nc.export_law"

# Largest relative difference of removed metal, time and wear between law and controller.
MAX_DIFFERENCE = 0.02

# Largest difference between a law read back and its controller [percentage points of override].
MAX_OVERRIDE_DIFFERENCE = 0.5
REVIEW = (
    "Tool, zero offset, clamping, retraction, coolant, limits and every value must be checked by "
    "whoever is responsible for the machine."
)
CAUTION = f"Simulation output: not for a machine without review. {REVIEW}"
ABOUT = (
    "Write a controller as a part program for a SINUMERIK lathe, read it back and play it. "
    f"{CAUTION}"
)
Options = argparse.Namespace


@exits(KeyError, ValueError, interrupted="interrupted: nothing was written")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    if arguments is None:
        arguments = sys.argv[1:]
    options = _parser().parse_args(arguments)
    options.command = f"{PROGRAM} {shlex.join(arguments)}"
    if options.tuning_seed < 0:
        raise NcError(f"--tuning-seed is {options.tuning_seed}, but must be 0 or more")
    seeds = tuning_seeds(options.tuning_seed + 1)
    options.seed = seeds[-1]
    summary: dict[str, Any] = options.run(options)
    if options.json:
        print(json.dumps(summary))
    else:
        print(_lines(summary))
    return 0


# Arguments.


def _parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    examples = "\n".join(_help_of(run)[1] for run in (_law, _check))
    parser = argparse.ArgumentParser(prog=PROGRAM, **described(f"{ABOUT}\n\n{examples}"))
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    law = _add_command(commands, "law", run=_law)
    law.add_argument(
        "--rule", required=True, metavar="NAME", help=f"one of {', '.join(law_programs.LAWS)}"
    )
    law.add_argument(
        "--out",
        required=True,
        type=Path,
        metavar="FILE",
        help="program to write, such as override.mpf",
    )
    _add_shared_arguments(law)
    check = _add_command(commands, "check", run=_check)
    check.add_argument("file", type=Path, metavar="FILE", help="the program")
    _add_shared_arguments(check)
    return parser


def _help_of(run: Callable[[Options], dict[str, Any]]) -> list[str]:
    """Return the title and the example of a command, from the docstring of its function."""
    return inspect.cleandoc(run.__doc__ or "").split("\n\n")


def _add_command(
    commands: Any, name: str, run: Callable[[Options], dict[str, Any]]
) -> argparse.ArgumentParser:
    """Add a command; return its parser."""
    title, example = _help_of(run)
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=title, **described(f"{title} {CAUTION}\n\n{example}")
    )
    parser.set_defaults(run=run)
    return parser


def _add_shared_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of both commands."""
    parser.add_argument(
        "--scenario", default="override", help="preset or TOML file (default: %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="print the summary as one line of JSON")
    parser.add_argument(
        "--tuning-seed",
        type=int,
        default=0,
        metavar="N",
        help="bar and edge of the tuning seed number N (default: %(default)s)",
    )


# Commands.


def _law(options: Options) -> dict[str, Any]:
    """Write a controller from spindle load to feed override as synchronized actions.

    python -m turning_nc.export_law law --rule modified_fuzzy_override --out override.mpf
    """
    scenario = Scenario.load(options.scenario)
    program = law_programs.law_program(options.rule, scenario)
    text = write(program, _comments(options, scenario))
    if read(text) != program:
        raise NcError("the program reads back as another: nothing was written")
    make_policy = catalogue.spec(options.rule, scenario).make
    differences, original = compare(program, make_policy, scenario=scenario, seed=options.seed)
    simulated = simulate(program, scenario, options.seed)
    largest = max(differences)
    difference = simulated.difference(original)
    if not (largest <= MAX_OVERRIDE_DIFFERENCE and difference <= MAX_DIFFERENCE):
        raise NcError(
            f"nothing written: the law's override differs from that of {options.rule} "
            f"by {largest:.2f} percentage points, its totals by {100.0 * difference:.1f} %; "
            f"{MAX_OVERRIDE_DIFFERENCE} and {100.0 * MAX_DIFFERENCE:g} are allowed"
        )
    replace_file(options.out, lambda partial: partial.write_text(text, "ascii"))
    return {
        "path": str(options.out),
        **_counts(program),
        "steps": len(differences),
        "mean_override_difference": sum(differences) / len(differences),
        "largest_override_difference": largest,
        "original": asdict(original),
        "simulated": asdict(simulated),
        "largest_difference": difference,
    }


def _comments(options: Options, scenario: Scenario) -> list[str]:
    """Return comments that say how a program was made, and what its law measures."""
    load = "spindle torque over the torque available at its speed"
    if scenario.spindle.reading == "power":
        load = f"spindle power over {scenario.machine.rated_power:g} kW"
    interval = 1000.0 * scenario.control.interval
    return [
        REVIEW,
        f"made by rough-turning {version('rough-turning')}: {options.command}",
        f"feed override of {options.rule} on scenario {scenario.name}",
        f"$AA_LOAD[S1] is taken for {load}, in per cent; "
        f"the law is made for an interpolation cycle of {interval:g} ms",
    ]


def _check(options: Options) -> dict[str, Any]:
    """Read a program of one cut under an override law, and play it on a bar.

    python -m turning_nc.export_law check override.mpf --tuning-seed 1
    """
    program = read_file(options.file)
    totals = simulate(program, Scenario.load(options.scenario), options.seed)
    return {"path": str(options.file), **_counts(program), "simulated": asdict(totals)}


def _counts(program: Program) -> dict[str, int]:
    """Return the numbers of polynomials and actions of a program's law."""
    return {"polynomials": len(program.law.polynomials), "actions": len(program.law.actions)}


# Text.


def _lines(summary: dict[str, Any]) -> str:
    """Return a summary as lines of text."""
    polynomials = _counted(summary["polynomials"], "polynomial")
    actions = _counted(summary["actions"], "action")
    lines = [f"{summary['path']}: {polynomials}, {actions}"]
    if "steps" in summary:
        largest = summary["largest_override_difference"]
        mean = summary["mean_override_difference"]
        lines.append(
            f"override: at most {largest:.3f} percentage points off the controller, "
            f"mean {mean:.3f} over {summary['steps']} steps"
        )
    if "original" in summary:
        lines.append(_totals("original", summary["original"]))
    lines.append(_totals("read back and played", summary["simulated"]))
    if "largest_difference" in summary:
        lines.append(f"largest difference: {100.0 * summary['largest_difference']:.3f} %")
    return "\n".join(lines)


def _counted(number: int, word: str) -> str:
    return f"{number} {word}" if number == 1 else f"{number} {word}s"


def _totals(name: str, totals: dict[str, float]) -> str:
    """Return the totals of an episode as a line of text."""
    return (
        f"{name}: {totals['removed']:.2f} cm3 removed in {totals['time']:.3f} min, "
        f"wear {totals['wear']:.4f} mm"
    )


if __name__ == "__main__":
    sys.exit(main())
