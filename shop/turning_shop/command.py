"""The commands of ``python -m turning_env`` for a process engineer: calibrate, whatif, map and advise."""

import argparse
import csv
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from turning_shop import WorkshopError, refuse_existing, tables, whatif
from turning_shop.headers import COLUMNS, EDGE, named_column
from turning_shop.measurements import read_measurements

from turning_env.console import FAILED, number_within, picture_path, print_json
from turning_env.files import replace_file
from turning_env.scenario import Scenario

if TYPE_CHECKING:
    from turning_shop.prediction import Evidence


def add_commands(command: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the commands, each with its function, help and options."""
    columns = [f"  {name:<14}{column.meaning} [{column.unit}]" for name, column in COLUMNS.items()]
    columns.append(
        f"  {EDGE:<14}name of the cutting edge, so that its readings do not count as independent (optional)"
    )
    _calibrate.__doc__ = (_calibrate.__doc__ or "").replace("COLUMNS", "\n    ".join(columns))
    overwrite: dict[str, Any] = {"action": "store_true", "help": "replace existing files"}

    add = command(
        _calibrate, "fit the laws to cuts measured on a machine", scenario=False
    ).add_argument
    add("measurements", metavar="SHEET", help="CSV or XLSX, one cut per row")
    add("--out", type=Path, required=True, metavar="TOML", help="scenario file to write")
    base = "preset or TOML file for everything that is not fitted (default: %(default)s)"
    add("--base", default="rough_turning", metavar="SCENARIO", help=base)
    columns_help = "header of a column where the sheet does not tell, such as Fc=Fx Ff=Fz Fp=Fy; NAME is a column or its symbol"
    add("--columns", nargs="+", type=_column, default=[], metavar="NAME=HEADER", help=columns_help)
    add("--force", action="store_true", help="go on with rows and laws that cannot be true")
    add("--overwrite", **overwrite)

    table = command(_whatif, "predict force, power, wear and tool life")
    several: dict[str, Any] = {"nargs": "+", "metavar": "X"}
    radius = number_within(0.05, 10.0, "mm")
    nose_help = "nose radius of the inserts [mm]: the feed is at most half of it (default: tool.nose_radius)"
    nose_radius: dict[str, Any] = {"type": radius, "metavar": "X", "help": nose_help}
    table.add_argument("--nose-radius", **nose_radius)
    for option, column, default in (
        ("--cutting-speed", "cutting_speed", None),
        ("--feed", "feed", None),
        ("--depth", "depth_of_cut", "the scenario's"),
        ("--hardness", "hardness", "1"),
    ):
        text = f"numbers [{COLUMNS[column].unit}]" + (f" (default: {default})" if default else "")
        table.add_argument(
            option, type=_number(column), required=default is None, help=text, **several
        )
    age = table.add_mutually_exclusive_group(required=True)
    age.add_argument(
        "--time",
        type=_number("time"),
        help="cutting time since the edge was fresh [min]",
        **several,
    )
    age.add_argument("--wear", type=_number("wear"), help="flank wear of the edge [mm]", **several)
    form = table.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print JSON")
    form.add_argument("--csv", action="store_true", help="print CSV")

    add = command(_map, "draw the operating map of a worn edge").add_argument
    add(
        "--wear",
        type=_number("wear"),
        required=True,
        metavar="X",
        help="flank wear of the edge [mm]",
    )
    add(
        "--depth",
        type=_number("depth_of_cut"),
        metavar="X",
        help="depth of cut [mm] (default: the scenario's)",
    )
    add(
        "--hardness",
        type=_number("hardness"),
        default=1.0,
        metavar="X",
        help="hardness over nominal [-] (default: 1)",
    )
    add("--nose-radius", **nose_radius)
    add(
        "--out",
        type=picture_path,
        required=True,
        metavar="FILE",
        help="picture to write: PNG, SVG or PDF, by its suffix",
    )
    add("--overwrite", **overwrite)

    add = command(_advise, "advise speed, feed and edge changes, in parts and money").add_argument
    add("--nose-radius", **nose_radius)
    agent = "ONNX file or module:object to compare with fixed parameters; may be repeated"
    add("--agent", action="append", default=[], metavar="POLICY", help=agent)
    add(
        "--seeds",
        type=_count,
        default=16,
        metavar="N",
        help="edges to play with each policy; 0: none (default: 16)",
    )
    add(
        "--sheet",
        type=picture_path,
        metavar="FILE",
        help="page to pin to the machine: PDF, PNG or SVG",
    )
    add(
        "--page",
        type=Path,
        metavar="HTML",
        help="offline page with sliders for settings and prices",
    )
    add("--overwrite", **overwrite)
    add("--json", action="store_true", help="print all results as JSON")


def _number(column: str) -> Callable[[str], float]:
    """Return an argparse type for one number within a column's range."""
    return number_within(COLUMNS[column].low, COLUMNS[column].high, COLUMNS[column].unit)


def _column(text: str) -> tuple[str, str]:
    """Return a column and the header that it has in a sheet, as an argparse type."""
    name, _, header = text.partition("=")
    column = named_column(name)
    if column is None or not header:
        allowed = (
            f"NAME=HEADER, such as Fc=Fx, where NAME is {', '.join(COLUMNS)} or the symbol of one"
        )
        raise argparse.ArgumentTypeError(f"{text!r} is not allowed: {allowed}")
    return column, header


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

    python -m turning_env calibrate cuts.csv --out my_tool.toml --base machine.toml
    """
    from turning_shop.calibrate import ImplausibleError, calibrate, summary, write_scenario

    refuse_existing(options.overwrite, options.out)
    if options.out.suffix != ".toml":
        raise WorkshopError(f"--out is {options.out}, but a scenario's name must end in .toml")
    base = Scenario.load(options.base)
    try:
        found = calibrate(
            read_measurements(options.measurements, dict(options.columns)), base, options.force
        )
    except ImplausibleError as error:
        print(*(f"implausible: {problem}" for problem in error.problems), sep="\n", file=sys.stderr)
        print(
            "error: nothing was written: correct the rows above; --force goes on with them",
            file=sys.stderr,
        )
        return FAILED
    write_scenario(found, options.base, Path(options.measurements).name, options.out)
    for warning in (*found.problems, *found.warnings):
        print(f"warning: {warning}", file=sys.stderr)
    print(*summary(found), sep="\n")
    print(options.out)
    return 0


def _whatif(options: argparse.Namespace) -> int:
    """Print a table of cuts, one row for every combination of the listed values.

    Fitted laws give 95 % intervals for an edge that was not measured; a star marks cuts beyond what was measured. The table
    assumes that speed, feed and depth have been constant since the edge was fresh.

    python -m turning_env whatif rough_turning --cutting-speed 120 150 180 --feed 0.2 0.3 0.4 --wear 0.2
    """
    from turning_shop.allowed import allowed_loads
    from turning_shop.prediction import outside, predict

    scenario, evidence = _warned(options)
    ages = options.time or options.wear
    depths, hardnesses = (
        options.depth or [scenario.workpiece.depth_of_cut],
        options.hardness or [1.0],
    )
    axes = (depths, hardnesses, ages, options.cutting_speed, options.feed)
    _warn_of_settings(scenario, options.cutting_speed, options.feed)
    depth, hardness, age, speed, feed = np.meshgrid(*axes, indexing="ij")
    given = {"time": age} if options.time else {"wear": age}
    cuts = whatif.what_if(scenario, speed, feed, depth, hardness, **given)
    prediction = (
        predict(scenario, evidence, cuts, of_wear=options.time is None) if evidence.laws else None
    )
    allowed = allowed_loads(scenario)
    if allowed.by_strength and np.any(cuts.thrust_force > allowed.thrust_force):
        above = f"thrust above {allowed.thrust_force:.0f} N, at a tool.edge_strength of {scenario.tool.edge_strength:g} N"
        print(f"warning: edges may break: {above}", file=sys.stderr)
    if options.json:
        print_json(tables.records(cuts, prediction))
    elif options.csv:
        records = tables.records(cuts, prediction)
        writer = csv.DictWriter(sys.stdout, list(records[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(records)
    else:
        print(*tables.table(cuts, prediction), sep="\n")
        if prediction and prediction.extrapolated.any():
            out = (
                f"{name} measured at {at}"
                for name, at, beyond in outside(evidence, cuts._asdict())
                if beyond.any()
            )
            print(f"* extrapolated, beyond what was measured: {', '.join(out)}")
    return 0


def _warn_of_settings(scenario: Scenario, speeds: Sequence[float], feeds: Sequence[float]) -> None:
    """Print a warning if a cutting speed or a feed is outside the machine's range, or a feed above that of the nose radius."""
    from turning_shop.allowed import feed_range

    machine = scenario.machine
    for option, unit, values, low, high in (
        ("--cutting-speed", "m/min", speeds, machine.cutting_speed_min, machine.cutting_speed_max),
        ("--feed", "mm/rev", feeds, machine.feed_min, machine.feed_max),
    ):
        if beyond := [value for value in values if not low <= value <= high]:
            print(
                f"warning: {option} {beyond[-1]:g} is outside the machine's {low:g} to {high:g} {unit}",
                file=sys.stderr,
            )
    highest = feed_range(scenario)[1]
    if highest < max(feeds) <= machine.feed_max:
        why = "half of tool.nose_radius, or the end of the chip breaker's window"
        print(f"warning: --feed {max(feeds):g} is above {highest:g} mm/rev: {why}", file=sys.stderr)


def _warned(options: argparse.Namespace) -> "tuple[Scenario, Evidence]":
    """Load a scenario for advice, and print its warnings."""
    from turning_shop.provenance import load

    scenario, evidence = load(options.scenario, nose_radius=options.nose_radius)
    for warning in evidence.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    return scenario, evidence


def _map(options: argparse.Namespace) -> int:
    """Draw limits, removal rate and tool life over the machine's range of cutting speed and feed.

    python -m turning_env map rough_turning --wear 0.2 --out map.png
    """
    refuse_existing(options.overwrite, options.out)
    scenario, evidence = _warned(options)
    criterion = scenario.tool.wear_criterion
    if options.wear > criterion:
        raise WorkshopError(
            f"--wear is {options.wear:g}, but an edge is worn out at tool.wear_criterion, {criterion:g} mm"
        )
    from turning_shop import plots

    from turning_env.rendering import plot_style

    plot_style.save(
        plots.draw_map(scenario, evidence, options.wear, options.depth, options.hardness),
        options.out,
    )
    print(options.out)
    return 0


def _advise(options: argparse.Namespace) -> int:
    """Recommend speed, feed and edge change for the least cost per part, and for most metal.

    The edge is changed after a number of parts that 97.5 % of edges last; all numbers refer to this. Then play the advice, and
    what adapts to bars and edges, on the simulated lathe, and print the cost per part of each. Set economics.machine_rate,
    operator_rate, insert_price and edges_per_insert in SCENARIO to get money. Limits of force and power count if SCENARIO or a
    file that it is based on states them.

    python -m turning_env advise my_tool.toml
    python -m turning_env advise my_tool.toml --agent my_agent.onnx
    """
    from turning_shop.advise import advise, headline, summary
    from turning_shop.advise_play import play_all

    refuse_existing(options.overwrite, options.sheet, options.page)
    scenario, evidence = _warned(options)
    found = advise(scenario, evidence)
    played, simulated = None, []
    if options.seeds:
        on_play = partial(print, "playing", file=sys.stderr, flush=True)
        played = play_all(scenario, found[0].plan, options.agent, options.seeds, on_play)
        simulated = list(played.headline())
    if options.sheet:
        from turning_shop import plots

        from turning_env.rendering import plot_style

        plot_style.save(plots.draw_sheet(scenario, evidence, found, simulated), options.sheet)
    if options.page:
        from turning_shop.page import render

        text = render(scenario, evidence, found, simulated)
        replace_file(options.page, lambda partial: partial.write_text(text, "utf-8"))
    if options.json:
        said = {
            "headline": list(headline(scenario, evidence, found)),
            "warnings": evidence.warnings,
        }
        print_json({"advice": [each.as_record() for each in found], "played": played} | said)
        return 0
    print(*summary(scenario, evidence, found), sep="\n")
    if played:
        print("", *played.summary(), sep="\n")
    for path in filter(None, (options.sheet, options.page)):
        print(path)
    return 0
