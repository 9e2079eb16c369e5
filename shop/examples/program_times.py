"""Measure how long part programs of several kinds take to read and play, by their number of moves.

    python -m shop.examples.program_times
    python -m shop.examples.program_times --adapt words

It prints a Markdown table: seconds of processor time, also for each 1,000 straight moves (arcs are
run as chords), and the highest memory of the process so far. The time must grow in proportion to
the moves.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable

from turning_nc.adapt import adapt
from turning_nc.cutting import AssumedMachine, Situation, play
from turning_nc.edges import beyond, change_wear
from turning_nc.moves import run
from turning_nc.plausibility import implausible
from turning_nc.removal import remove
from turning_nc.report import blocks_table, findings, rows, summary
from turning_nc.stock import read_stock
from turning_nc.words import divide

from turning_env import Scenario
from turning_env.console import described, exits

if sys.platform != "win32":
    import resource

STOCK = "bar:60x200"
MOVES = (1_000, 10_000)  # lengths of the programs
LENGTH = 150.0  # of the turned part [mm]
HEAD = "G21 G99 T0101\nG50 S3000\nG96 S150 M3\nG0 X62. Z2.\n"


def passes(moves: int) -> str:
    """Return passes along the bar, each deeper than the one before."""
    count = moves // 4
    blocks = []
    for number in range(count):
        diameter = 60.0 - 40.0 * (number + 1) / count
        away = diameter + 2.0
        blocks.append(f"G0 X{diameter:.4f}")
        blocks.append(f"G1 Z-{LENGTH} F0.25")
        blocks.append(f"G0 X{away:.4f}")
        blocks.append("Z2.")
    return HEAD + "\n".join(blocks)


def zigzag(moves: int) -> str:
    """Return cuts along the bar in both directions."""
    blocks = []
    for number in range(moves // 2):
        diameter = 60.0 - 80.0 * (number + 1) / moves
        end = 2.0 if number % 2 else -LENGTH
        blocks.append(f"G1 X{diameter:.4f} F0.2")
        blocks.append(f"Z{end}")
    return HEAD + "\n".join(blocks)


def contour(moves: int) -> str:
    """Return a finishing cut along a wave of short moves, as CAM systems write it."""
    blocks = ["G0 X40.", "G1 Z0. F0.1"]
    for number in range(moves):
        z = LENGTH * (number + 1) / moves
        diameter = 45.0 - 8.0 * math.sin(z / 7.0)
        blocks.append(f"X{diameter:.4f} Z-{z:.4f}")
    return HEAD + "\n".join(blocks)


def grooves(moves: int) -> str:
    """Return plunges of a grooving tool beside each other."""
    count = moves // 3
    blocks = []
    for number in range(count):
        z = 5.0 + (LENGTH - 10.0) * (number + 1) / count
        bottom = 40.0 + 5.0 * math.sin(number)
        blocks.append(f"G0 Z-{z:.4f}")
        blocks.append(f"G1 X{bottom:.3f} F0.1")
        blocks.append("G0 X62.")
    return HEAD + "\n".join(blocks)


def arcs(moves: int) -> str:
    """Return a row of small arcs."""
    count = moves // 2
    width = LENGTH / count
    radius = max(width, 0.2)
    blocks = ["G0 X50.", "G1 Z0. F0.1"]
    for number in range(count):
        middle = width * (number + 0.5)
        end = width * (number + 1)
        blocks.append(f"G3 X50. Z-{middle:.5f} R{radius:.4f}")
        blocks.append(f"G2 X50. Z-{end:.5f} R{radius:.4f}")
    return HEAD + "\n".join(blocks)


def air(moves: int) -> str:
    """Return moves beside the bar."""
    blocks = ["G1 X59. F0.2", "Z-10."]
    blocks += [
        f"G1 X{70 + number % 7}. Z2.\nG0 X{80 + number % 5}. Z-100." for number in range(moves // 2)
    ]
    return HEAD + "\n".join(blocks)


def loop(moves: int) -> str:
    """Return passes that a loop of the program makes."""
    body = f"#1=#1-{160.0 / moves:.6f}\nG0 X#1\nG1 Z-{LENGTH} F0.2\nG0 X[#1+2.]\nZ2."
    return f"{HEAD}#1=60.\nWHILE [#1 GT 20.] DO1\n{body}\nEND1"


def cycles(moves: int) -> str:
    """Return roughing and finishing cycles of contours below each other."""
    count = max(moves // 60, 1)
    depth = 36.0 / count
    blocks = []
    for number in range(count):
        first = 2 * number + 1
        last = 2 * number + 2
        diameter = 60.0 - depth * number
        start = diameter + 1.0
        bottom = diameter - depth
        blocks.append(f"G0 X{start:.3f} Z2.")
        blocks.append(f"G71 U{depth / 6.0:.4f} R0.3")
        blocks.append(f"G71 P{first} Q{last} U0.02 W0.01 F0.25")
        blocks.append(f"N{first} G0 X{bottom:.3f}")
        blocks.append("G1 Z-50.")
        blocks.append(f"X{diameter:.3f} Z-100.")
        blocks.append(f"N{last} Z-{LENGTH}")
        blocks.append(f"G70 P{first} Q{last}")
    return HEAD + "\n".join(blocks)


KINDS: dict[str, Callable[[int], str]] = {
    kind.__name__: kind for kind in (passes, zigzag, contour, grooves, arcs, air, loop, cycles)
}


def measure(text: str, scenario: Scenario, adapted: str | None) -> tuple[int, float]:
    """Read, play and report on a program; return its straight moves and the processor time [s]."""
    begin = time.process_time()
    moves = run(divide(text))
    removal = remove(moves, read_stock(STOCK))
    situation = Situation(scenario, AssumedMachine(), moves, removal)
    played = play(situation, change_wear(situation))
    beyond(situation, played)
    implausible(situation, played)
    summary(situation, played)
    blocks = rows(situation, played)
    blocks_table(situation, blocks)
    findings(blocks)
    if adapted:
        adapt(situation, None, "blocks" if adapted == "blocks" else "words")
    seconds = time.process_time() - begin
    return sum(len(move.path.points()) for move in moves.moves), seconds


@exits()
def main(arguments: list[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        prog="python -m shop.examples.program_times", **described(__doc__)
    )
    parser.add_argument("--adapt", choices=("words", "blocks"), help="also adapt feeds and speeds")
    options = parser.parse_args(arguments)
    scenario = Scenario.load("rough_turning")
    print(
        "| Program | Straight moves | Time [s] | Per 1,000 moves [s] | Memory [MB] |\n"
        "|---|---|---|---|---|"
    )
    for kind, program in KINDS.items():
        for moves in MOVES:
            count, seconds = measure(program(moves), scenario, options.adapt)
            print(
                f"| {kind} | {count:,} | {seconds:.1f} "
                f"| {1000.0 * seconds / count:.2f} | {highest_memory()} |",
                flush=True,
            )
    return 0


def highest_memory() -> str:
    """Return the highest memory of this process so far [MB], where the system tells."""
    if sys.platform == "win32":
        return "-"
    return f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000.0:.0f}"


if __name__ == "__main__":
    sys.exit(main())
