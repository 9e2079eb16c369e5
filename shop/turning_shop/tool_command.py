"""The command ``tools`` of ``python -m turning_shop``: tables of tools in and out."""

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from turning_shop import WorkshopError, aligned, refuse_existing
from turning_shop.tool_library import (
    FIELDS,
    UNITS,
    LibraryTool,
    completed,
    csv_of,
    insert_of,
    read_tools,
)

from turning_env.console import DONE
from turning_env.files import replace_file


def tools(options: argparse.Namespace) -> int:
    """List tools of CSV tables and of advice (.toml), and write them into one table.

    A scenario's file stands for its tool with the cut that advise recommends.

    python -m turning_shop tools my_tool.toml inserts.csv --out library.csv
    """
    if options.out is not None and options.out.suffix != ".csv":
        raise WorkshopError(f"--out is {options.out}, but a table's name must end in .csv")
    library: list[LibraryTool] = []
    for path in options.files:
        if path.suffix == ".toml":
            library.append(_advised_tool(path))
        else:
            tools_of_file = read_tools(path)
            _warn_of_designations(path, tools_of_file)
            library += tools_of_file
    print("\n".join(aligned(list(_rows(library)))))
    if options.out is None:
        return DONE
    text = csv_of(library)
    refuse_existing(options.overwrite, options.out)
    replace_file(options.out, partial(Path.write_text, data=text, encoding="utf-8"))
    print(options.out)
    return DONE


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``tools``."""
    add = parser.add_argument
    add("files", nargs="+", type=Path, metavar="FILE", help="table, .csv, or scenario, .toml")
    add("--out", type=Path, metavar="CSV", help="table to write")
    add("--overwrite", action="store_true", help="replace existing files")


def _warn_of_designations(path: Path, library: Sequence[LibraryTool]) -> None:
    """Print a warning on each tool whose designation fills in nothing, as it is not of ISO 1832."""
    for tool in library:
        if insert_of(tool) is None:
            print(
                f"warning: {path}: {tool.designation} is no designation of ISO 1832, such as "
                "CNMG120408-PM, so that nose radius and edge length are those of the table alone",
                file=sys.stderr,
            )


def _advised_tool(path: Path) -> LibraryTool:
    """Return the tool of a scenario's file, with the advised cut."""
    from turning_shop.advise import cheapest
    from turning_shop.provenance import load

    scenario, evidence = load(str(path))
    for warning in evidence.warnings:
        print(f"warning: {path}: {warning}", file=sys.stderr)
    cut = cheapest(scenario, evidence).cuts
    # "CNMG120408-PM P25 in 42CrMo4", see start.py
    name, _, material = evidence.tool.partition(" in ")
    designation, _, grade = name.rpartition(" ")
    tool = LibraryTool(
        designation=designation or scenario.name,
        grade=grade,
        material=material,
        nose_radius=scenario.tool.nose_radius or math.nan,
        cutting_speed=float(cut.cutting_speed),
        feed=float(cut.feed),
        depth_of_cut=float(cut.depth_of_cut),
        diameter=scenario.workpiece.diameter,
    )
    return completed(tool)


def _rows(tools: list[LibraryTool]) -> Iterator[list[str]]:
    """Yield the rows of a table of tools."""
    yield [name.replace("_", " ") for name in FIELDS]
    yield [UNITS.get(name, "") for name in FIELDS]
    for tool in tools:
        yield [_shown(getattr(tool, name)) for name in FIELDS]


def _shown(value: str | float) -> str:
    """Return a cell of the table."""
    if isinstance(value, str):
        return value or "-"
    return "-" if math.isnan(value) else f"{value:.4g}"
