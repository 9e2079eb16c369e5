"""``python -m turning_env calibrate``."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from turning_env.scenario import Scenario
from turning_env.workshop.calibration.accounts import as_data, as_text
from turning_env.workshop.calibration.columns import COLUMNS, EDGE, CalibrationError
from turning_env.workshop.calibration.material import calibrate
from turning_env.workshop.calibration.reading import read_measurements
from turning_env.workshop.calibration.scenario_file import write_scenario
from turning_env.workshop.inquiry.output import write
from turning_env.workshop.inquiry.pictures import picture_path, require_matplotlib, save

_DESCRIPTION = "Fits the laws of wear, thrust force and power to measured cuts, and writes a scenario with them."
_EPILOG = """\
columns of the CSV (cells may be empty; a row counts for every law that it has all columns of):
{columns}

example:
  python -m turning_env calibrate cuts.csv --out my_tool.toml --plot residuals.png
  gymnasium.make("turning_env:RoughTurning-v0", scenario="my_tool.toml")"""


def add_to(commands: Any) -> None:
    """Add the command to argparse's subparsers."""
    columns = "\n".join(f"  {name:<14}{column.meaning} [{column.unit}]" for name, column in COLUMNS.items())
    columns += f"\n  {EDGE:<14}any name of the edge, so that its readings are not taken as independent (optional)"
    parser = commands.add_parser("calibrate", help="fit the laws to cuts measured on a machine", description=_DESCRIPTION,
                                 epilog=_EPILOG.format(columns=columns),
                                 formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("measurements", metavar="CSV", help="one cut per row")
    parser.add_argument("--out", type=Path, required=True, metavar="TOML", help="scenario file to write")
    parser.add_argument("--base", default="rough_turning", metavar="SCENARIO",
                        help="preset or TOML file for all that is not fitted (default: %(default)s)")  # fmt: skip
    parser.add_argument("--confidence", type=_confidence, default=0.95, metavar="P", help="of the intervals (default: 0.95)")
    parser.add_argument("--strict", action="store_true", help="fail if a column of the CSV tells nothing of its exponent")
    parser.add_argument("--overwrite", action="store_true", help="replace TOML if there is one")
    parser.add_argument("--plot", type=picture_path, metavar="FILE", help="draw the residuals: PNG, SVG or PDF")
    parser.add_argument("--report", type=Path, metavar="JSON", help="write what was found")
    parser.add_argument("--json", action="store_true", help="print what was found as JSON")
    parser.set_defaults(run=_calibrate)


def _confidence(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not 0.5 <= value <= 0.9999:
        raise argparse.ArgumentTypeError(f"{text} is outside the allowed range 0.5 to 0.9999")
    return value


def _calibrate(options: argparse.Namespace) -> int:
    if options.out.exists() and not options.overwrite:
        raise CalibrationError(f"{options.out} is there already; --overwrite replaces it")
    if options.plot:
        require_matplotlib()
    base = Scenario.load(options.base)
    found = calibrate(read_measurements(options.measurements), base, options.confidence, options.strict)
    write_scenario(found, options.base, Path(options.measurements).name, options.out)
    if options.plot:
        from turning_env.workshop.calibration import figure

        save(figure.draw(found), options.plot)
    account = json.dumps(as_data(found, options.measurements, options.base), indent=1, allow_nan=False)
    if options.report:
        write(options.report, lambda partial: partial.write_text(account + "\n", "utf-8"))
    for warning in found.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if options.json:
        print(account)
    else:
        print(*as_text(found), sep="\n")
        print(*(path for path in (options.out, options.plot, options.report) if path), sep="\n")
    return 0
