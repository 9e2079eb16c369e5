"""The command ``tools`` of ``python -m turning_env``: tool libraries in and out."""

import argparse
import math
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from turning_shop import WorkshopError, aligned, refuse_existing
from turning_shop.tool_library import (
    FIELDS,
    UNITS,
    Tool,
    completed,
    csv_of,
    read_tools,
    toolbit_of,
)

from turning_env.console import DONE
from turning_env.files import replace_file


def tools(options: argparse.Namespace) -> int:
    """List tools of CSV, FreeCAD (.fctb), ISO 13399 (.p21) and advice (.toml), and convert them.

    A scenario's file stands for its tool with the cut that advise recommends. --out writes all
    tools: as a table if it ends in .csv, else as a folder with a FreeCAD tool bit per tool.

    python -m turning_env tools inserts.csv CNMG120408.p21
    python -m turning_env tools my_tool.toml inserts.csv --out Bit
    """
    library: list[Tool] = []
    for path in options.files:
        library += [_advised_tool(path)] if path.suffix == ".toml" else read_tools(path)
    print("\n".join(aligned(list(_rows(library)))))
    if options.out is None:
        return DONE
    if options.out.suffix == ".csv":
        text = csv_of(library)
        refuse_existing(options.overwrite, options.out)
        replace_file(options.out, partial(Path.write_text, data=text, encoding="utf-8"))
    else:
        _write_bits(library, options.out, options.overwrite)
    print(options.out)
    return DONE


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``tools``."""
    add = parser.add_argument
    add("files", nargs="+", type=Path, metavar="FILE", help="CSV, .fctb, .p21 or scenario's .toml")
    add("--out", type=Path, metavar="CSV|FOLDER", help="table, or folder of FreeCAD tool bits")
    add("--overwrite", action="store_true", help="replace existing files")


def _advised_tool(path: Path) -> Tool:
    """Return the tool of a scenario's file, with the advised cut."""
    from turning_shop.advise import advise
    from turning_shop.provenance import load

    scenario, evidence = load(str(path))
    for warning in evidence.warnings:
        print(f"warning: {path}: {warning}", file=sys.stderr)
    cut = advise(scenario, evidence)[0].plan.cuts
    # "CNMG120408-PM P25 in 42CrMo4", see start.py
    name, _, material = evidence.tool.partition(" in ")
    designation, _, grade = name.rpartition(" ")
    tool = Tool(
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


def _rows(tools: list[Tool]) -> Iterator[list[str]]:
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


def _write_bits(tools: list[Tool], folder: Path, overwrite: bool) -> None:
    """Write a tool bit per insert that FreeCAD has a shape for; the others are named on stderr."""
    by_designation: dict[str, list[Tool]] = {}
    for tool in tools:
        by_designation.setdefault(tool.designation, []).append(tool)
    texts: dict[Path, str] = {}
    for designation, same in by_designation.items():
        try:
            text = toolbit_of(same)
        except WorkshopError as error:
            print(f"not written: {error}", file=sys.stderr)
            continue
        name = "".join(letter if letter.isalnum() else "_" for letter in designation)
        texts[folder / f"{name}.fctb"] = text
    if not texts:
        raise WorkshopError("no tool can be written as a FreeCAD tool bit")
    refuse_existing(overwrite, *texts)
    for path, text in texts.items():
        replace_file(path, partial(Path.write_text, data=text, encoding="utf-8"))
