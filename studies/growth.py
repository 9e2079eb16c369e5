"""Measure how speed and memory grow with the number of environments.

    python -m studies.growth growth.svg
    python -m studies.growth growth.svg --max-envs 4096 --json

It prints and plots steps per second and bytes per environment of ``RoughTurning-v0``, from 1 environment to a million. All
batches take turns, so other load on the machine affects them equally. Bytes are what Python and NumPy have allocated after a
step.
"""

import argparse
import statistics
import sys
import tracemalloc
from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from studies.throughput import MAIN, vector
from studies.timing import measure
from turning_env.console import described, exits, picture_path, print_json
from turning_shop import plot_style as style

NUM_ENVS = (1, 8, 64, 512, 4096, 32768, 262144, 1048576)


def bytes_per_env(num_envs: int) -> float:
    """Return the memory of a vector environment [bytes per environment]."""
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
    parser = argparse.ArgumentParser(prog="python -m studies.growth", **described(__doc__))
    parser.add_argument("plot", type=picture_path, metavar="PLOT", help="file to draw to: PNG, SVG or PDF, by its suffix")
    parser.add_argument("--max-envs", type=int, default=NUM_ENVS[-1], help="largest batch (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=1, help="threads of the vector environments (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=5, help="turns that each batch gets (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=0.25, help="length of one turn in s (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print the table as JSON")
    options = parser.parse_args(arguments)
    if min(options.max_envs, options.threads, options.repeats) < 1 or not options.seconds > 0:
        parser.error("--max-envs, --threads and --repeats must be at least 1, and --seconds above 0")

    counts = [num_envs for num_envs in NUM_ENVS if num_envs <= options.max_envs]
    bytes_per_env(1)  # loads everything that belongs to no environment
    sizes = [bytes_per_env(num_envs) for num_envs in counts]
    cases = [vector(MAIN, num_envs, batches=2, threads=options.threads) for num_envs in counts]
    measured = measure(cases, options.repeats, options.seconds)
    speeds = [statistics.median(turn.rate for turn in turns) for turns in measured]
    if options.json:
        names = ("num_envs", "steps_per_second", "bytes_per_env")
        print_json([dict(zip(names, row, strict=True)) for row in zip(counts, speeds, sizes, strict=True)])
    else:
        _print(counts, speeds, sizes)

    with style.for_print():
        style.save(draw(counts, speeds, sizes), options.plot)
    return 0


def draw(counts: Sequence[int], speeds: Sequence[float], sizes: Sequence[float]) -> Figure:
    """Return a figure of steps per second and bytes per environment, with numbers at the ends."""
    figure = Figure(figsize=(style.DOUBLE, 2.8), layout="constrained")
    panels = figure.subplots(1, 2)
    for axes, values, title, unit in zip(panels, (speeds, sizes), ("speed", "memory"), ("", "B"), strict=True):
        axes.loglog(counts, values, **style.OURS)
        axes.set_title(f"{title}: {'bytes per environment' if unit else 'environment steps per second'}", loc="left")
        named = EngFormatter(unit, sep=" ")
        for end, place, across in ((0, (8, 0), "left"), (-1, (0, 7), "center")):
            text = named(float(f"{values[end]:.2g}"))
            axes.annotate(text, (counts[end], values[end]), place, textcoords="offset points", ha=across)
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        axes.yaxis.set_major_formatter(named)
        axes.margins(0.1, 0.15)
        axes.minorticks_off()
        axes.grid(alpha=0.4)
        axes.set_xlabel(f"environments of {MAIN} side by side")
    return figure


def _print(counts: Sequence[int], speeds: Sequence[float], sizes: Sequence[float]) -> None:
    print(f"{'environments':>12}  {'steps per second':>16}  {'ns per step':>11}  {'bytes per environment':>14}")
    for num_envs, speed, size in zip(counts, speeds, sizes, strict=True):
        print(f"{num_envs:>12}  {speed:>16,.0f}  {1e9 / speed:>11,.0f}  {size:>14,.0f}")


if __name__ == "__main__":
    sys.exit(main())
