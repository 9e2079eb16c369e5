"""``python -m turning_env whatif`` and ``python -m turning_env map``."""

import argparse
from typing import Any

import numpy as np

from turning_env.scenario import Scenario
from turning_env.workshop.inquiry import table
from turning_env.workshop.inquiry.pictures import picture_path, require_matplotlib, save
from turning_env.workshop.inquiry.whatif import what_if

MAX_CUTS = 100_000
"""Rows that a table may have."""
_RANGES = {
    "--cutting-speed": ("m/min", 0.1, 5000),
    "--feed": ("mm/rev", 0.001, 10),
    "--depth": ("mm", 0.01, 50),
    "--hardness": ("of nominal", 0.1, 10),
    "--time": ("min", 1e-4, 1e5),
    "--wear": ("mm", 1e-4, 5),
}
_WHATIF_EXAMPLE = """\
example:
  python -m turning_env whatif rough_turning --cutting-speed 120 150 180 --feed 0.2:0.4:0.1 --wear 0.2

Nominal: bars and edges are as told, none harder or quicker to wear. Speed, feed and depth are constant from the fresh edge on."""
_MAP_EXAMPLE = """\
example:
  python -m turning_env map rough_turning --wear 0.2 --out map.png"""


class InquiryError(ValueError):
    """A question that cannot be answered."""


def add_to(commands: Any) -> None:
    """Add both commands to argparse's subparsers."""
    shape: dict[str, Any] = {"formatter_class": argparse.RawDescriptionHelpFormatter}
    whatif = commands.add_parser("whatif", help="force, power, wear and tool life at given speeds and feeds",
                                 description="A table of cuts: one row for every combination of what is listed.",
                                 epilog=_WHATIF_EXAMPLE, **shape)  # fmt: skip
    whatif.add_argument("scenario", metavar="SCENARIO", help="preset or TOML file")
    for option, default in (("--cutting-speed", None), ("--feed", None), ("--depth", "the scenario's"), ("--hardness", "1")):
        whatif.add_argument(option, nargs="+", type=_numbers(option), required=default is None, metavar="X",
                            help=_described(option, "numbers or LOW:HIGH:STEP", default))  # fmt: skip
    age = whatif.add_mutually_exclusive_group(required=True)
    for option, what in (("--time", "for which the edge has cut"), ("--wear", "that the edge has")):
        age.add_argument(option, nargs="+", type=_numbers(option), metavar="X", help=_described(option, what))
    form = whatif.add_mutually_exclusive_group()
    form.add_argument("--json", dest="form", action="store_const", const=table.as_json, help="print JSON")
    form.add_argument("--csv", dest="form", action="store_const", const=table.as_csv, help="print CSV")
    whatif.set_defaults(run=_whatif, form=table.as_text)

    chart = commands.add_parser("map", help="picture of where an edge may work, with removal rate and tool life",
                                description="Draws the machine's range of cutting speed and feed.",
                                epilog=_MAP_EXAMPLE, **shape)  # fmt: skip
    chart.add_argument("scenario", metavar="SCENARIO", help="preset or TOML file")
    chart.add_argument("--wear", type=_number("--wear"), required=True, metavar="X", help=_described("--wear", "of the edge"))
    chart.add_argument("--depth", type=_number("--depth"), metavar="X", help=_described("--depth", "", "the scenario's"))
    chart.add_argument("--hardness", type=_number("--hardness"), default=1.0, metavar="X", help=_described("--hardness", "", "1"))
    chart.add_argument("--out", type=picture_path, required=True, metavar="FILE", help="PNG, SVG or PDF, by the name's ending")
    chart.set_defaults(run=_map)


def _described(option: str, what: str, default: str | None = None) -> str:
    unit = _RANGES[option][0]
    return f"{what} [{unit}]".strip() + (f" (default: {default})" if default else "")


def _number(option: str) -> Any:
    """A parser of one number within the option's range."""
    unit, low, high = _RANGES[option]

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is outside the allowed range {low:g} to {high:g} {unit}")
        return value

    return parse


def _numbers(option: str) -> Any:
    """A parser of a number, or of ``LOW:HIGH:STEP``, into a list."""
    one = _number(option)

    def parse(text: str) -> list[float]:
        if ":" not in text:
            return [one(text)]
        try:
            low, high, step = (float(part) for part in text.split(":"))
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is neither a number nor LOW:HIGH:STEP") from None
        if not (0 < step < float("inf") and low <= high):
            raise argparse.ArgumentTypeError(f"{text!r} must go up: LOW:HIGH:STEP with a step above 0")
        one(str(low)), one(str(high))
        count = (high - low) / step * (1 + 1e-9) + 1
        if count > MAX_CUTS:
            raise argparse.ArgumentTypeError(f"{text!r} are more than {MAX_CUTS} numbers")
        # Rounded, so that 0.1:0.3:0.1 does not give 0.30000000000000004.
        return [round(low + index * step, 12) for index in range(int(count))]

    return parse


def _whatif(options: argparse.Namespace) -> int:
    scenario = Scenario.load(options.scenario)
    axes = [
        [value for given in values for value in given]
        for values in (
            options.depth or [[scenario.workpiece.depth_of_cut]],
            options.hardness or [[1.0]],
            options.time or options.wear,
            options.cutting_speed,
            options.feed,
        )
    ]
    rows = int(np.prod([len(axis) for axis in axes]))
    if rows > MAX_CUTS:
        raise InquiryError(f"these are {rows} cuts, and a table may have {MAX_CUTS}: take larger steps")
    depth, hardness, age, speed, feed = np.meshgrid(*axes, indexing="ij")
    asked = {"time": age} if options.time else {"wear": age}
    print(options.form(what_if(scenario, speed, feed, depth, hardness, **asked)))
    return 0


def _map(options: argparse.Namespace) -> int:
    scenario = Scenario.load(options.scenario)
    criterion = scenario.tool.wear_criterion
    if options.wear > criterion:
        raise InquiryError(f"--wear is {options.wear:g}, but an edge is finished at tool.wear_criterion, {criterion:g} mm")
    require_matplotlib()
    from turning_env.workshop.inquiry import operating_map

    save(operating_map.draw(scenario, options.wear, options.depth, options.hardness), options.out)
    print(options.out)
    return 0
