"""What lanes cost as they become many.

    python -m benchmarks.growth growth.svg
    python -m benchmarks.growth growth.svg --most 4096 --json

Steps per second and bytes per lane of ``RoughTurning-v0`` from 1 lane to a million, as a table and a plot. All lane counts
take turns, so that whatever else the machine does hits all alike. Bytes are what Python and NumPy have allocated once the
environment has been stepped, while nobody holds an answer.
"""

import argparse
import statistics
import sys
import tracemalloc
from collections.abc import Sequence

from matplotlib.figure import Figure

from benchmarks.throughput import MAIN, vector
from benchmarks.timing import measure
from turning_env.console import described, exits, picture_path, print_json
from turning_env.files import replace_file

LANES = (1, 8, 64, 512, 4096, 32768, 262144, 1048576)


def bytes_per_lane(num_envs: int) -> float:
    """Memory [bytes per lane] of so many lanes."""
    tracemalloc.start()
    try:
        case = vector(MAIN, num_envs, batches=1)
        case.step()
        return tracemalloc.get_traced_memory()[0] / num_envs
    finally:
        tracemalloc.stop()


@exits()
def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print and draw; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.growth", **described(__doc__))
    parser.add_argument("plot", type=picture_path, metavar="PLOT", help="file to draw to: PNG, SVG or PDF, by its suffix")
    parser.add_argument("--most", type=int, default=LANES[-1], help="most lanes (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=1, help="threads of the vector environments (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=5, help="turns that every lane count gets (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=0.25, help="length of one turn in s (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print the table as JSON")
    options = parser.parse_args(arguments)
    if min(options.most, options.threads, options.repeats) < 1 or not options.seconds > 0:
        parser.error("--most, --threads and --repeats must be at least 1, and --seconds above 0")

    counts = [lanes for lanes in LANES if lanes <= options.most]
    bytes_per_lane(1)  # what is imported and loaded at the first step belongs to no lane
    sizes = [bytes_per_lane(lanes) for lanes in counts]
    cases = [vector(MAIN, lanes, batches=2, threads=options.threads) for lanes in counts]
    measured = measure(cases, options.repeats, options.seconds)
    speeds = [statistics.median(turn.rate for turn in turns) for turns in measured]
    if options.json:
        names = ("lanes", "steps_per_second", "bytes_per_lane")
        print_json([dict(zip(names, row, strict=True)) for row in zip(counts, speeds, sizes, strict=True)])
    else:
        _print(counts, speeds, sizes)

    figure = Figure(figsize=(7, 6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.loglog(counts, speeds, "o-")
    upper.set_ylabel("steps per second")
    lower.loglog(counts, sizes, "o-")
    lower.set_ylabel("bytes per lane")
    lower.set_xlabel(f"lanes of {MAIN}")
    replace_file(options.plot, figure.savefig)
    return 0


def _print(counts: Sequence[int], speeds: Sequence[float], sizes: Sequence[float]) -> None:
    print(f"{'lanes':>8}  {'steps per second':>16}  {'ns per lane':>11}  {'bytes per lane':>14}")
    for lanes, speed, size in zip(counts, speeds, sizes, strict=True):
        print(f"{lanes:>8}  {speed:>16,.0f}  {1e9 / speed:>11,.0f}  {size:>14,.0f}")


if __name__ == "__main__":
    sys.exit(main())
