"""The commands of ``python -m turning_shop`` for a process engineer: calibrate, predict and others.

Each command's function is followed by its options. The computations are in the modules that the
functions import, and only the command that runs loads SciPy and Matplotlib.
"""

import argparse
import csv
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from turning_shop import WorkshopError, refuse_existing, tables, tool_command, whatif
from turning_shop.catalogue.hardness import brinell, ratio
from turning_shop.headers import COLUMNS, EDGE, is_unit_of, named_column, units_of
from turning_shop.measurements import Measurements, read_measurements
from turning_shop.units import SYSTEMS, Units, add_units

from turning_env.console import (
    DONE,
    FAILED,
    number_within,
    picture_path,
    print_json,
)
from turning_env.files import replace_file, write_file
from turning_env.scenario import Scenario

if TYPE_CHECKING:
    from turning_shop import start, start_question
    from turning_shop.advise import Advice, PartPlan
    from turning_shop.prediction import Evidence, Prediction

MAX_EDGES = 10_000  # that advise plays with each policy
DEFAULT_EDGES = 16
INCH_LENGTH = 25.4  # [mm]


def add_commands(command: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the commands, each with its function, help and options."""
    calibrate = command(_calibrate, "fit the laws to cuts measured on a machine", scenario=False)
    _add_calibrate_options(calibrate)
    predict = command(_predict, "test the laws on edges that are left out", scenario=False)
    _add_predict_options(predict)
    _add_whatif_options(command(_whatif, "predict force, power, wear and tool life"))
    _add_map_options(command(_map, "draw the operating map of a worn edge"))
    tool_command.add_options(
        command(tool_command.tools, "read and write tables of tools", scenario=False)
    )
    advise = command(
        _advise, "advise speed, feed and edge changes, in parts and money", scenario=False
    )
    _add_advise_options(advise)


def _calibrate(options: argparse.Namespace) -> int:
    """Fit laws of wear, thrust force and power to measured cuts, and write a scenario with them.

    The sheet has one cut per row and the columns below. Cells may be empty. A row is used for every
    law whose columns it fills. Symbols such as vc, f and ap, German names and units in brackets are
    understood. Status 1: rows or laws cannot be true.

    COLUMNS

    python -m turning_shop calibrate cuts.csv --out my_tool.toml --base machine.toml
    """
    from turning_shop.calibrate import ImplausibleError, calibrate, summary, write_scenario

    refuse_existing(options.overwrite, options.out)
    if options.out.suffix != ".toml":
        raise WorkshopError(f"--out is {options.out}, but a scenario's name must end in .toml")
    base = Scenario.load(options.base)
    measurements = _read_sheet(options)
    try:
        calibration = calibrate(measurements, base, force=options.force)
    except ImplausibleError as error:
        for problem in error.problems:
            print(f"implausible: {problem}", file=sys.stderr)
        print(
            "error: nothing was written: correct the rows above; --force goes on with them",
            file=sys.stderr,
        )
        return FAILED
    sheet = Path(options.measurements).name
    write_scenario(calibration, options.base, source=sheet, out=options.out)
    for warning in (*calibration.problems, *calibration.warnings):
        _warn(warning)
    print("\n".join(summary(calibration)))
    print(options.out)
    return DONE


def _add_calibrate_options(parser: argparse.ArgumentParser) -> None:
    # COLUMNS in the docstring stands for the table that headers.py declares.
    parser.description = (parser.description or "").replace("COLUMNS", _columns_help())
    add = parser.add_argument
    _add_sheet_options(parser)
    add("--out", type=Path, required=True, metavar="TOML", help="scenario file to write")
    add("--force", action="store_true", help="go on with rows and laws that cannot be true")
    _add_overwrite(parser)


def _add_sheet_options(parser: argparse.ArgumentParser) -> None:
    """Add the sheet of cuts, the base, and what the sheet does not tell."""
    add = parser.add_argument
    add("measurements", metavar="SHEET", help="CSV or XLSX, one cut per row")
    add(
        "--base",
        default="rough_turning",
        metavar="SCENARIO",
        help="preset or TOML file for everything that is not fitted (default: %(default)s)",
    )
    add(
        "--columns",
        nargs="+",
        type=_columns,
        default=[],
        metavar="NAME=HEADER",
        help=(
            "header of a column where the sheet does not tell, such as wear=TCond; "
            "NAME is a column or its symbol"
        ),
    )
    add(
        "--forces",
        nargs="+",
        type=_columns,
        default=[],
        metavar="NAME=HEADER",
        help="headers of forces along a dynamometer's axes, such as Fc=Fx,Ff=Fz,Fp=Fy",
    )
    add(
        "--unit",
        nargs="+",
        type=_units,
        default=[],
        metavar="NAME=UNIT",
        help="unit of a column whose header states none, such as wear=um",
    )
    add(
        "--set",
        nargs="+",
        type=_constants,
        default=[],
        metavar="NAME=X",
        help="value of a column that is the same in all rows, such as cutting_speed=300",
    )


def _read_sheet(options: argparse.Namespace) -> Measurements:
    """Return the measurements of a sheet, read as the options say."""
    headers = {}
    for pairs in (*options.columns, *options.forces):
        headers.update(pairs)
    units = {}
    for pairs in options.unit:
        units.update(pairs)
    constants = {}
    for pairs in options.set:
        constants.update(pairs)
    return read_measurements(options.measurements, headers, stated_units=units, constants=constants)


def _columns_help() -> str:
    """Return a line for each column of a sheet, with its meaning and unit."""
    lines = [f"  {name:<14}{column.meaning} [{column.unit}]" for name, column in COLUMNS.items()]
    meaning = "name of the cutting edge, so that its readings do not count as independent"
    lines.append(f"  {EDGE:<14}{meaning} (optional)")
    return "\n".join(lines)


def _pairs(text: str, example: str) -> dict[str, str]:
    """Return columns, and what is said of each, from text such as "Fc=Fx,Ff=Fz"."""
    pairs = {}
    for pair in text.split(","):
        name, _, value = pair.partition("=")
        column = named_column(name.strip())
        if column is None or not value.strip():
            raise argparse.ArgumentTypeError(
                f"{pair!r} is not allowed: such as {example}, "
                f"where the name is {', '.join(COLUMNS)} or the symbol of one"
            )
        pairs[column] = value.strip()
    return pairs


def _columns(text: str) -> dict[str, str]:
    """Return the headers of columns, as an argparse type."""
    return _pairs(text, "Fc=Fx")


def _units(text: str) -> dict[str, str]:
    """Return the units of columns, as an argparse type."""
    pairs = _pairs(text, "wear=um")
    for column, unit in pairs.items():
        if column not in COLUMNS:
            raise argparse.ArgumentTypeError(f"{column} has no unit")
        if not is_unit_of(unit, column):
            raise argparse.ArgumentTypeError(
                f"{column} is not measured in {unit!r}, but in {', '.join(units_of(column))}"
            )
    return pairs


def _constants(text: str) -> dict[str, float]:
    """Return the values of columns that are the same in all rows, as an argparse type."""
    constants = {}
    for column, value in _pairs(text, "cutting_speed=300").items():
        if column not in COLUMNS:
            raise argparse.ArgumentTypeError(f"{column} is no number")
        try:
            constants[column] = _number_or_zero(column, value)
        except argparse.ArgumentTypeError as error:
            raise argparse.ArgumentTypeError(f"{column}: {error}") from error
    return constants


def _number_or_zero(column: str, text: str) -> float:
    """Return a number within a column's range, or 0 if it is a measurement too."""
    is_zero = COLUMNS[column].may_be_zero and text in ("0", "0.0")
    return 0.0 if is_zero else _number(column)(text)


def _wear(text: str) -> float:
    """Return a flank wear, as an argparse type."""
    return _number_or_zero("wear", text)


def _refuse_fresh_edge(scenario: Scenario, wears: Sequence[float]) -> None:
    """Raise an error if a wear is 0 and a law asks for no load from a fresh edge."""
    for name in whatif.NO_LIMIT:
        law = getattr(scenario.material, name)
        if 0.0 in wears and law.wear > 0.0 and law.wear_growth == 0.0:
            raise WorkshopError(
                f"--wear 0: material.{name} is a power of the wear, "
                "which says nothing of a fresh edge"
            )


def _predict(options: argparse.Namespace) -> int:
    """Predict measured edges, or rows, by laws fitted to the others, and compare.

    Print for each law the number of readings, how many of their 95 % intervals hold, the median
    error, and the typical width: an interval ends at this factor of the prediction, and at its
    inverse.

    python -m turning_shop predict cuts.csv
    python -m turning_shop predict cuts.csv --hold-out 5 --set cutting_speed=300
    """
    from turning_shop.hold_out import hold_out, summary, write_csv

    refuse_existing(options.overwrite, options.out)
    measurements = _read_sheet(options)
    results = hold_out(measurements, Scenario.load(options.base), by=options.hold_out)
    print("\n".join(summary(results)))
    if options.out:

        def write(path: Path) -> None:
            with path.open("w", encoding="utf-8", newline="") as file:
                write_csv(results, file)

        replace_file(options.out, write)
        print(options.out)
    return DONE


def _add_predict_options(parser: argparse.ArgumentParser) -> None:
    _add_sheet_options(parser)
    parser.add_argument(
        "--hold-out",
        type=_parts,
        metavar="edge|row|N",
        help=(
            "what is left out in turn: an edge, a row, or one of N parts of the sheet "
            "(default: an edge if edges have names, otherwise a row)"
        ),
    )
    parser.add_argument("--out", type=Path, metavar="CSV", help="file of all predictions to write")
    _add_overwrite(parser)


def _parts(text: str) -> str | int:
    """Return what is left out in turn, as an argparse type."""
    if text in ("edge", "row"):
        return text
    if text.isascii() and text.isdigit() and int(text) >= 2:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text!r} is not allowed: edge, row, or a number above 1")


def _whatif(options: argparse.Namespace) -> int:
    """Print a table of cuts, one row for every combination of the listed values.

    Fitted laws give 95 % intervals for an edge that was not measured; a star marks cuts beyond what
    was measured. The table assumes that speed, feed and depth have been constant since the edge was
    fresh.

    python -m turning_shop whatif rough_turning --cutting-speed 120 150 --feed 0.2 0.4 --wear 0.2
    """
    from turning_shop.allowed import bending_force_of_bar
    from turning_shop.prediction import longest_life, predict

    scenario, evidence = _load(options)
    _refuse_fresh_edge(scenario, options.wear or [])
    _warn_of_settings(scenario, speeds=options.cutting_speed, feeds=options.feed)
    cuts = _cuts(scenario, evidence, options)
    prediction = None
    if evidence.laws:
        prediction = predict(scenario, evidence, cuts, of_wear=options.time is None)
    _warn_of_breakage(scenario, cuts)
    if options.json:
        print_json(tables.records(cuts, prediction))
    elif options.csv:
        records = tables.records(cuts, prediction)
        writer = csv.DictWriter(sys.stdout, list(records[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(records)
    else:
        lines = tables.cuts_table(
            cuts,
            prediction,
            units=SYSTEMS[options.units],
            bending_force=bending_force_of_bar(scenario),
            longest_life=longest_life(evidence),
        )
        print("\n".join(lines))
        _print_measured_ranges(cuts, prediction, evidence, units=SYSTEMS[options.units])
    return DONE


def _cuts(scenario: Scenario, evidence: "Evidence", options: argparse.Namespace) -> whatif.Cuts:
    """Return the cuts of all combinations of the listed values."""
    age = "wear" if options.time is None else "time"
    # Feeds change fastest from row to row, then cutting speeds.
    axes = {
        "depth_of_cut": options.depth or [scenario.workpiece.depth_of_cut],
        "hardness": _hardness_ratios(options.hardness, evidence),
        age: getattr(options, age),
        "cutting_speed": options.cutting_speed,
        "feed": options.feed,
    }
    grids = np.meshgrid(*axes.values(), indexing="ij")
    return whatif.what_if(scenario, **dict(zip(axes, grids, strict=True)))


def _hardness_ratios(texts: Sequence[str] | None, evidence: "Evidence") -> list[float]:
    """Return hardnesses over the nominal one; 1 if none is given."""
    allowed = COLUMNS["hardness"]
    ratios = []
    for text in texts or ["1"]:
        over_nominal = float(f"{ratio(text, evidence.hardness):.6g}")
        if not allowed.low <= over_nominal <= allowed.high:
            raise WorkshopError(
                f"--hardness {text} is {over_nominal:g} times the nominal hardness, outside the "
                f"allowed range {allowed.low:g} to {allowed.high:g}; a hardness has a unit: 300HB"
            )
        ratios.append(over_nominal)
    return ratios


def _print_measured_ranges(
    cuts: whatif.Cuts, prediction: "Prediction | None", evidence: "Evidence", units: Units
) -> None:
    """Print the measured ranges if some cuts extrapolate."""
    from turning_shop.prediction import outside

    if prediction is None or not prediction.extrapolated.any():
        return
    ranges = []
    for measured in outside(evidence, cuts._asdict()):
        if measured.outside.any():
            ranges.append(f"{measured.factor} {evidence.origins} at {measured.text}")
    beyond = f"* extrapolated, beyond what was {evidence.origins}: {', '.join(ranges)}"
    print(units.text(beyond))


def _warn_of_settings(scenario: Scenario, speeds: Sequence[float], feeds: Sequence[float]) -> None:
    """Print a warning if a setting is outside the machine's range or that of the insert."""
    from turning_shop.allowed import feed_ends, feed_range

    machine = scenario.machine
    _warn_of_range(
        "--cutting-speed",
        speeds,
        low=machine.cutting_speed_min,
        high=float(scenario.cutting_speed_max),
        unit="m/min",
    )
    _warn_of_range("--feed", feeds, low=machine.feed_min, high=machine.feed_max, unit="mm/rev")
    _, highest = feed_range(scenario)
    if highest < max(feeds) <= machine.feed_max:
        _warn(
            f"--feed {max(feeds):g} is above {highest:.4g} mm/rev: {feed_ends(scenario)[0].reason}"
        )


def _warn_of_range(
    option: str, values: Sequence[float], low: float, high: float, unit: str
) -> None:
    """Print a warning that names the last of the values outside a range of ``machine``."""
    outside = [value for value in values if not low <= value <= high]
    if outside:
        _warn(
            f"{option} {outside[-1]:g} is outside {low:g} to {high:g} {unit}, the range of the "
            "machine or of the insert"
        )


def _warn_of_breakage(scenario: Scenario, cuts: whatif.Cuts) -> None:
    """Print a warning if a thrust force is above the one that edges hardly ever break at."""
    from turning_shop.allowed import allowed_loads, bending, bending_fields

    allowed = allowed_loads(scenario)
    if allowed.by_deflection and np.any(cuts.thrust_force > allowed.thrust_force):
        _warn(
            f"{bending(scenario)} or more at and above a thrust of "
            f"{allowed.thrust_force:.0f} N: {bending_fields(scenario)}"
        )
    if allowed.by_strength and np.any(cuts.thrust_force > allowed.thrust_force):
        _warn(
            f"edges may break: thrust above {allowed.thrust_force:.0f} N, "
            f"at a tool.edge_strength of {scenario.tool.edge_strength:g} N"
        )


def _add_whatif_options(parser: argparse.ArgumentParser) -> None:
    _add_surface_options(parser)
    add_units(parser)
    parser.add_argument(
        "--cutting-speed",
        nargs="+",
        type=_number("cutting_speed"),
        required=True,
        metavar="X",
        help="cutting speeds [m/min]",
    )
    parser.add_argument(
        "--feed",
        nargs="+",
        type=_number("feed"),
        required=True,
        metavar="X",
        help="feeds [mm/rev]",
    )
    parser.add_argument(
        "--depth",
        nargs="+",
        type=_number("depth_of_cut"),
        metavar="X",
        help="depths of cut [mm] (default: the scenario's)",
    )
    parser.add_argument(
        "--hardness",
        nargs="+",
        type=_hardness,
        metavar="X",
        help="values of hardness over nominal [-], or such as 300HB or 32HRC (default: 1)",
    )
    age = parser.add_mutually_exclusive_group(required=True)
    age.add_argument(
        "--time",
        nargs="+",
        type=_number("time"),
        metavar="X",
        help="cutting times since the edge was fresh [min]",
    )
    age.add_argument(
        "--wear",
        nargs="+",
        type=_wear,
        metavar="X",
        help="values of flank wear [mm]; 0: a fresh edge",
    )
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print JSON")
    form.add_argument("--csv", action="store_true", help="print CSV")


def _map(options: argparse.Namespace) -> int:
    """Draw limits, removal rate and tool life over the machine's range of cutting speed and feed.

    Marks are the cut that advise recommends for the least cost of a nominal bar, and the cut with
    the highest removal rate within the limits at this wear.

    python -m turning_shop map rough_turning --wear 0.2 --out map.png
    """
    refuse_existing(options.overwrite, options.out)
    scenario, evidence = _load(options)
    _refuse_fresh_edge(scenario, [options.wear])
    criterion = scenario.tool.wear_criterion
    if options.wear > criterion:
        raise WorkshopError(
            f"--wear is {options.wear:g}, but an edge is worn out at tool.wear_criterion, "
            f"{criterion:g} mm"
        )
    from turning_shop import plots

    from turning_env.rendering import plot_style

    figure = plots.draw_map(
        scenario,
        evidence,
        wear=options.wear,
        depth_of_cut=options.depth,
        hardness=_hardness_ratios(options.hardness and [options.hardness], evidence)[0],
        advised=_advised(scenario, evidence, options.depth),
        units=SYSTEMS[options.units],
    )
    plot_style.save(figure, options.out)
    print(options.out)
    return DONE


def _advised(scenario: Scenario, evidence: "Evidence", depth: float | None) -> "PartPlan | None":
    """Return the advised cut at a depth [mm], or None and a warning if none can be advised."""
    from turning_shop.advise import cheapest

    if depth is not None:
        work = scenario.workpiece.model_copy(update={"depth_of_cut": depth})
        scenario = scenario.model_copy(update={"workpiece": work})
    try:
        return cheapest(scenario, evidence)
    except WorkshopError as error:
        _warn(f"no advised cut is marked: {error}")
        return None


def _add_map_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--wear",
        type=_wear,
        required=True,
        metavar="X",
        help="flank wear of the edge [mm]; 0: a fresh edge",
    )
    add(
        "--depth",
        type=_number("depth_of_cut"),
        metavar="X",
        help="depth of cut [mm] (default: the scenario's)",
    )
    add(
        "--hardness",
        type=_hardness,
        metavar="X",
        help="hardness over nominal [-], or such as 300HB or 32HRC (default: 1)",
    )
    _add_surface_options(parser)
    add_units(parser)
    add(
        "--out",
        type=picture_path,
        required=True,
        metavar="FILE",
        help="picture to write: PNG, SVG or PDF, by its suffix",
    )
    _add_overwrite(parser)


def _advise(options: argparse.Namespace) -> int:
    """Recommend speed, feed and edge change for the least cost per part, and for most metal.

    The edge is changed after a number of parts that 97.5 % of edges last; all numbers refer to
    this. Then play the advice, and what adapts to bars and edges, on the simulated lathe, and print
    the cost per part of each. Set economics.machine_rate, operator_rate, insert_price and
    edges_per_insert in SCENARIO to get money. Limits of force and power count if SCENARIO or a file
    that it is based on states them.

    Without measured cuts, give --material, --tool, --grade and --stock in place of SCENARIO. Laws
    and ranges are then those of catalogues, with the width of their sources. The answer names these
    and every number that is assumed.

    python -m turning_shop advise my_tool.toml
    python -m turning_shop advise my_tool.toml --agent my_agent.onnx
    python -m turning_shop advise --material 42CrMo4 --tool CNMG120408-PM --grade P25 --stock 80x200
    """
    from turning_shop import start_answer
    from turning_shop.advise import advise, headline, summary
    from turning_shop.advise_play import play_all

    refuse_existing(options.overwrite, options.sheet, options.page, options.plan, options.out)
    job = _job(options)
    if job:
        scenario = job.scenario
        evidence = job.evidence
    else:
        scenario, evidence = _load(options)
    units = SYSTEMS[options.units]
    advice = advise(scenario, evidence)
    played = None
    simulated: list[str] = []
    seeds = options.seeds
    if seeds is None:
        seeds = 0 if job else DEFAULT_EDGES
    if seeds:
        played = play_all(
            scenario,
            advice[0].plan,
            agents=options.agent,
            edges=seeds,
            on_play=_print_playing,
        )
        simulated = list(played.headline())
    _draw_advice(options, scenario, evidence=evidence, advice=advice, simulated=simulated)
    if job:
        _write_job(options, job, advice)
    if options.json:
        record: dict[str, object] = {
            "advice": [entry.as_record() for entry in advice],
            "played": played,
            "headline": list(headline(scenario, evidence, advice)),
            "warnings": evidence.warnings,
        }
        if job:
            record["answer"] = start_answer.sentence(job, advice)
            record["sources"] = list(job.sources)
            record["assumptions"] = list(job.assumptions)
        print_json(record)
        return DONE
    lines = summary(scenario, evidence, advice, units)
    if job:
        lines = start_answer.summary(job, advice, units)
    print("\n".join(lines))
    if played:
        print("", *played.summary(units), sep="\n")
    for path in (options.sheet, options.page, options.plan, options.out):
        if path:
            print(path)
    return DONE


def _draw_advice(
    options: argparse.Namespace,
    scenario: Scenario,
    evidence: "Evidence",
    advice: "list[Advice]",
    simulated: list[str],
) -> None:
    """Write the sheet and the page, if they are asked for."""
    units = SYSTEMS[options.units]
    if options.sheet:
        from turning_shop import plots

        from turning_env.rendering import plot_style

        figure = plots.draw_sheet(
            scenario, evidence, advice=advice, simulated=simulated, units=units
        )
        plot_style.save(figure, options.sheet)
    if options.page:
        from turning_shop.page import render

        page = render(scenario, evidence, advice=advice, simulated=simulated, units=units)
        replace_file(options.page, lambda partial: partial.write_text(page, "utf-8"))


def _write_job(
    options: argparse.Namespace, job: "start.CatalogueJob", advice: "list[Advice]"
) -> None:
    """Write the plan of measurements and the scenario of a job, if they are asked for."""
    from turning_shop import start, wear_plan

    if options.plan:
        page = wear_plan.render(job, advice[0].plan, SYSTEMS[options.units])
        write_file(options.plan, page)
    if options.out:
        write_file(options.out, start.toml_of(job, options.out))


def _job(options: argparse.Namespace) -> "start.CatalogueJob | None":
    """Return the job of --material and the options beside it; None if a scenario is given."""
    from turning_shop import start, start_question

    given = []
    for name in _CATALOGUE_OPTIONS:
        if getattr(options, name.replace("-", "_")):
            given.append(f"--{name}")
    if options.scenario:
        if options.plan:
            raise WorkshopError(
                "--plan needs --material and the options beside it: it plans a first sheet. What a "
                "further edge narrows follows from the sheet of the measured ones, which "
                f"{options.scenario} does not hold: add its readings, and run calibrate again"
            )
        if given:
            raise WorkshopError(
                f"{options.scenario} is read as a SCENARIO, which has laws of its own: leave out "
                f"either it or {', '.join(given)}; a number and its unit stand together, as in "
                "--hardness 32HRC"
            )
        return None
    missing = [f"--{name}" for name in _CATALOGUE_NEEDS if not getattr(options, name)]
    if missing:
        raise WorkshopError(
            "give a SCENARIO, or a job by its material, insert, grade and stock, such as "
            "--material 42CrMo4 --tool CNMG120408-PM --grade P25 --stock 80x200 --depth 2; "
            f"missing: {', '.join(missing)}"
        )
    if options.nose_radius:
        raise WorkshopError(f"leave out --nose-radius: the insert {options.tool} states it")
    if options.out and options.out.suffix != ".toml":
        raise WorkshopError(f"--out is {options.out}, but a scenario's name must end in .toml")
    machine = Path(options.machine or "rough_turning")
    if options.out and options.out.resolve() == machine.resolve():
        raise WorkshopError(f"--out is {options.out}, but must not be the file of --machine")
    question = start_question.Question(
        options.material,
        options.tool,
        options.grade,
        stock=options.stock,
        depth=options.depth,
        machine=options.machine or "rough_turning",
        start_speed=options.start_speed,
        feeds=options.feeds,
        roughness=options.roughness,
        support=options.support,
        hardness=options.hardness and brinell(options.hardness),
        conditions=tuple(dict.fromkeys(options.cut or ())),
        entering_angle=options.entering_angle,
    )
    return start.job_of(question)


def _print_playing(policy: str) -> None:
    """Print which policy is playing."""
    print("playing", policy, file=sys.stderr, flush=True)


_CATALOGUE_NEEDS = ("material", "tool", "grade", "stock")
_CATALOGUE_OPTIONS = (
    *_CATALOGUE_NEEDS,
    "depth",
    "machine",
    "start-speed",
    "feeds",
    "support",
    "hardness",
    "cut",
    "entering-angle",
    "plan",
    "out",
)
"""Options of a job without a scenario."""


def _add_catalogue_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a job whose laws are those of catalogues."""
    group = parser.add_argument_group("without measured cuts, in place of SCENARIO")
    add = group.add_argument
    add(
        "--material",
        metavar="NAME",
        help="group of VDI 3323, number or name: P6, 1.7225, 42CrMo4, 4140, SCM440",
    )
    add("--tool", metavar="INSERT", help="designation of the insert: CNMG120408-PM or CNMG432")
    add("--grade", metavar="GRADE", help="application of ISO 513, from the box: P25")
    add(
        "--stock",
        type=_stock,
        metavar="DIAMETERxLENGTH",
        help=(
            "diameter and length of cut [mm], or with in after it [inch]: 80x200, 3.15x8in; "
            "tube:80x60x200 is a tube of 60 mm inner diameter"
        ),
    )
    add(
        "--depth",
        type=_depth,
        metavar="X",
        help=(
            "depth of cut [mm], or with in after it [inch], such as 0.08in "
            "(default: the usual one of the chip breaker)"
        ),
    )
    add("--machine", metavar="TOML", help="file with ranges, power and prices of the machine")
    add(
        "--start-speed",
        type=_number("cutting_speed"),
        metavar="X",
        help="start value of the box for a life of 15 min [m/min] (default: from the table)",
    )
    add(
        "--feeds",
        type=_feed_window,
        metavar="LOW-HIGH",
        help="window of feed of the box [mm/rev] (default: by the chip breaker's letter)",
    )
    add(
        "--support",
        choices=("chuck", "tailstock", "rigid"),
        help="how the bar is held (default: workpiece.support of the machine's file, or chuck)",
    )
    add(
        "--hardness",
        metavar="X",
        help="hardness of the bar, such as 300HB or 32HRC (default: annealed)",
    )
    add(
        "--entering-angle",
        type=number_within(15.0, 120.0, unit="degree"),
        metavar="X",
        help="angle of the straight edge to the feed, as the holder states it (default: 90)",
    )
    add(
        "--cut",
        nargs="+",
        choices=("interrupted", "skin", "unstable", "dry"),
        help="what the cut is not: smooth, clean, firm, wet; each lowers the speed",
    )
    add("--out", type=Path, metavar="TOML", help="scenario to write, for map, whatif, program")
    add(
        "--plan",
        type=Path,
        metavar="HTML",
        help="page to print: which wear to measure first, what it narrows, boxes for readings",
    )


def _stock(text: str) -> "start_question.Stock":
    """Return a bar, as an argparse type."""
    from turning_shop import start_question

    match = re.fullmatch(r"(bar:|tube:)?([\d.]+)(?:[xX]([\d.]+))?[xX]([\d.]+)(mm|in)?", text)
    is_tube = match is not None and match[1] == "tube:"
    if match is None or is_tube != bool(match[3]):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not allowed: DIAMETERxLENGTH in mm, such as 80x200, or 3.15x8in, or a "
            "tube:OUTERxINNERxLENGTH; decimals have a point"
        )
    within = _millimetres(1.0, 5000.0)
    unit = match[5] or ""
    diameter = within(match[2] + unit)
    bore = within(match[3] + unit) if is_tube else 0.0
    if bore >= diameter:
        raise argparse.ArgumentTypeError(f"{text!r}: the inner diameter is not below the outer one")
    return start_question.Stock(diameter=diameter, length=within(match[4] + unit), bore=bore)


def _hardness(text: str) -> str:
    """Return a hardness as an argparse type: over nominal, or in HB or HRC."""
    try:
        ratio(text, nominal=1.0)
    except WorkshopError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return text


def _depth(text: str) -> float:
    """Return a depth of cut [mm], as an argparse type."""
    allowed = COLUMNS["depth_of_cut"]
    return _millimetres(allowed.low, allowed.high)(text)


def _millimetres(low: float, high: float) -> Callable[[str], float]:
    """Return an argparse type for a length in mm, or in inch with "in" after it."""
    within = number_within(low, high, unit="mm")

    def length(text: str) -> float:
        match = re.fullmatch(r"(-?(?:\d+\.?\d*|\.\d+))(mm|in)?", text)
        if match is None:
            raise argparse.ArgumentTypeError(
                f"{text!r} is no length: give mm, such as 2.5, or inch, such as 0.08in; "
                "decimals have a point"
            )
        number, unit = match.groups()
        return within(str(INCH_LENGTH * float(number)) if unit == "in" else number)

    return length


def _feed_window(text: str) -> tuple[float, float]:
    """Return a lowest and a highest feed, as an argparse type."""
    low, separator, high = text.partition("-")
    if not separator:
        raise argparse.ArgumentTypeError(f"{text!r} is not allowed: LOW-HIGH, such as 0.15-0.5")
    feed = _number("feed")
    window = (feed(low), feed(high))
    if window[0] >= window[1]:
        raise argparse.ArgumentTypeError(f"{text!r} is not allowed: the first must be the lower")
    return window


def _add_advise_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "scenario", nargs="?", metavar="SCENARIO", help="preset or TOML file with laws"
    )
    _add_catalogue_options(parser)
    _add_surface_options(parser)
    add_units(parser)
    add = parser.add_argument
    add(
        "--agent",
        action="append",
        default=[],
        metavar="POLICY",
        help="ONNX file or module:object to compare with fixed parameters; may be repeated",
    )
    add(
        "--seeds",
        type=_number_of_edges,
        metavar="N",
        help="edges to play with each policy; 0: none (default: 16; without measured cuts 0)",
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
    _add_overwrite(parser)
    add("--json", action="store_true", help="print all results as JSON")


def _number_of_edges(text: str) -> int:
    """Return a number of edges to play, as an argparse type: 0, or 2 or more."""
    # A single edge has no interval.
    is_number = text.isascii() and text.isdigit()
    if not is_number or int(text) == 1 or int(text) > MAX_EDGES:
        raise argparse.ArgumentTypeError(f"{text!r} is not allowed: 0, or 2 to {MAX_EDGES}")
    return int(text)


def _load(options: argparse.Namespace) -> "tuple[Scenario, Evidence]":
    """Load a scenario for advice, and print its warnings."""
    from turning_shop.provenance import load

    scenario, evidence = load(
        options.scenario, nose_radius=options.nose_radius, roughness=options.roughness
    )
    for warning in evidence.warnings:
        _warn(SYSTEMS[options.units].text(warning))
    return scenario, evidence


def _warn(text: str) -> None:
    """Print a warning to stderr."""
    print(f"warning: {text}", file=sys.stderr)


def _number(column: str) -> Callable[[str], float]:
    """Return an argparse type for one number within a column's range."""
    allowed = COLUMNS[column]
    return number_within(allowed.low, allowed.high, unit=allowed.unit)


def _add_surface_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that limit the feed for the surface's sake."""
    parser.add_argument(
        "--nose-radius",
        type=number_within(0.05, 10.0, unit="mm"),
        metavar="X",
        help=(
            "nose radius of the inserts [mm]: the feed is at most half of it "
            "(default: tool.nose_radius)"
        ),
    )
    parser.add_argument(
        "--roughness",
        type=number_within(0.1, 1000.0, unit="um"),
        metavar="X",
        help="highest theoretical roughness Rt, feed^2 / (8 nose radius) [um] (default: none)",
    )


def _add_overwrite(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--overwrite", action="store_true", help="replace existing files")
