"""The commands of ``python -m turning_env`` for a process engineer: calibrate, current, whatif, map, advise and family."""

import argparse
import csv
import json
import math
import sys
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from turning_env.console import FAILED, number_within, picture_path, print_json
from turning_env.files import replace_file
from turning_env.scenario import Scenario
from turning_env.scenario.family import Family
from turning_shop import WorkshopError, aligned, whatif
from turning_shop.headers import EDGE
from turning_shop.measurements import COLUMNS, read_measurements

if TYPE_CHECKING:
    from turning_shop.prediction import Evidence

MAX_CUTS = 100_000
"""Largest number of rows in a table of cuts."""


def add_commands(command: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the commands, each with its function, help and options."""
    columns = [f"  {name:<14}{column.meaning} [{column.unit}]" for name, column in COLUMNS.items()]
    columns.append(f"  {EDGE:<14}name of the cutting edge, so that its readings do not count as independent (optional)")
    _calibrate.__doc__ = (_calibrate.__doc__ or "").replace("COLUMNS", "\n    ".join(columns))
    confidence: dict[str, Any] = {"type": number_within(0.5, 0.9999, ""), "default": 0.95, "metavar": "P",
                                  "help": "confidence level of the intervals (default: %(default)s)"}  # fmt: skip
    json_option: dict[str, Any] = {"action": "store_true", "help": "print all results as JSON"}

    add = command(_calibrate, "fit the laws to cuts measured on a machine", scenario=False).add_argument
    add("measurements", metavar="SHEET", help="CSV or XLSX, one cut per row")
    add("--out", type=Path, required=True, metavar="TOML", help="scenario file to write")
    base = "preset or TOML file for everything that is not fitted (default: %(default)s)"
    add("--base", default="rough_turning", metavar="SCENARIO", help=base)
    add("--confidence", **confidence)
    add("--strict", action="store_true", help="fail if the exponent of a column cannot be estimated")
    add("--force", action="store_true", help="go on with rows and laws that cannot be true")
    add("--overwrite", action="store_true", help="replace an existing TOML file")
    add("--plot", type=picture_path, metavar="FILE", help="file for a plot of the residuals: PNG, SVG or PDF")
    add("--report", type=Path, metavar="JSON", help="file for all results")
    add("--json", **json_option)

    add = command(_current, "relate a feed motor's current to its load", scenario=False).add_argument
    add("measurements", metavar="CSV", help="one sample per row")
    cutoff = "cut-off frequency of the low-pass [Hz] (default: twice that of the peak)"
    add("--cutoff", type=number_within(1e-6, 1e6, "Hz"), metavar="F", help=cutoff)
    add("--confidence", **confidence)
    add("--json", **json_option)

    table = command(_whatif, "predict force, power, wear and tool life")
    several: dict[str, Any] = {"nargs": "+", "metavar": "X"}
    for option, column, default in (
        ("--cutting-speed", "cutting_speed", None),
        ("--feed", "feed", None),
        ("--depth", "depth_of_cut", "the scenario's"),
        ("--hardness", "hardness", "1"),
    ):
        text = f"numbers or LOW:HIGH:STEP [{COLUMNS[column].unit}]" + (f" (default: {default})" if default else "")
        table.add_argument(option, type=_numbers(column), required=default is None, help=text, **several)
    age = table.add_mutually_exclusive_group(required=True)
    age.add_argument("--time", type=_numbers("time"), help="cutting time since the edge was fresh [min]", **several)
    age.add_argument("--wear", type=_numbers("wear"), help="flank wear of the edge [mm]", **several)
    form = table.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print JSON")
    form.add_argument("--csv", action="store_true", help="print CSV")

    add = command(_map, "draw the operating map of a worn edge").add_argument
    add("--wear", type=_number("wear"), required=True, metavar="X", help="flank wear of the edge [mm]")
    add("--depth", type=_number("depth_of_cut"), metavar="X", help="depth of cut [mm] (default: the scenario's)")
    add("--hardness", type=_number("hardness"), default=1.0, metavar="X", help="hardness over nominal [-] (default: 1)")
    add("--out", type=picture_path, required=True, metavar="FILE", help="picture to write: PNG, SVG or PDF, by its suffix")

    add = command(_advise, "advise speed, feed and edge changes, in parts and money").add_argument
    agent = "ONNX file or module:object to compare with fixed parameters; may be repeated"
    add("--agent", action="append", default=[], metavar="POLICY", help=agent)
    add("--rule", metavar="NAME", help="rule of a clone to compare (default: the best that ships)")
    hours = "hours of work in a year (default: %(default)s)"
    add("--hours", type=number_within(1, 8760, "h"), default=2000.0, metavar="H", help=hours)
    add("--seeds", type=_count, default=16, metavar="N", help="edges to play with each policy; 0: none (default: 16)")
    add("--sheet", type=picture_path, metavar="FILE", help="page to pin to the machine: PDF, PNG or SVG")
    add("--page", type=Path, metavar="HTML", help="offline page with sliders for settings and prices")
    add("--json", **json_option)

    add = command(_family, "print or draw jobs of a family", scenario=False).add_argument
    add("family", metavar="FAMILY", help="family (shop), or its TOML file")
    add("--split", default="train", help="split of its jobs (default: %(default)s)")
    add("--jobs", type=int, default=12, metavar="N", help="number of jobs (default: %(default)s)")
    add("--figure", type=picture_path, metavar="FILE", help="picture of their operating maps: PNG, SVG or PDF")


def _number(column: str) -> Callable[[str], float]:
    """Return an argparse type for one number within a column's range."""
    return number_within(COLUMNS[column].low, COLUMNS[column].high, COLUMNS[column].unit)


def _numbers(column: str) -> Callable[[str], list[float]]:
    """Return an argparse type for a number, or ``LOW:HIGH:STEP``, within a column's range."""
    one = _number(column)

    def parse(text: str) -> list[float]:
        if ":" not in text:
            return [one(text)]
        try:
            low, high, step = (float(part) for part in text.split(":"))
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is neither a number nor LOW:HIGH:STEP") from None
        if not (0 < step < math.inf and low <= high):
            raise argparse.ArgumentTypeError(f"{text!r} must go up: LOW:HIGH:STEP with a step above 0")
        one(str(low)), one(str(high))
        count = (high - low) / step * (1 + 1e-9) + 1
        if count > MAX_CUTS:
            raise argparse.ArgumentTypeError(f"{text!r} are more than {MAX_CUTS} numbers")
        # Rounded, so that 0.1:0.3:0.1 does not give 0.30000000000000004.
        return [round(low + index * step, 12) for index in range(int(count))]

    return parse


def _count(text: str) -> int:
    """Return a number of edges to play, as an argparse type: 0, or 2 or more."""
    if not text.isascii() or not text.isdigit() or int(text) == 1 or int(text) > 10_000:
        raise argparse.ArgumentTypeError(f"{text!r} is not allowed: 0, or 2 to 10000")
    return int(text)


def _calibrate(options: argparse.Namespace) -> int:
    """Fit the laws of wear, thrust force and power to measured cuts, and write a scenario with them.

    The sheet has one cut per row and the columns below. Cells may be empty. A row is used for every law whose columns it fills.
    Symbols such as vc, f and ap, German names and units in brackets are understood. Status 1: rows or laws cannot be true.

    COLUMNS

    python -m turning_env calibrate cuts.csv --out my_tool.toml --plot residuals.png
    """
    from turning_shop.calibrate import Implausible, calibrate, report, summary, write_scenario

    if options.plot:  # before anything is written, as Matplotlib may be missing
        from turning_render import plot_style
        from turning_shop import plots
    if options.out.exists() and not options.overwrite:
        raise WorkshopError(f"{options.out} exists; --overwrite replaces it")
    base = Scenario.load(options.base)
    try:
        found = calibrate(read_measurements(options.measurements), base, options.confidence, options.strict, options.force)
    except Implausible as error:
        print(*(f"implausible: {problem}" for problem in error.problems), sep="\n", file=sys.stderr)
        print("error: nothing was written: correct the rows above; --force goes on with them", file=sys.stderr)
        return FAILED
    write_scenario(found, options.base, Path(options.measurements).name, options.out)
    if options.plot:
        plot_style.save(plots.draw_residuals(found), options.plot)
    results = json.dumps(report(found, options.measurements, options.base), indent=1, allow_nan=False)
    if options.report:
        replace_file(options.report, lambda partial: partial.write_text(results + "\n", "utf-8"))
    for warning in (*found.problems, *found.warnings):
        print(f"warning: {warning}", file=sys.stderr)
    if options.json:
        print(results)
    else:
        print(*summary(found), sep="\n")
        print(*(path for path in (options.out, options.plot, options.report) if path), sep="\n")
    return 0


def _current(options: argparse.Namespace) -> int:
    """Relate the current of a feed motor to its load, so that the current can replace a force sensor.

    The CSV has one sample per row: time [s], current [A] of one phase or its amplitude, and torque [N m] or thrust_force [N].
    Sample at a constant rate and feed velocity. Hold each load for a second or more, and write the value that was set.

    python -m turning_env current docs/examples/current.csv
    """
    from turning_shop.current import CURRENT_COLUMNS, CURRENT_REQUIRED, analyse_sheet

    sheet = read_measurements(options.measurements, CURRENT_COLUMNS, CURRENT_REQUIRED)
    found = analyse_sheet(sheet, options.cutoff, options.confidence)
    if options.json:
        print_json(asdict(found))
    else:
        print(*found.summary(), sep="\n")
    return 0


def _whatif(options: argparse.Namespace) -> int:
    """Print a table of cuts, one row for every combination of the listed values.

    Fitted laws give 95 % intervals for an edge that was not measured; a star marks cuts beyond what was measured. The table
    assumes that speed, feed and depth have been constant since the edge was fresh.

    python -m turning_env whatif rough_turning --cutting-speed 120 150 180 --feed 0.2:0.4:0.1 --wear 0.2
    """
    from turning_shop.prediction import predict

    scenario = Scenario.load(options.scenario)
    machine, ages = scenario.machine, options.time or options.wear
    depths, hardnesses = options.depth or [[scenario.workpiece.depth_of_cut]], options.hardness or [[1.0]]
    lists = (depths, hardnesses, ages, options.cutting_speed, options.feed)
    axes = [[value for values in each for value in values] for each in lists]
    if (rows := math.prod(len(axis) for axis in axes)) > MAX_CUTS:
        raise WorkshopError(f"these are {rows} cuts, but a table may have {MAX_CUTS}: take larger steps")
    for option, unit, values, low, high in (
        ("--cutting-speed", "m/min", axes[3], machine.cutting_speed_min, machine.cutting_speed_max),
        ("--feed", "mm/rev", axes[4], machine.feed_min, machine.feed_max),
    ):
        if beyond := [value for value in values if not low <= value <= high]:
            print(f"warning: {option} {beyond[-1]:g} is outside the machine's {low:g} to {high:g} {unit}", file=sys.stderr)
    depth, hardness, age, speed, feed = np.meshgrid(*axes, indexing="ij")
    given = {"time": age} if options.time else {"wear": age}
    evidence = _warned(scenario)
    cuts = whatif.what_if(scenario, speed, feed, depth, hardness, **given)
    prediction = predict(scenario, evidence, cuts, of_wear=options.time is None) if evidence.laws else None
    if options.json:
        print_json(whatif.records(cuts, prediction))
    elif options.csv:
        records = whatif.records(cuts, prediction)
        writer = csv.DictWriter(sys.stdout, list(records[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(records)
    else:
        print(*whatif.table(cuts, prediction), sep="\n")
    return 0


def _warned(scenario: Scenario) -> "Evidence":
    """Print the warnings that travel with a scenario's fitted laws; return the evidence for these."""
    from turning_shop.prediction import read_evidence

    evidence = read_evidence(scenario)
    for warning in evidence.warnings:
        print(f"warning: {evidence.source}: {warning}", file=sys.stderr)
    return evidence


def _map(options: argparse.Namespace) -> int:
    """Draw limits, removal rate and tool life over the machine's range of cutting speed and feed.

    python -m turning_env map rough_turning --wear 0.2 --out map.png
    """
    scenario = Scenario.load(options.scenario)
    criterion = scenario.tool.wear_criterion
    if options.wear > criterion:
        raise WorkshopError(f"--wear is {options.wear:g}, but an edge is worn out at tool.wear_criterion, {criterion:g} mm")
    from turning_render import plot_style
    from turning_shop import plots

    _warned(scenario)
    plot_style.save(plots.draw_map(scenario, options.wear, options.depth, options.hardness), options.out)
    print(options.out)
    return 0


def _advise(options: argparse.Namespace) -> int:
    """Recommend speed and feed for most metal, least cost per part and the longest run, fixed and over the edge's life.

    Then play them, and what adapts to bars and edges, on the simulated lathe, and print what a year of each costs. Set
    economics.machine_rate, operator_rate, insert_price and edges_per_insert in SCENARIO to get money.

    python -m turning_env advise my_tool.toml
    python -m turning_env advise my_tool.toml --agent my_agent.onnx --hours 4000
    """
    from turning_shop.advise import advise, summary
    from turning_shop.advise_play import play_all

    scenario = Scenario.load(options.scenario)
    evidence = _warned(scenario)
    found = advise(scenario, evidence)
    if options.sheet:
        from turning_render import plot_style
        from turning_shop import plots

        plot_style.save(plots.draw_sheet(scenario, evidence, found), options.sheet)
    if options.page:
        from turning_shop.page import render

        text = render(scenario, evidence, found)
        replace_file(options.page, lambda partial: partial.write_text(text, "utf-8"))
    played = None
    if options.seeds:
        on_play = partial(print, "playing", file=sys.stderr, flush=True)
        played = play_all(scenario, found, options.agent, options.rule, options.hours, options.seeds, on_play)
    if options.json:
        print_json({"advice": [each._asdict() for each in found], "played": played})
        return 0
    print(*summary(scenario, found), sep="\n")
    if played:
        print("", *played.summary(), sep="\n")
    for path in filter(None, (options.sheet, options.page)):
        print(path)
    return 0


def _family(options: argparse.Namespace) -> int:
    """Print the first jobs of a family, and draw their operating maps.

    The last columns compare truth and nominal model at the nominal model's best set point on a half-worn edge.

    python -m turning_env family shop
    python -m turning_env family shop --split unseen_materials --figure jobs.png
    """
    family = Family.load(options.family)
    if options.jobs < 1:
        raise WorkshopError(f"--jobs is {options.jobs}, but must be at least 1")
    try:
        jobs = [family.job(number, options.split) for number in range(options.jobs)]
    except ValueError as error:
        raise WorkshopError(str(error)) from error
    rows = [
        ("job", "diameter", "depth", "power", "force", "speed", "feed", "removal", "power", "force", "wear rate"),
        ("", "[mm]", "[mm]", "[kW]", "[N]", "[m/min]", "[mm/rev]", "[cm3/min]", *["true/nominal"] * 3),
    ]
    for job in jobs:
        true, nominal, limits = job.scenario, job.scenario.nominal(), job.scenario.limits
        cut = job.cutting_speed, job.feed, true.workpiece.depth_of_cut
        wear = true.tool.wear_criterion * 0.5**nominal.material.wear.time
        power, force = (
            getattr(true.material, law)(*cut, wear=wear) / getattr(nominal.material, law)(*cut, wear=wear)
            for law in ("power", "thrust_force")
        )
        rates = [
            (each.material.wear(*cut) / each.tool.wear_criterion) ** (1.0 / each.material.wear.time) for each in (true, nominal)
        ]
        settings = f"{true.workpiece.diameter:.0f}", f"{cut[2]:.2f}", f"{limits.power:.1f}", f"{limits.thrust_force:.0f}"
        gain = f"{cut[0]:.0f}", f"{cut[1]:.3f}", f"{true.economics.reference_removal_rate:.0f}"
        rows.append((job.title, *settings, *gain, f"{power:.2f}", f"{force:.2f}", f"{rates[0] / rates[1]:.2f}"))
    print(*aligned(rows), sep="\n")
    if options.figure:
        from turning_render import plot_style
        from turning_shop import plots

        plot_style.save(plots.draw_jobs(jobs), options.figure)
        print(options.figure)
    return 0
