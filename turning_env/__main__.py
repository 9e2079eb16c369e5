"""Show presets, and every value of a scenario.

python -m turning_env show
python -m turning_env show forging
"""

import argparse
import sys

from turning_env.console import Parser, described, exits, print_json
from turning_env.scenario import Scenario, ScenarioError, presets


@exits(ScenarioError)
def main(arguments: list[str] | None = None) -> int:
    """Run a command and return its exit status."""
    parser = Parser(prog="python -m turning_env", **described(__doc__))
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    show = commands.add_parser(
        "show",
        help="print presets, or all values of a scenario",
        **described(_show.__doc__),
    )
    show.set_defaults(run=_show)
    show.add_argument("scenario", metavar="SCENARIO", nargs="?", help="preset or TOML file")
    show.add_argument("--schema", action="store_true", help="print the JSON schema of its file")

    options = parser.parse_args(arguments)
    status: int = options.run(options)
    return status


def _show(options: argparse.Namespace) -> int:
    """Print every value of a scenario as TOML, which also checks a file.

    Without a scenario, print the names of the presets, one per line. With --schema, print the JSON
    schema of a scenario file: every field with its unit, default and range.

    python -m turning_env show
    python -m turning_env show forging
    python -m turning_env show --schema
    """
    if options.schema:
        print_json(_schema())
    elif options.scenario is None:
        print("\n".join(presets()))
    else:
        print(Scenario.load(options.scenario).to_toml(), end="")
    return 0


def _schema() -> dict[str, object]:
    """Return the JSON schema of a scenario file."""
    schema: dict[str, dict[str, object]] = Scenario.model_json_schema()
    # Files may have these two keys, which are no fields of a scenario.
    schema["properties"]["calibration"] = {
        "type": "object",
        "description": "How the laws were measured; calibrate writes it.",
    }
    schema["properties"]["base"] = {
        "anyOf": [{"enum": list(presets())}, {"type": "string", "pattern": r"\.toml$"}],
        "description": (
            "The preset, or the TOML file seen from this one's folder, whose values the file "
            "changes."
        ),
    }
    return dict(schema)


if __name__ == "__main__":
    sys.exit(main())
