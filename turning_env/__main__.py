"""Looks at scenarios.

python -m turning_env presets             names of the presets
python -m turning_env show forging        every value of a preset or a TOML file, as TOML (and checks it)
python -m turning_env schema              the JSON schema of a scenario file: every field, unit, default and range
"""

import argparse
import json
import sys

from turning_env.scenario import Scenario, ScenarioError, presets


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m turning_env", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("presets")
    commands.add_parser("show").add_argument("scenario", help="preset or TOML file")
    commands.add_parser("schema")
    parsed = parser.parse_args(arguments)
    if parsed.command == "presets":
        print("\n".join(presets()))
    elif parsed.command == "schema":
        schema = Scenario.model_json_schema()
        schema["properties"]["base"] = {
            "enum": list(presets()),
            "description": "The preset from which the file states what differs.",
        }
        print(json.dumps(schema, indent=1))
    else:
        try:
            print(Scenario.load(parsed.scenario).to_toml(), end="")
        except ScenarioError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
