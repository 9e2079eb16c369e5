"""Carry out the command ``program``: play a part program, adapt it, and print the results.

``command`` has the options. It imports this module only when the command runs, because Shapely and
the laws take time to load.
"""

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from turning_nc import adapt, cutting, edges, moves, removal, stock
from turning_nc.dialects import DIALECTS
from turning_nc.kinds import check_called
from turning_nc.plausibility import implausible
from turning_nc.program_files import read_program
from turning_nc.report import (
    UNKNOWN_LOAD,
    Row,
    Summary,
    blocks_table,
    changes,
    comparison,
    findings,
    rows,
    summary,
)
from turning_nc.words import NcError, PartProgram, at_lines, naming
from turning_shop import refuse_existing
from turning_shop.allowed import limited_by_bending, limited_by_strength
from turning_shop.prediction import Evidence
from turning_shop.provenance import OF_PROGRAMS, load
from turning_shop.units import SYSTEMS
from turning_shop.whatif import NO_LIMIT

from turning_env.console import print_json
from turning_env.files import replace_file
from turning_env.scenario import Scenario

WARNING = "simulation output: not for a machine without review"
SCENARIO_FILE = ".toml"
"""Suffix by which --tool tells a scenario from a kind."""
MARK = ".simulated"
"""Suffix that the name of an adapted program must hold."""
FORCE_LIMIT_IS_OFF = "limits.thrust_force is off"
"""Beginning of a warning that does not apply if the strength of edges bounds the thrust force."""
POWER_LIMIT_IS_OFF = "limits.power is off"
"""Beginning of a warning that does not apply to a tool if ``--scenario`` limits the power."""


def play_program(options: argparse.Namespace) -> int:
    """Play a part program and print the results; return the exit status."""
    if options.figure:
        # Matplotlib may be missing: the error must come before anything is computed.
        import turning_nc.picture  # noqa: F401 -- imported to see whether it can be
    laws = _read_laws(options, options.scenario, nose_radius=options.nose_radius)
    tools = _Tools.of(options)
    _check_out(options)
    results = _play(options, laws, tools=tools)
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
class _Tools:
    """The kinds and the scenarios of tools that ``--tool`` states."""

    kinds: dict[str, str]  # by the names of the tools
    laws: dict[str, _Laws]

    @classmethod
    def of(cls, options: argparse.Namespace) -> "_Tools":
        """Read the options and the files that they name; two tools may share a file.

        Raises:
            NcError: a tool has two kinds or two scenarios, or a file has a fault.
        """
        kinds: dict[str, str] = {}
        files: dict[str, str] = {}
        for name, value in options.tool or ():
            is_file = value.lower().endswith(SCENARIO_FILE)
            given = files if is_file else kinds
            if name in given:
                what = "scenarios" if is_file else "kinds"
                raise NcError(
                    f"--tool states two {what} of {name}, {given[name]} and {value}: leave one out"
                )
            given[name] = value
        laws_of_file: dict[str, _Laws] = {}
        for name, file in files.items():
            if file not in laws_of_file:
                with naming(f"--tool {name}={file}"):
                    laws_of_file[file] = _read_laws(options, file)
        return cls(kinds, {name: laws_of_file[file] for name, file in files.items()})


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


def _read_laws(options: argparse.Namespace, source: str, nose_radius: float | None = None) -> _Laws:
    loaded, evidence = load(
        source,
        OF_PROGRAMS,
        nose_radius=nose_radius,
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


def _play(options: argparse.Namespace, laws: _Laws, tools: _Tools) -> _Results:
    """Read a program, remove its metal from the stock, play it, and return the results."""
    program = read_program(options.program, DIALECTS.get(options.dialect))
    reading = moves.ReadingChoices(
        go_on=options.go_on,
        unit=options.unit,
        steps=options.steps,
        radius=options.radius,
        sides=dict(options.side or ()),
    )
    with naming(options.program):
        run = moves.run(program, reading)
    notes = list(run.notes)
    with naming(options.program):
        check_called(tools.laws, {move.tool: None for move in run.moves})
    if options.stock:
        polygon = stock.read_stock(options.stock)
    else:
        polygon, guessed = stock.guessed_stock(run, tools.kinds)
        notes.append(f"no --stock is given: {guessed} is taken")
    with naming(options.program):
        removed = removal.remove(run, polygon, tools.kinds)
    notes += removed.notes
    laws = _with_bending(laws, polygon)
    own_laws: dict[str, cutting.Laws] = {}
    for names, laws_of_tools in _shared(tools.laws).items():
        limited = _with_bending(_on_machine(laws_of_tools, laws.scenario), polygon)
        own_laws |= dict.fromkeys(names, cutting.Laws(limited.scenario, limited.evidence))
        notes += [f"{' and '.join(names)}: {note}" for note in limited.notes]
        kinds = {name: removed.tools[name] for name in names}
        notes += _holder_notes(limited.scenario, kinds)
    situation = cutting.Situation(
        laws.scenario,
        _machine(options, laws.scenario),
        moves=run,
        removal=removed,
        evidence=laws.evidence,
        described=options.law_of or (),
        own_laws=own_laws,
    )
    played = cutting.play(situation, options.wear or edges.change_wear(situation))
    others = {tool: kind for tool, kind in removed.tools.items() if tool not in own_laws}
    if others:
        notes += laws.notes
        notes += _holder_notes(laws.scenario, others)
    notes += _law_notes(situation)
    notes += _chip_notes(situation)
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


def _shared(laws: Mapping[str, _Laws]) -> dict[tuple[str, ...], _Laws]:
    """Return the laws of each file by all tools that have them."""
    tools_of: dict[int, list[str]] = {}
    for name, laws_of_tool in laws.items():
        tools_of.setdefault(id(laws_of_tool), []).append(name)
    return {tuple(names): laws[names[0]] for names in tools_of.values()}


def _on_machine(laws: _Laws, machine: Scenario) -> _Laws:
    """Return a tool's laws on the spindle of ``--scenario``, which turns for all tools.

    Its limit of power holds unless that of the tool's file is lower.
    """
    power = min(laws.scenario.limits.power, machine.limits.power)
    limits = laws.scenario.limits.model_copy(update={"power": power})
    changes = {"limits": limits, "spindle": machine.spindle}
    notes = laws.notes
    if power != NO_LIMIT["power"]:
        notes = [note for note in notes if not note.startswith(POWER_LIMIT_IS_OFF)]
    return replace(laws, scenario=laws.scenario.model_copy(update=changes), notes=notes)


def _with_bending(laws: _Laws, polygon: Any) -> _Laws:
    """Return laws whose limit of the thrust force keeps a stock and the tool from bending."""
    low_z, _, high_z, radius = polygon.bounds
    scenario, note = limited_by_bending(laws.scenario, 2.0 * radius, length=high_z - low_z)
    notes = [*laws.notes, note] if note else laws.notes
    return replace(laws, scenario=scenario, notes=notes)


def _holder_notes(scenario: Scenario, kinds: Mapping[str, str]) -> list[str]:
    """Return notes on what is assumed of the holders of the tools of a scenario."""
    if scenario.file is None:
        return []
    if scenario.tool.overhang:
        if len(kinds) == 1:
            return []
        return [f"{' and '.join(kinds)} are taken to have tool.overhang (assumption)"]
    inside = [name for name, kind in kinds.items() if kind.endswith("inside")]
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


def _chip_notes(situation: cutting.Situation) -> list[str]:
    """Return notes on what is assumed of drills and threads, and on loads that are not known."""
    notes = []
    if situation.drilled.any():
        notes.append(
            "drills are taken as sharp, with two edges and a point of 118 degrees (assumption)"
        )
    if situation.threaded.any():
        notes.append(
            "threads are taken as cut by a sharp tool of 60 degrees that goes in radially "
            "(assumption)"
        )
    grooving = [tool for tool, kind in situation.removal.tools.items() if "groove" in kind]
    if (situation.engaged & np.isin(situation.tool, grooving)).any():
        notes.append(
            "the thrust of grooving tools is taken as that of turning at their feed and width "
            "(assumption: no public data were found)"
        )
    for reason, mask in situation.unknown.items():
        lines = set(situation.line[mask].tolist())
        notes.append(f"{at_lines(lines)}: {UNKNOWN_LOAD}: {reason}")
    return notes


def _laws_by_tool(options: argparse.Namespace, situation: cutting.Situation) -> dict[str, str]:
    """Return the scenario, as given, whose laws hold for each tool of the program."""
    files = {}
    for name, value in options.tool or ():
        if name in situation.own_laws and value.lower().endswith(SCENARIO_FILE):
            files[name] = value
    return {tool: files.get(tool, options.scenario) for tool in situation.by_tool}


def _machine(options: argparse.Namespace, scenario: Scenario) -> cutting.AssumedMachine:
    return cutting.AssumedMachine(
        max_spindle_speed=scenario.spindle.max_speed or cutting.AssumedMachine.max_spindle_speed,
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
        "laws": _laws_by_tool(options, results.situation),
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
    if situation.own_laws:
        for tool, scenario in _laws_by_tool(options, situation).items():
            lines.append(f"{tool}: laws and limits of {scenario}")
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
        lines += ["", f"adapted ({WARNING}): {len(adapted.changes)} words"]
        lines += changes(adapted.changes)
        lines += comparison(results.totals, adaption.totals)
    for path in (options.figure, options.out):
        if path:
            lines.append(str(path))
    print(blocks_table(situation, results.rows, units))
    print("\n".join(map(units.text, lines)))
