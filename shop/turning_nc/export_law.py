"""The command line ``python -m turning_nc.export_law``: override laws of controllers as programs for a lathe's control."""

import argparse
import inspect
import json
import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

from turning_nc import law_programs
from turning_nc.program import read, read_file, write
from turning_nc.simulate import compare, simulate
from turning_nc.words import NcError

from baselines import catalogue
from turning_env import Scenario
from turning_env.console import described, exits
from turning_env.files import replace_file
from turning_env.scoring.seeds import tuning_seeds

PROGRAM = "python -m turning_nc.export_law"
MAX_DIFFERENCE = (
    0.02  # largest relative difference of removed metal, time and wear between law and controller
)
MAX_OVERRIDE_DIFFERENCE = 0.5  # largest difference between a law read back and its controller [percentage points of override]
REVIEW = (
    "Tool, zero offset, clamping, retraction, coolant, limits and every value must be checked by whoever is responsible for the "
    "machine."
)
CAUTION = f"Simulation output: not for a machine without review. {REVIEW}"
Options = argparse.Namespace


@exits(KeyError, ValueError, interrupted="interrupted: nothing was written")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    about = f"Write a controller as a part program for a SINUMERIK lathe, read it back and play it. {CAUTION}"
    texts = {run: inspect.cleandoc(run.__doc__ or "").split("\n\n") for run in (_law, _check)}
    examples = "\n".join(example for _, example in texts.values())
    parser = argparse.ArgumentParser(prog=PROGRAM, **described(f"{about}\n\n{examples}"))
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for run, (title, example) in texts.items():
        added = commands.add_parser(
            run.__name__[1:], help=title, **described(f"{title} {CAUTION}\n\n{example}")
        )
        added.set_defaults(run=run)
        if run is _law:
            added.add_argument(
                "--rule",
                required=True,
                metavar="NAME",
                help=f"one of {', '.join(law_programs.LAWS)}",
            )
            added.add_argument(
                "--out",
                required=True,
                type=Path,
                metavar="FILE",
                help="program to write, such as override.mpf",
            )
        else:
            added.add_argument("file", type=Path, metavar="FILE", help="the program")
        added.add_argument(
            "--scenario", default="override", help="preset or TOML file (default: %(default)s)"
        )
        added.add_argument(
            "--json", action="store_true", help="print the summary as one line of JSON"
        )
        help_ = "bar and edge of the tuning seed number N (default: %(default)s)"
        added.add_argument("--tuning-seed", type=int, default=0, metavar="N", help=help_)
    options = parser.parse_args(arguments)
    options.command = f"{PROGRAM} {shlex.join(arguments)}"
    if options.tuning_seed < 0:
        raise NcError(f"--tuning-seed is {options.tuning_seed}, but must be 0 or more")
    options.seed = tuning_seeds(options.tuning_seed + 1)[-1]
    done: dict[str, Any] = options.run(options)
    print(json.dumps(done) if options.json else _lines(done))
    return 0


def _law(options: Options) -> dict[str, Any]:
    """Write a controller from spindle load to feed override as synchronized actions.

    python -m turning_nc.export_law law --rule modified_fuzzy_override --out override.mpf
    """
    scenario = Scenario.load(options.scenario)
    program = law_programs.law_program(options.rule, scenario)
    by_power = f"spindle power over {scenario.machine.rated_power:g} kW"
    load = (
        by_power
        if scenario.spindle.reading == "power"
        else "spindle torque over the torque available at its speed"
    )
    comments = (
        REVIEW,
        f"made by rough-turning {version('rough-turning')}: {options.command}",
        f"feed override of {options.rule} on scenario {scenario.name}",
        f"$AA_LOAD[S1] is taken for {load}, in per cent; the law is made for an interpolation "
        f"cycle of {1000.0 * scenario.control.interval:g} ms",
    )
    text = write(program, comments)
    if read(text) != program:
        raise NcError("the program reads back as another: nothing was written")
    make = catalogue.spec(options.rule, scenario).make
    differences, original = compare(program, make, scenario, options.seed)
    simulated, largest = simulate(program, scenario, options.seed), max(differences)
    difference = simulated.difference(original)
    if not (largest <= MAX_OVERRIDE_DIFFERENCE and difference <= MAX_DIFFERENCE):
        raise NcError(
            f"nothing written: the law's override differs from that of {options.rule} by {largest:.2f} percentage points, "
            f"its totals by {100.0 * difference:.1f} %; {MAX_OVERRIDE_DIFFERENCE} and {100.0 * MAX_DIFFERENCE:g} are allowed"
        )
    replace_file(options.out, lambda partial: partial.write_text(text, "ascii"))
    return {
        "path": str(options.out),
        "polynomials": len(program.law.polynomials),
        "actions": len(program.law.actions),
        "steps": len(differences),
        "mean_override_difference": sum(differences) / len(differences),
        "largest_override_difference": largest,
        "original": asdict(original),
        "simulated": asdict(simulated),
        "largest_difference": difference,
    }


def _check(options: Options) -> dict[str, Any]:
    """Read a program of one cut under an override law, and play it on a bar.

    python -m turning_nc.export_law check override.mpf --tuning-seed 1
    """
    program = read_file(options.file)
    totals = simulate(program, Scenario.load(options.scenario), options.seed)
    counts = {"polynomials": len(program.law.polynomials), "actions": len(program.law.actions)}
    return {"path": str(options.file), **counts, "simulated": asdict(totals)}


def _lines(done: dict[str, Any]) -> str:
    counts = (
        f"{done[name]} {name if done[name] != 1 else name.removesuffix('s')}"
        for name in ("polynomials", "actions")
    )
    lines = [f"{done['path']}: {', '.join(counts)}"]
    if "steps" in done:
        largest, mean = done["largest_override_difference"], done["mean_override_difference"]
        lines.append(
            f"override: at most {largest:.3f} percentage points off the controller, mean {mean:.3f} over {done['steps']} steps"
        )
    for name, of in (("original", "original"), ("simulated", "read back and played")):
        if name in done:
            totals = done[name]
            lines.append(
                f"{of}: {totals['removed']:.2f} cm3 removed in {totals['time']:.3f} min, wear {totals['wear']:.4f} mm"
            )
    if "largest_difference" in done:
        lines.append(f"largest difference: {100.0 * done['largest_difference']:.3f} %")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
