"""The command ``python -m turning_env program``: read, play and adapt a part program of the user's own."""

import argparse
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from turning_nc.dialects import DIALECTS
from turning_nc.words import NcError, naming, read_program_file
from turning_shop import refuse_existing

from turning_env.console import number_within, picture_path, print_json
from turning_env.files import replace_file

WARNING = "simulation output: not for a machine without review"
MARK = ".simulated"


def program(options: argparse.Namespace) -> int:
    """Play a part program on a stock: depth of cut, load, wear and time of every block; adapt its feeds and speeds.

    The program is Fanuc's (ISO) or SINUMERIK's. An error names words that are not understood, with their lines. Loads are
    nominal, with edges worn as at their change. Edges are changed after as many parts as 97.5 % of them last. Limits count as
    in `advise`.

    --adapt changes only F and S words, so that the program takes least time within the scenario's limits and without using
    more edges. The adapted program is simulation output. Do not run it on a machine without review.

    python -m turning_env program part.mpf --scenario my_tool.toml --stock bar:80x120+1 --figure part.png
    python -m turning_env program part.mpf --scenario my_tool.toml --stock bar:80x120+1 --adapt words --out part.simulated.mpf
    """
    from turning_nc import adapt, cutting, edges, moves, plausibility, removal, report, stock

    if options.figure:  # before anything is computed, as Matplotlib may be missing
        from turning_nc import picture

        from turning_env.rendering import plot_style
    from turning_shop.allowed import FEED_PER_NOSE, limited_by_strength
    from turning_shop.provenance import OF_PROGRAMS, load

    scenario, evidence = load(
        options.scenario, OF_PROGRAMS, options.nose_radius, is_simulated=False
    )
    scenario, strength = limited_by_strength(scenario)
    if (options.wear or 0.0) > scenario.tool.wear_criterion:
        raise NcError(
            f"--wear is {options.wear:g} mm, but at most the wear criterion, {scenario.tool.wear_criterion:g} mm"
        )
    _check_out(options)
    text = read_program_file(options.program, DIALECTS.get(options.dialect))
    with naming(options.program):
        reading = moves.Reading(
            go_on=options.go_on,
            unit=options.unit,
            steps=options.steps,
            radius=options.radius,
            sides=dict(options.side or ()),
        )
        run = moves.run(text, reading)
    tools = dict(options.tool or ())
    notes = list(run.notes)
    polygon, guessed = (
        (stock.read_stock(options.stock), "") if options.stock else stock.guessed_stock(run, tools)
    )
    notes += [f"no --stock is given: {guessed} is taken"] if guessed else []
    with naming(options.program):
        cut = removal.remove(run, polygon, tools)
    notes += cut.notes
    nose_radius = scenario.tool.nose_radius or None
    max_feed = min(options.max_feed or math.inf, FEED_PER_NOSE * (nose_radius or math.inf))
    machine = cutting.Machine(options.max_spindle, options.rapid, options.tool_change, max_feed)
    situation = cutting.Situation(scenario, machine, run, cut, evidence)
    played = cutting.play(situation, options.wear or edges.change_wear(situation))
    off = "limits.thrust_force is off"  # not any more, if the strength of edges bounds it
    notes += [
        warning for warning in evidence.warnings if not (strength and warning.startswith(off))
    ]
    notes += [strength] if strength else []
    notes += edges.beyond(situation, played)
    implausible = plausibility.implausible(situation, played)
    if implausible and options.adapt and not options.force:
        listed = "".join(f"\n  {name}: {text}" for name, text in implausible.items())
        raise NcError(
            f"{options.program}: nothing is adapted, because the program is implausible; --force adapts it:{listed}"
        )
    rows = report.rows(situation, played)
    totals = report.summary(situation, played)
    adapted = None
    if options.adapt:
        adapted = adapt.adapt(
            situation, options.wear, options.adapt, options.life, options.finishing
        )
        after = report.summary(adapted.situation, adapted.played)
        notes += [f"adapted, {note}" for note in edges.beyond(adapted.situation, adapted.played)]
    if options.figure:
        plot_style.save(
            picture.draw(situation, played, f"{options.program.name}, {scenario.name}"),
            options.figure,
        )
    if adapted and options.out:
        data = adapted.text.encode("latin-1")
        replace_file(options.out, lambda partial: partial.write_bytes(data))
    if options.json:
        results: dict[str, Any] = {
            "program": options.program,
            "dialect": text.dialect.name,
            "scenario": scenario.name,
        }
        sides = {line: {"side": side.name, "why": side.why} for line, side in run.sides.items()}
        results |= {
            "totals": totals,
            "blocks": rows,
            "sides": sides,
            "warnings": implausible,
            "notes": notes,
        }
        if adapted:
            results["adapted"] = {"totals": after, "changes": adapted.changes, "warning": WARNING}
        print_json(results)
        return 0
    turned = [
        f"line {line} turns {side.name}, {side.why}; --side sets it"
        for line, side in run.sides.items()
    ]
    warned = [f"warning: {name}: {text}" for name, text in implausible.items()]
    print(
        report.table(situation, rows),
        "",
        *totals.lines(),
        *report.findings(rows),
        *turned,
        *warned,
        sep="\n",
    )
    print(*(f"note: {note}" for note in notes), sep="\n", end="\n" * bool(notes))
    if adapted:
        changed = report.changes(adapted.changes, nose_radius)
        print(
            "",
            f"adapted ({WARNING}): {len(adapted.changes)} words",
            *changed,
            *report.comparison(totals, after),
            sep="\n",
        )
    for path in filter(None, (options.figure, options.out)):
        print(path)
    return 0


def _check_out(options: argparse.Namespace) -> None:
    refuse_existing(options.overwrite, options.out, options.figure)
    if options.out is None:
        return
    if not options.adapt:
        raise NcError("--out needs --adapt: only an adapted program is written")
    if MARK not in options.out.suffixes:
        wanted = options.program.with_suffix(f"{MARK}{options.program.suffix}").name
        reason = "so that nobody takes it for a tried program"
        raise NcError(f"--out {options.out}: its name must hold {MARK}, such as {wanted}, {reason}")


def add_commands(command: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the command and its options."""
    parser = command(program, "play and adapt a part program", scenario=False)
    add = parser.add_argument
    add("program", type=Path, metavar="FILE", help="part program")
    add(
        "--scenario",
        required=True,
        metavar="SCENARIO",
        help="preset or TOML file with the laws and limits",
    )
    sizes = "bar:DIAMETERxLENGTH or tube:OUTERxINNERxLENGTH [mm], with +FACE for metal before Z0"
    add(
        "--stock",
        metavar="STOCK",
        help=f"{sizes}; or a DXF or CSV file (default: a bar that the program fits in)",
    )
    kinds = "outside, inside, left, copying, neutral, groove:WIDTH, drill:DIAMETER; -left and -inside may follow"
    add(
        "--tool",
        action="append",
        type=_tool,
        metavar="NAME=KIND",
        help=f"kind of a tool: {kinds} (default: as it moves); can be repeated",
    )
    sides = "side that the G71, G72 or CYCLE95 in a line turns: outside or inside (default: as a control); can be repeated"
    add("--side", action="append", type=_side, metavar="LINE=SIDE", help=sides)
    add(
        "--unit",
        choices=("mm", "inch"),
        help="unit of a program that states none (default: mm, with a note)",
    )
    steps = "numbers without a decimal point count 0.001 mm or 0.0001 inch; F and S stay (default: mm or inch)"
    add("--steps", action="store_true", help=steps)
    add(
        "--radius",
        action="store_true",
        help="X is a radius, if the program does not state it (default: a diameter)",
    )
    add("--dialect", choices=tuple(DIALECTS), help="control (default: by the program's own words)")
    add(
        "--go-on",
        action="store_true",
        help="leave out words that are not understood, instead of refusing the program",
    )
    add(
        "--adapt",
        choices=("words", "blocks"),
        help="adapt feeds and speeds in the program's own words, or in every block",
    )
    for option, default, low, high, unit, text in (
        ("--wear", None, 0.001, 10.0, "mm",
         "flank wear at which edges are changed [mm] (default: the highest that keeps the limits, up to the wear criterion)"),
        ("--max-spindle", 4000.0, 1.0, 1e5, "rev/min", "highest spindle speed of the machine [rev/min] (default: %(default)g)"),
        ("--rapid", 10_000.0, 1.0, 1e6, "mm/min", "rapid traverse [mm/min] (default: %(default)g)"),
        ("--tool-change", 2.0, 0.0, 1e3, "s", "time to change a tool [s] (default: %(default)g)"),
        ("--life", 1.0, 0.01, 100.0, "", "edges that the adapted program may use, over those before (default: %(default)g)"),
        ("--max-feed", None, 0.001, 10.0, "mm/rev", "highest feed of the inserts [mm/rev] (default: the scenario's)"),
        ("--nose-radius", None, 0.05, 10.0, "mm", "nose radius of the inserts [mm]: the feed is at most half of it"),
        ("--finishing", 0.5, 0.0, 100.0, "mm",
         "feeds up to this depth of cut stay: they make the surface [mm] (default: %(default)g)"),
    ):  # fmt: skip
        add(option, type=number_within(low, high, unit), default=default, metavar="X", help=text)
    add(
        "--out",
        type=Path,
        metavar="FILE",
        help=f"adapted program to write; its name must hold {MARK}",
    )
    add("--force", action="store_true", help="adapt a program that is implausible")
    add("--overwrite", action="store_true", help="replace existing files")
    add(
        "--figure",
        type=picture_path,
        metavar="FILE",
        help="picture of stock, passes and load: PNG, SVG or PDF",
    )
    add("--json", action="store_true", help="print all results as JSON")


def _tool(text: str) -> tuple[str, str]:
    name, _, kind = text.partition("=")
    if not (name and kind):
        raise argparse.ArgumentTypeError(f"{text!r} must be NAME=KIND, such as T0303=inside")
    return name.upper(), kind


def _side(text: str) -> tuple[int, str]:
    if not re.fullmatch(r"\d+=(outside|inside)", text):
        raise argparse.ArgumentTypeError(
            f"{text!r} must be LINE=outside or LINE=inside, such as 12=inside"
        )
    return int(text.partition("=")[0]), text.partition("=")[2]
