"""Looks at scenarios, makes them from measurements, and asks what their laws say.

python -m turning_env presets             names of the presets
python -m turning_env show forging        every value of a preset or a TOML file, as TOML (and checks it)
python -m turning_env schema              the JSON schema of a scenario file: every field, unit, default and range
python -m turning_env calibrate cuts.csv --out my_tool.toml                          a scenario from measured cuts
python -m turning_env whatif my_tool.toml --cutting-speed 150 --feed 0.3 --wear 0.2  force, power, wear, tool life
python -m turning_env map my_tool.toml --wear 0.2 --out map.png                      where an edge may work
"""

import argparse
import json
import os
import sys

from turning_env.scenario import Scenario, ScenarioError, presets


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    from turning_env.calibration import command as calibration
    from turning_env.calibration.columns import CalibrationError
    from turning_env.inquiry import command as inquiry
    from turning_env.inquiry.output import OutputError

    parser = argparse.ArgumentParser(
        prog="python -m turning_env", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("presets", help="names of the presets").set_defaults(run=_presets)
    show = commands.add_parser("show", help="every value of a scenario")
    show.add_argument("scenario", help="preset or TOML file")
    show.set_defaults(run=_show)
    commands.add_parser("schema", help="the JSON schema of a scenario file").set_defaults(run=_schema)
    calibration.add_to(commands)
    inquiry.add_to(commands)
    parsed = parser.parse_args(arguments)
    try:
        status: int = parsed.run(parsed)
        sys.stdout.flush()
    except BrokenPipeError:  # whoever reads the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        return 130
    except (ScenarioError, CalibrationError, inquiry.InquiryError, OutputError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return status


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
