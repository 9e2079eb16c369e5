"""Looks at scenarios, makes them from measurements, and asks what their laws say.

python -m turning_env presets
python -m turning_env show forging
python -m turning_env schema
python -m turning_env calibrate cuts.csv --out my_tool.toml
python -m turning_env whatif my_tool.toml --cutting-speed 150 --feed 0.3 --wear 0.2
python -m turning_env map my_tool.toml --wear 0.2 --out map.png
"""

import argparse
import json
import sys
from collections.abc import Callable

from turning_env.scenario import Scenario, ScenarioError, presets

_PRESETS = """Names of the presets, one per line.

    python -m turning_env presets
"""
_SHOW = """Every value of a scenario, as TOML. A TOML file is checked so, too.

    python -m turning_env show forging
"""
_SCHEMA = """The JSON schema of a scenario file: every field with unit, default and range.

    python -m turning_env schema
"""


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    from turning_env.console import described, exits
    from turning_env.workshop.calibration import command as calibration
    from turning_env.workshop.calibration.columns import CalibrationError
    from turning_env.workshop.inquiry import command as inquiry
    from turning_env.workshop.inquiry.output import OutputError

    parser = argparse.ArgumentParser(prog="python -m turning_env", **described(__doc__))
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    listed = commands.add_parser("presets", help="names of the presets", **described(_PRESETS))
    listed.set_defaults(run=_presets)
    show = commands.add_parser("show", help="every value of a preset or a TOML file, as TOML", **described(_SHOW))
    show.add_argument("scenario", metavar="SCENARIO", help="preset or TOML file")
    show.set_defaults(run=_show)
    schema = commands.add_parser("schema", help="the JSON schema of a scenario file", **described(_SCHEMA))
    schema.set_defaults(run=_schema)
    calibration.add_to(commands)
    inquiry.add_to(commands)
    parsed = parser.parse_args(arguments)
    command: Callable[[argparse.Namespace], int] = parsed.run
    return exits(ScenarioError, CalibrationError, inquiry.InquiryError, OutputError)(command)(parsed)


def _presets(_: argparse.Namespace) -> int:
    print("\n".join(presets()))
    return 0


def _show(options: argparse.Namespace) -> int:
    print(Scenario.load(options.scenario).to_toml(), end="")
    return 0


def _schema(_: argparse.Namespace) -> int:
    schema = Scenario.model_json_schema()
    schema["properties"]["base"] = {
        "enum": list(presets()),
        "description": "The preset from which the file states what differs.",
    }
    print(json.dumps(schema, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
