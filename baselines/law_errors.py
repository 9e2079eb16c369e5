"""Mean and covariance of the errors that the nominal models of a family's training jobs have.

    python -m baselines.law_errors shop

writes ``law_errors.json``, what ``self_tuning`` expects of every lathe. Errors count from the initial speed and feed, the nominal
depth and half the wear criterion. Those of force and power are correlated, as both follow from the specific cutting force.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from baselines.models.load_filter import LawErrors
from baselines.rule import Array
from turning_env import Family, ScenarioError
from turning_env.console import described, exits
from turning_env.files import replace_file
from turning_env.numerics.functions import log
from turning_env.scenario.family import CHUNK, DrawnJobs
from turning_env.scenario.power_law import log_response

FILE = Path(__file__).with_suffix(".json")


def read() -> LawErrors:
    """Return the errors that ship."""
    values = json.loads(FILE.read_text("utf-8"))
    return LawErrors(np.array(values["mean"]), np.array(values["covariance"]))


def errors_of(draw: DrawnJobs) -> Array:
    """Return the errors of some jobs, shape (jobs, errors), in the order of ``LawErrors``."""
    true, nominal = draw.true.material, draw.nominal.material
    control, depth = draw.true.control, draw.true.workpiece.depth_of_cut
    place = log(control.initial_cutting_speed), log(control.initial_feed), log(depth), 0.0

    def bias(law: str) -> Any:
        wear = 0.0 if law == "wear" else log(0.5 * draw.true.tool.wear_criterion)
        responses = [
            log_response(getattr(model, law), *place, wear, 0.0) for model in (true, nominal)
        ]  # type: ignore[no-untyped-call]
        return responses[0] - responses[1]

    def error(law: str, exponent: str) -> Any:
        return getattr(getattr(true, law), exponent) - getattr(getattr(nominal, law), exponent)

    wear = nominal.wear
    found = [
        bias("wear") / wear.time,
        error("wear", "cutting_speed") / wear.cutting_speed,
        error("wear", "feed") / wear.time,
    ]
    for law in ("thrust_force", "power"):
        found += [
            bias(law),
            *(error(law, exponent) for exponent in ("cutting_speed", "feed", "wear")),
        ]
    return np.stack([np.broadcast_to(each, len(draw.plan.life)) for each in found], axis=1)


@exits(ScenarioError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Write the file; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m baselines.law_errors", **described(__doc__))
    parser.add_argument("family", help="family, or its TOML file")
    family = Family.load(parser.parse_args(arguments).family)
    errors = np.concatenate(
        [errors_of(family.draw("train", chunk)) for chunk in range(-(-family.jobs // CHUNK))]
    )
    mean, covariance = (
        found.round(6).tolist() for found in (errors.mean(axis=0), np.cov(errors, rowvar=False))
    )
    values = {"family": family.name, "mean": mean, "covariance": covariance}
    replace_file(
        FILE,
        lambda path: path.write_text(json.dumps(values).replace("], [", "],\n[") + "\n", "utf-8"),
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
