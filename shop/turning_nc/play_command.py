"""Carry out the command ``program``: play a part program, adapt it, and print the results.

``command`` has the options. It imports this module only when the command runs, because Shapely and
the laws take time to load.
"""

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from turning_nc import adapt, cutting, edges, moves, removal, stock
from turning_nc.dialects import DIALECTS
from turning_nc.plausibility import implausible
from turning_nc.program_files import read_program
from turning_nc.report import Row, Summary, changes, comparison, findings, rows, summary, table
from turning_nc.words import NcError, PartProgram, naming
from turning_shop import refuse_existing
from turning_shop.allowed import limited_by_bending, limited_by_strength
from turning_shop.prediction import Evidence
from turning_shop.provenance import OF_PROGRAMS, load
from turning_shop.units import SYSTEMS

from turning_env.console import print_json
from turning_env.files import replace_file
from turning_env.scenario import Scenario

WARNING = "simulation output: not for a machine without review"
MARK = ".simulated"
"""Suffix that the name of an adapted program must hold."""
FORCE_LIMIT_IS_OFF = "limits.thrust_force is off"
"""Beginning of a warning that does not apply if the strength of edges bounds the thrust force."""


def play_program(options: argparse.Namespace) -> int:
    """Play a part program and print the results; return the exit status."""
    if options.figure:
        # Matplotlib may be missing: the error must come before anything is computed.
        import turning_nc.picture  # noqa: F401 -- imported to see whether it can be
    laws = _read_laws(options)
    _check_out(options)
    results = _play(options, laws)
    if results.implausible and options.adapt and not options.force:
        listed = "".join(f"\n  {name}: {text}" for name, text in results.implausible.items())
        raise NcError(
            f"{options.program}: nothing is adapted, because the program is implausible; "
            f"--force adapts it:{listed}"
        )
    adaption = _adapt(options, results.situation) if options.adapt else None
    if options.figure:
        _draw(options, results)
    if adaption and options.out:
        data = adaption.adapted.text.encode("latin-1")
        replace_file(options.out, lambda partial: partial.write_bytes(data))
    if options.json:
        print_json(_as_json(options, results, adaption=adaption))
        return 0
    _print(options, results, adaption=adaption)
    return 0


@dataclass(frozen=True)
class _Laws:
    """A scenario, and what is known of its laws."""

    scenario: Scenario
    evidence: Evidence
    notes: list[str]


@dataclass(frozen=True)
class _Results:
    """A played program and what is said about it."""

    program: PartProgram
    situation: cutting.Situation
    played: cutting.Play
    implausible: Mapping[str, str]
    rows: list[Row]
    totals: Summary
    notes: list[str]


@dataclass(frozen=True)
class _Adaption:
    """An adapted program."""

    adapted: adapt.Adapted
    totals: Summary
    notes: list[str]


def _read_laws(options: argparse.Namespace) -> _Laws:
    loaded, evidence = load(
        options.scenario,
        OF_PROGRAMS,
        nose_radius=options.nose_radius,
        is_simulated=False,
        roughness=options.roughness,
    )
    scenario, strength_note = limited_by_strength(loaded)
    wear_criterion = scenario.tool.wear_criterion
    if options.wear is not None and options.wear > wear_criterion:
        raise NcError(
            f"--wear is {options.wear:g} mm, but at most the wear criterion, {wear_criterion:g} mm"
        )
    notes = list(evidence.warnings)
    if strength_note:
        notes = [note for note in notes if not note.startswith(FORCE_LIMIT_IS_OFF)]
        notes.append(strength_note)
    return _Laws(scenario, evidence, notes=notes)


def _check_out(options: argparse.Namespace) -> None:
    """Check the files to write before anything is computed."""
    refuse_existing(options.overwrite, options.out, options.figure)
    if options.out is None:
        return
    if not options.adapt:
        raise NcError("--out needs --adapt: only an adapted program is written")
    if MARK not in options.out.suffixes:
        wanted = options.program.with_suffix(f"{MARK}{options.program.suffix}").name
        raise NcError(
            f"--out {options.out}: its name must hold {MARK}, such as {wanted}, "
            "so that nobody takes it for a tried program"
        )


def _play(options: argparse.Namespace, laws: _Laws) -> _Results:
    """Read a program, remove its metal from the stock, play it, and return the results."""
    program = read_program(options.program, DIALECTS.get(options.dialect))
    reading = moves.Reading(
        go_on=options.go_on,
        unit=options.unit,
        steps=options.steps,
        radius=options.radius,
        sides=dict(options.side or ()),
    )
    with naming(options.program):
        run = moves.run(program, reading)
    notes = list(run.notes)
    tools = dict(options.tool or ())
    if options.stock:
        polygon = stock.read_stock(options.stock)
    else:
        polygon, guessed = stock.guessed_stock(run, tools)
        notes.append(f"no --stock is given: {guessed} is taken")
    with naming(options.program):
        removed = removal.remove(run, polygon, tools)
    notes += removed.notes
    low_z, _, high_z, radius = polygon.bounds
    scenario, bending_note = limited_by_bending(laws.scenario, 2.0 * radius, length=high_z - low_z)
    situation = cutting.Situation(
        scenario,
        _machine(options, scenario),
        moves=run,
        removal=removed,
        evidence=laws.evidence,
        described=options.law_of or (),
    )
    played = cutting.play(situation, options.wear or edges.change_wear(situation))
    notes += laws.notes
    if bending_note:
        notes.append(bending_note)
    notes += _holder_notes(scenario, removed)
    notes += _law_notes(situation)
    notes += edges.beyond(situation, played)
    return _Results(
        program=program,
        situation=situation,
        played=played,
        implausible=implausible(situation, played),
        rows=rows(situation, played),
        totals=summary(situation, played),
        notes=notes,
    )


def _holder_notes(scenario: Scenario, removed: removal.Removal) -> list[str]:
    """Return notes on what is assumed of the tools' holders."""
    if scenario.file is None:
        return []
    if scenario.tool.overhang:
        many = len(removed.tools) > 1
        return ["all tools are taken to have tool.overhang (assumption)"] if many else []
    inside = [name for name, kind in removed.tools.items() if kind.endswith("inside")]
    if not inside:
        return []
    return [
        f"{', '.join(inside)}: boring bars are taken as rigid (assumption), "
        "as your files do not state tool.overhang"
    ]


def _law_notes(situation: cutting.Situation) -> list[str]:
    """Return a note on tools that cut metal, but that the scenario does not describe."""
    others = set(situation.tool[situation.engaged & ~situation.is_described].tolist())
    if not others:
        return []
    described = " and ".join(situation.described) or "no tool"
    return [
        f"the scenario is taken to describe the insert of {described} (assumption; --law-of sets "
        f"it); loads and wear of {', '.join(sorted(others))} follow the same laws"
    ]


def _machine(options: argparse.Namespace, scenario: Scenario) -> cutting.Machine:
    return cutting.Machine(
        max_spindle_speed=scenario.spindle.max_speed or cutting.Machine.max_spindle_speed,
        max_feed=options.max_feed or math.inf,
    )


def _adapt(options: argparse.Namespace, situation: cutting.Situation) -> _Adaption:
    adapted = adapt.adapt(
        situation,
        options.wear,
        where=options.adapt,
        life=options.life,
    )
    beyond = edges.beyond(adapted.situation, adapted.played)
    return _Adaption(
        adapted,
        totals=summary(adapted.situation, adapted.played),
        notes=[f"adapted, {note}" for note in beyond],
    )


def _draw(options: argparse.Namespace, results: _Results) -> None:
    from turning_nc import picture

    from turning_env.rendering import plot_style

    title = f"{options.program.name}, {results.situation.scenario.name}"
    units = SYSTEMS[options.units]
    figure = picture.draw(results.situation, results.played, title=title, units=units)
    plot_style.save(figure, options.figure)


def _as_json(
    options: argparse.Namespace, results: _Results, adaption: _Adaption | None
) -> dict[str, Any]:
    """Return the results for ``print_json``."""
    sides = {}
    for line, side in results.situation.moves.sides.items():
        sides[line] = {"side": side.name, "why": side.why}
    output: dict[str, Any] = {
        "program": options.program,
        "dialect": results.program.dialect.name,
        "scenario": results.situation.scenario.name,
        "totals": results.totals,
        "blocks": results.rows,
        "sides": sides,
        "warnings": results.implausible,
        "notes": results.notes + (adaption.notes if adaption else []),
    }
    if adaption:
        output["adapted"] = {
            "totals": adaption.totals,
            "changes": adaption.adapted.changes,
            "warning": WARNING,
        }
    return output


def _print(options: argparse.Namespace, results: _Results, adaption: _Adaption | None) -> None:
    """Print the results as text."""
    situation = results.situation
    units = SYSTEMS[options.units]
    lines = [""]
    lines += results.totals.lines()
    lines += findings(results.rows)
    for line, side in situation.moves.sides.items():
        hint = "; --side sets it" if side.is_settable else ""
        lines.append(f"line {line} turns {side.name}, {side.why}{hint}")
    for name, text in results.implausible.items():
        lines.append(f"warning: {name}: {text}")
    notes = list(results.notes)
    if adaption:
        notes += adaption.notes
    lines += [f"note: {note}" for note in notes]
    if adaption:
        adapted = adaption.adapted
        nose_radius = situation.scenario.tool.nose_radius or None
        lines += ["", f"adapted ({WARNING}): {len(adapted.changes)} words"]
        lines += changes(adapted.changes, nose_radius)
        lines += comparison(results.totals, adaption.totals)
    for path in (options.figure, options.out):
        if path:
            lines.append(str(path))
    print(table(situation, results.rows, units))
    print("\n".join(map(units.text, lines)))
