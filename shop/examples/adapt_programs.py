"""Adapt every part program of shop/examples/programs to the scenario `rough_turning`.

Prints the times before and after.

python -m shop.examples.adapt_programs
python -m shop.examples.adapt_programs --max-feed 0.4 --adapt blocks
"""

import argparse
import sys
import tomllib
from pathlib import Path

from turning_nc.adapt import adapt
from turning_nc.cutting import AssumedMachine, Situation, play
from turning_nc.edges import change_wear
from turning_nc.moves import run
from turning_nc.removal import remove
from turning_nc.report import summary
from turning_nc.stock import read_stock
from turning_nc.words import read_program_file

from turning_env import Scenario
from turning_env.console import described, number_within

FOLDER = Path(__file__).parent / "programs"
COLLECTION = tomllib.loads(
    (FOLDER / "collection.toml").read_text("utf-8")
)  # stock and tools of each program
SCENARIO = Scenario.load("rough_turning")


def path_of(name: str) -> Path:
    """Return the file of a program."""
    return next(path for path in FOLDER.glob(f"{name}.*") if path.suffix in (".nc", ".mpf"))


def situation_of(name: str, machine: AssumedMachine | None = None) -> Situation:
    """Return a program on its stock."""
    entry = COLLECTION[name]
    program = read_program_file(path_of(name))
    moves = run(program)
    stock = read_stock(entry["stock"])
    removal = remove(moves, stock, entry.get("tools", {}))
    return Situation(SCENARIO, machine or AssumedMachine(), moves, removal)


def main() -> int:
    """Print a line per program, and the totals."""
    parser = argparse.ArgumentParser(
        prog="python -m shop.examples.adapt_programs", **described(__doc__)
    )
    parser.add_argument(
        "--adapt", choices=("words", "blocks"), default="words", help="default: %(default)s"
    )
    parser.add_argument(
        "--max-feed",
        type=number_within(0.01, 10.0, "mm/rev"),
        default=10.0,
        help="highest feed [mm/rev]",
    )
    options = parser.parse_args()
    totals = [0.0, 0.0]
    print(
        f"{'program':<24}{'before':>9}{'after':>9}{'saved':>10}"
        f"{'load before':>13}{'after':>7}{'life':>7}"
    )
    for name in COLLECTION:
        situation = situation_of(name, AssumedMachine(max_feed=options.max_feed))
        before = summary(situation, play(situation, change_wear(situation)))
        adapted = adapt(situation, None, options.adapt)
        after = summary(adapted.situation, adapted.played)
        life = sum(after.used_life.values()) / sum(before.used_life.values())
        print(
            f"{name:<24}{before.time:>7.1f} s{after.time:>7.1f} s"
            f"{100 * (1 - after.time / before.time):>8.1f} %"
            f"{100 * before.max_load:>11.0f} %{100 * after.max_load:>5.0f} %{100 * life:>5.0f} %"
        )
        if before.max_load <= 1.0:
            totals = [totals[0] + before.time, totals[1] + after.time]
    saved = 100 * (1 - totals[1] / totals[0])
    print(
        f"all that kept the limits before: {totals[0]:.0f} s before, {totals[1]:.0f} s after: "
        f"{saved:.1f} % saved"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
