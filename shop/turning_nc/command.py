"""The command ``python -m turning_shop program`` and its options.

``play_command`` carries it out.
"""

import argparse
import re
from collections.abc import Callable
from pathlib import Path

from turning_nc.dialects import DIALECTS
from turning_shop.units import add_units

from turning_env.console import (
    number_within,
    picture_path,
)


def program(options: argparse.Namespace) -> int:
    r"""Play a part program on a stock, and adapt its feeds and speeds.

    Shows depth of cut, load, wear and time of every block. The program is Fanuc's (ISO) or
    SINUMERIK's. An error names words that are not understood, with their lines. Loads are nominal,
    with edges worn as at their change. Edges are changed after as many parts as 97.5 % of them
    last. Limits count as in `advise`.

    --adapt changes only F and S words, so that the program takes least time within the scenario's
    limits and without using more edges. Feeds that leave the part's surface stay, and so do the
    words of tools that the scenario does not describe. The adapted program is simulation output. Do
    not run it on a machine without review.

    python -m turning_shop program part.mpf --scenario my_tool.toml --stock bar:80x120+1 \
        --figure part.png
    python -m turning_shop program part.mpf --scenario my_tool.toml --tool T0303=boring_bar.toml \
        --adapt words --out part.simulated.mpf
    """
    from turning_nc.play_command import play_program

    return play_program(options)


def add_commands(command: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the command and its options."""
    parser = command(program, "play and adapt a part program", scenario=False)
    parser.add_argument("program", type=Path, metavar="FILE", help="part program")
    parser.add_argument(
        "--scenario",
        required=True,
        metavar="SCENARIO",
        help="preset or TOML file with the laws and limits",
    )
    _add_stock_options(parser)
    _add_reading_options(parser)
    parser.add_argument(
        "--adapt",
        choices=("words", "blocks"),
        help="adapt feeds and speeds in the program's own words, or in every block",
    )
    _add_numbers(parser)
    _add_output_options(parser)


def _add_stock_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--stock",
        metavar="STOCK",
        help=(
            "bar:DIAMETERxLENGTH or tube:OUTERxINNERxLENGTH [mm], with +FACE for metal before Z0; "
            "or a DXF or CSV file (default: a bar that the program fits in)"
        ),
    )
    parser.add_argument(
        "--tool",
        action="append",
        type=_tool,
        metavar="NAME=KIND",
        help=(
            "kind of a tool: outside, inside, left, copying, neutral, groove:WIDTH, "
            "face-groove:WIDTH, drill:DIAMETER; -left and -inside may follow "
            "(default: as it moves); or a .toml file, a scenario whose laws and limits hold "
            "for the tool (default: SCENARIO); can be repeated"
        ),
    )
    parser.add_argument(
        "--law-of",
        action="append",
        type=str.upper,
        metavar="NAME",
        help=(
            "tool whose insert the scenario describes: others keep their feeds and speeds "
            "(default: the one that turns most metal outside); can be repeated"
        ),
    )
    parser.add_argument(
        "--side",
        action="append",
        type=_side,
        metavar="LINE=SIDE",
        help=(
            "side that the G71, G72 or CYCLE95 in a line turns: outside or inside "
            "(default: as a control); can be repeated"
        ),
    )


def _add_reading_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--unit",
        choices=("mm", "inch"),
        help="unit of a program that states none (default: mm, with a note)",
    )
    parser.add_argument(
        "--steps",
        action="store_true",
        help=(
            "numbers without a decimal point count 0.001 mm or 0.0001 inch; F and S stay "
            "(default: mm or inch)"
        ),
    )
    parser.add_argument(
        "--radius",
        action="store_true",
        help="X is a radius, if the program does not state it (default: a diameter)",
    )
    parser.add_argument(
        "--dialect",
        choices=tuple(DIALECTS),
        help="control (default: by the program's own words)",
    )
    parser.add_argument(
        "--go-on",
        action="store_true",
        help="leave out words that are not understood, instead of refusing the program",
    )


def _add_numbers(parser: argparse.ArgumentParser) -> None:
    """Add the options that take a number."""
    parser.add_argument(
        "--wear",
        type=number_within(0.001, 10.0, unit="mm"),
        metavar="X",
        help=(
            "flank wear at which edges are changed [mm] "
            "(default: the highest that keeps the limits, up to the wear criterion)"
        ),
    )
    parser.add_argument(
        "--life",
        type=number_within(0.01, 100.0, unit=""),
        default=1.0,
        metavar="X",
        help=("edges that the adapted program may use, over those before (default: %(default)g)"),
    )
    parser.add_argument(
        "--max-feed",
        type=number_within(0.001, 10.0, unit="mm/rev"),
        metavar="X",
        help="highest feed of the inserts [mm/rev] (default: the scenario's)",
    )
    parser.add_argument(
        "--nose-radius",
        type=number_within(0.05, 10.0, unit="mm"),
        metavar="X",
        help=(
            "nose radius of the inserts without a scenario of their own [mm]: "
            "the feed is at most half of it"
        ),
    )
    parser.add_argument(
        "--roughness",
        type=number_within(0.1, 1000.0, unit="um"),
        metavar="X",
        help="highest theoretical roughness Rt, feed^2 / (8 nose radius) [um] (default: none)",
    )


def _add_output_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="adapted program to write; its name must hold .simulated",
    )
    parser.add_argument("--force", action="store_true", help="adapt a program that is implausible")
    parser.add_argument("--overwrite", action="store_true", help="replace existing files")
    parser.add_argument(
        "--figure",
        type=picture_path,
        metavar="FILE",
        help="picture of stock, passes and load: PNG, SVG or PDF",
    )
    add_units(parser)
    parser.add_argument("--json", action="store_true", help="print all results as JSON")


def _tool(text: str) -> tuple[str, str]:
    name, _, kind = text.partition("=")
    name = name.strip()
    kind = kind.strip()
    if not (name and kind):
        raise argparse.ArgumentTypeError(
            f"{text!r} must be NAME=KIND or NAME=FILE.toml, such as T0303=inside"
        )
    return name.upper(), kind


def _side(text: str) -> tuple[int, str]:
    match = re.fullmatch(r"(\d+)=(outside|inside)", text)
    if match is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} must be LINE=outside or LINE=inside, such as 12=inside"
        )
    return int(match[1]), match[2]
