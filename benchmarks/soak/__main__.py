"""Kills programs and runs lathes for months: ``python -m benchmarks.soak``, about an hour.

Each program is killed so many times, each time at a random moment, and started again; what it makes in the end must be what it
makes undisturbed, and after each kill every file must be whole. Lanes are stepped and environments are reset: memory must not
grow, and lanes must stay what their single lathes are, bit for bit. The exit status is 1 if any of this does not hold.

    python -m benchmarks.soak
    python -m benchmarks.soak --only lathes --steps 1000000
    python -m benchmarks.soak --only kills --kills 2
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from benchmarks.soak import kills, lathes
from benchmarks.soak.victims import VICTIMS, Victim, leaderboard_on
from turning_env.console import described, exits

MAX_GROWTH = 8_000_000
"""Of memory [bytes], from the first tenth of the work on, that counts as none."""
PARTS = ("kills", "lathes")


@exits(RuntimeError, interrupted="interrupted: a soak begins anew", checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Soak, print and judge; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", **described(__doc__))
    parser.add_argument("--only", choices=PARTS, help="this part alone")
    parser.add_argument("--kills", type=int, default=20, metavar="N", help="of each program (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=100_000_000, metavar="N", help="in lanes (default: %(default)s)")
    parser.add_argument("--resets", type=int, default=1_000_000, metavar="N", help="of one lathe (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the moments of the kills (default: %(default)s)")
    parsed = parser.parse_args(arguments)
    for name, least in (("kills", 1), ("steps", 10_000), ("resets", 100)):
        if getattr(parsed, name) < least:
            parser.error(f"--{name} is {getattr(parsed, name)}, but must be at least {least}")
    held = True
    if parsed.only != "lathes":
        held &= _kill_all(parsed.kills, Random(parsed.seed))
    if parsed.only != "kills":
        held &= _run_lathes(parsed.steps, parsed.resets)
    return 0 if held else 1


def _kill_all(count: int, random: Random) -> bool:
    print("| program | kills | finished though killed | files torn | other results | processes left | undisturbed [s] |")
    print("|---|---|---|---|---|---|---|")
    held = True
    with _cluster_victim() as on_cluster:
        for victim in (*VICTIMS, on_cluster):
            with TemporaryDirectory() as folder:
                toll = kills.soak(victim, count, Path(folder), random)
            figures = (toll.kills, toll.finished, toll.torn, toll.differing, toll.orphans, f"{toll.seconds:.0f}")
            print(f"| {toll.name} | {' | '.join(map(str, figures))} |", flush=True)
            held &= toll.survived
    return held


@contextmanager
def _cluster_victim() -> Iterator[Victim]:
    from distributed import LocalCluster

    settings = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with LocalCluster(**settings) as cluster:  # type: ignore[no-untyped-call]
        yield Victim("leaderboard, Dask", leaderboard_on(cluster.scheduler_address))


def _run_lathes(steps: int, resets: int) -> bool:
    print("| what | steps or resets | episodes | per second | growth of memory [MB] | lanes that differ from single lathes |")
    print("|---|---|---|---|---|---|")
    return _told("1024 lanes", lathes.steps(steps, checked=8)) & _told("resets of one lathe", lathes.resets(resets))


def _told(what: str, came: lathes.Endured) -> bool:
    figures = (came.steps, came.episodes, f"{came.steps / came.seconds:.0f}", f"{came.growth / 1e6:.1f}", came.differing)
    print(f"| {what} | {' | '.join(map(str, figures))} |", flush=True)
    return came.growth <= MAX_GROWTH and came.differing == 0


if __name__ == "__main__":
    sys.exit(main())
