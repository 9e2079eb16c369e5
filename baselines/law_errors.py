"""Mean and covariance of the errors that the nominal models of a family's training jobs have.

    python -m baselines.law_errors shop

writes ``law_errors.json``, the errors that ``self_tuning`` expects of every lathe. Errors count
from the initial speed and feed, the nominal depth and half the wear criterion. Those of force and
power are correlated, as both follow from the specific cutting force.
"""

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from baselines.models.load_filter import LawErrors
from baselines.rule import Array
from turning_env import Family, ScenarioError
from turning_env.console import Parser, described, exits
from turning_env.files import write_file
from turning_env.numerics.functions import log
from turning_env.numerics.wear_term import log_wear_term, wear_term_slope
from turning_env.scenario.family import CHUNK, DrawnJobs
from turning_env.scenario.power_law import log_response

FILE = Path(__file__).with_suffix(".json")
DIGITS = 6  # decimals in the file


def read() -> LawErrors:
    """Return the errors that ship."""
    values = json.loads(FILE.read_text("utf-8"))
    return LawErrors(np.array(values["mean"]), np.array(values["covariance"]))


def errors_of(jobs: DrawnJobs) -> Array:
    """Return the errors of the nominal laws of some jobs, true less nominal.

    They have the shape (jobs, errors) and the order of ``LawErrors``.
    """
    true = jobs.true.material
    nominal = jobs.nominal.material

    def error(law: str, exponent: str) -> Any:
        return getattr(getattr(true, law), exponent) - getattr(getattr(nominal, law), exponent)

    # Errors of wear are stated as those of the edge's life: over the exponent of time.
    columns = [
        _log_error(jobs, "wear") / nominal.wear.time,
        error("wear", "cutting_speed") / nominal.wear.cutting_speed,
        error("wear", "feed") / nominal.wear.time,
    ]
    for law in ("thrust_force", "power"):
        columns.append(_log_error(jobs, law))
        columns.append(error(law, "cutting_speed"))
        columns.append(error(law, "feed"))
        columns.append(_wear_error(jobs, law))
    num_jobs = len(jobs.plan.life)
    return np.stack([np.broadcast_to(column, num_jobs) for column in columns], axis=1)


def _wear_error(jobs: DrawnJobs, name: str) -> Any:
    """Return the error of the exponent of a nominal law's wear term.

    If the laws have different terms, their slopes over log wear agree at half the criterion.
    """
    true = getattr(jobs.true.material, name)
    nominal = getattr(jobs.nominal.material, name)
    log_wear = log(0.5 * jobs.true.tool.wear_criterion)
    true_slope = wear_term_slope(true.wear_growth, log_wear)
    nominal_slope = wear_term_slope(nominal.wear_growth, log_wear)
    return true.wear * (true_slope / nominal_slope) - nominal.wear


def _log_error(jobs: DrawnJobs, law: str) -> Any:
    """Return the log ratio of a law's true and nominal responses.

    The module's description names the speed, feed, depth and wear at which it is taken.
    """
    control = jobs.true.control
    depth = jobs.true.workpiece.depth_of_cut
    criterion = jobs.true.tool.wear_criterion
    responses = {}
    for name, model in (("true", jobs.true), ("nominal", jobs.nominal)):
        power_law = getattr(model.material, law)
        log_wear = 0.0 if law == "wear" else log(0.5 * criterion)
        responses[name] = log_response(
            power_law,
            log(control.initial_cutting_speed),
            log_feed=log(control.initial_feed),
            log_depth_of_cut=log(depth),
            log_time=0.0,
            log_wear_term=log_wear_term(power_law.wear_growth, log_wear),
            log_hardness=0.0,
        )
    return responses["true"] - responses["nominal"]


@exits(ScenarioError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Write ``law_errors.json``; return the exit status."""
    parser = Parser(prog="python -m baselines.law_errors", **described(__doc__))
    parser.add_argument("family", help="family, or its TOML file")
    parsed = parser.parse_args(arguments)
    family = Family.load(parsed.family)
    chunks = []
    for chunk in range(math.ceil(family.jobs / CHUNK)):
        jobs = family.draw("train", chunk)
        chunks.append(errors_of(jobs))
    errors = np.concatenate(chunks)
    mean = errors.mean(axis=0)
    covariance = np.cov(errors, rowvar=False)
    values = {
        "family": family.name,
        "mean": mean.round(DIGITS).tolist(),
        "covariance": covariance.round(DIGITS).tolist(),
    }
    # One row of the covariance in a line.
    text = json.dumps(values).replace("], [", "],\n[") + "\n"
    write_file(FILE, text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
