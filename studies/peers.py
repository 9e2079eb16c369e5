"""Compare environment steps per second with other environments; ``--out`` writes peers.md and peers.png.

    python -m studies.peers --out docs

It measures this project and every peer that runs here, in one process. Install the peers with ``pip install -e
'.[peers]'``. All cases take turns, so other load on the machine affects them equally. Ratios are taken within a turn. Steps per
CPU second show which case used more than one core or waited for one. Actions are random and drawn beforehand. Resets count.
"""

import argparse
import importlib
import os
import platform
import statistics
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium

from studies.throughput import MAIN, single, vector
from studies.timing import Case, Timing, many, measure, one
from turning_env import IDS
from turning_env.console import described, exits
from turning_env.files import replace_file

NUM_ENVS = (1, 16, 256, 4096, 65536)
REFERENCE = "Gymnasium Pendulum, unwrapped"
OURS = "RoughTurning"
_SCAN = 64  # steps in one call of a compiled loop


def gymnasium_cases() -> Iterator[Case]:
    """Yield cases of Gymnasium's own environments."""
    yield one(REFERENCE, gymnasium.make("Pendulum-v1").unwrapped)
    yield one("Gymnasium Pendulum", gymnasium.make("Pendulum-v1"))
    for num_envs in NUM_ENVS:
        env = gymnasium.make_vec("CartPole-v1", num_envs, vectorization_mode="vector_entry_point")
        env.reset(seed=0)
        yield many("Gymnasium CartPole, vector", env, num_envs, env.single_action_space)


def our_cases() -> Iterator[Case]:
    """Yield cases of this project."""
    yield single(MAIN)._replace(name=f"{MAIN}, unwrapped")
    yield one(MAIN, gymnasium.make(MAIN))
    for env_id in IDS:
        for num_envs in NUM_ENVS if env_id == MAIN else (1024,):
            yield vector(env_id, num_envs)._replace(name=f"{env_id}, vector")


def envpool_cases() -> Iterator[Case]:
    """Yield cases of EnvPool on one thread."""
    envpool = importlib.import_module("envpool")
    for num_envs in NUM_ENVS[1:-1]:
        env = envpool.make_gymnasium("Pendulum-v1", num_envs=num_envs, num_threads=1)
        env.reset()
        yield many("EnvPool Pendulum, 1 thread", env, num_envs, env.action_space)


def gymnax_cases() -> Iterator[Case]:
    """Yield cases of gymnax: a compiled loop over steps and random actions."""
    jax, gymnax = importlib.import_module("jax"), importlib.import_module("gymnax")
    env, parameters = gymnax.make("Pendulum-v1")

    def step(state: Any, key: Any) -> tuple[Any, Any]:
        act, move = jax.random.split(key)
        _, state, reward, *_ = env.step(move, state, env.action_space(parameters).sample(act), parameters)
        return state, reward

    def scan(states: Any, key: Any) -> Any:
        def all_envs(states: Any, key: Any) -> Any:
            return jax.vmap(step)(states, jax.random.split(key, jax.tree_util.tree_leaves(states)[0].shape[0]))

        return jax.lax.scan(all_envs, states, jax.random.split(key, _SCAN))

    compiled_scan = jax.jit(scan)

    for num_envs in NUM_ENVS[2:]:
        key = jax.random.PRNGKey(0)
        _, states = jax.vmap(env.reset, in_axes=(0, None))(jax.random.split(key, num_envs), parameters)

        def run(states: Any = states, key: Any = key) -> None:
            jax.block_until_ready(compiled_scan(states, key))

        yield Case("gymnax Pendulum, scan", num_envs, num_envs * _SCAN, run)


def motor_cases() -> Iterator[Case]:
    """Yield a case of gym-electric-motor, the nearest field."""
    motor = importlib.import_module("gym_electric_motor")
    yield one("gym-electric-motor Cont-CC-PMSM", motor.make("Cont-CC-PMSM-v0"))


PEERS: dict[str, Callable[[], Iterator[Case]]] = {
    "gymnasium": gymnasium_cases,
    "envpool": envpool_cases,
    "gymnax": gymnax_cases,
    "gym_electric_motor": motor_cases,
}
"""Cases of each peer, by module."""


def runnable_cases(report: Callable[[str], None]) -> dict[str, list[Case]]:
    """Return the cases of each peer that runs here, by module; pass the reason for each other peer to ``report``."""
    cases: dict[str, list[Case]] = {}
    for module, peer in PEERS.items():
        try:
            found = list(peer())
            for case in found:
                case.step()  # some fail only here
            cases[module] = found
        except ImportError as error:
            report(f"left out: {module}: {error}")
        except Exception as error:  # a failing peer must not stop the others
            report(f"left out: {module} does not run here: {type(error).__name__}: {error}")
    return cases


def versioned(module: str) -> str:
    """Return a module's name and version; the name alone if it was not installed as a package."""
    try:
        return f"{module} {version(module)}"
    except PackageNotFoundError:
        return module


class Row(NamedTuple):
    """A case's medians over the turns and the range of its ratio."""

    name: str
    num_envs: int
    rate: float
    cpu_rate: float
    ratio: float
    lowest: float
    highest: float


def rows_of(cases: Sequence[Case], timings: Sequence[Sequence[Timing]]) -> list[Row]:
    """Return the table; ratios are to ``REFERENCE`` in the same turn."""
    reference = [case.name for case in cases].index(REFERENCE)
    rows = []
    for case, turns in zip(cases, timings, strict=True):
        ratios = [turn.rate / base.rate for turn, base in zip(turns, timings[reference], strict=True)]
        rate, cpu_rate = (statistics.median(getattr(turn, name) for turn in turns) for name in ("rate", "cpu_rate"))
        rows.append(Row(case.name, case.num_envs, rate, cpu_rate, statistics.median(ratios), min(ratios), max(ratios)))
    return rows


def machine() -> str:
    """Return processor, cores, system and Python."""
    model = platform.processor() or platform.machine()
    information = Path("/proc/cpuinfo")
    if information.exists():
        lines = [line for line in information.read_text("utf-8").splitlines() if line.startswith("model name")]
        model = lines[0].partition(":")[2].strip() if lines else model
    return f"{model}, {os.cpu_count()} logical cores, {platform.system()}, Python {platform.python_version()}"


def page(rows: Sequence[Row], versions: Sequence[str], command: str, left_out: Sequence[str]) -> str:
    """Return the table as Markdown."""
    lines = [
        "# Speed compared with other environments",
        "",
        "This page compares environment steps per second, resets included. All cases take turns; the table shows medians over",
        f"the turns. Ratios are to `{REFERENCE}` in the same turn, with their range over the turns. Quote the ratios. One",
        "step of `RoughTurning-v0` is a second of turning in ten sub-steps.",
        "",
        "```bash",
        command,
        "```",
        "",
        f"Machine: {machine()}. Versions: {', '.join(versions)}.",
        "",
        "| Case | environments | steps per second | per CPU second | ratio |",
        "|---|---:|---:|---:|---:|",
    ]
    for row in rows:
        ratio = f"{row.ratio:.3g} ({row.lowest:.3g} to {row.highest:.3g})"
        name = f"**{row.name}**" if row.name.startswith(OURS) else row.name
        lines.append(f"| {name} | {row.num_envs} | {_rounded(row.rate)} | {_rounded(row.cpu_rate)} | {ratio} |")
    lines += ["", "![Steps per second over environments](peers.png)", ""]
    lines += [f"- {reason}" for reason in left_out]
    return "\n".join(lines).rstrip() + "\n"


def _rounded(rate: float) -> str:
    for unit, name in ((1e6, " M"), (1e3, " k")):
        if rate >= unit:
            return f"{rate / unit:.3g}{name}"
    return f"{rate:.3g}"


def plot(rows: Sequence[Row], path: Path) -> None:
    """Plot steps per second: a line per case with several numbers of environments, and below, a point for each other case."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import EngFormatter

    from turning_shop import plot_style as style

    cases = {name: [row for row in rows if row.name == name] for name in dict.fromkeys(row.name for row in rows)}
    lines = {name: found for name, found in cases.items() if len(found) > 1}
    points = sorted(
        (row for found in cases.values() if len(found) == 1 for row in found), key=lambda row: (-row.num_envs, row.rate)
    )
    others = iter(style.LINES[1:])
    with style.for_print():
        figure = Figure(figsize=(style.DOUBLE, 6.2), layout="constrained")
        upper, lower = (part.subplots() for part in figure.subfigures(2, 1, squeeze=False, height_ratios=(3, 2))[:, 0])
        for name, found in lines.items():
            colour, dashes = style.LINES[0] if name.startswith(OURS) else next(others)
            upper.plot(
                [row.num_envs for row in found],
                [row.rate for row in found],
                color=colour,
                linestyle=dashes,
                marker="o",
                markersize=3,
            )
            end = found[-1]
            upper.annotate(name, (end.num_envs, end.rate), (7, 0), textcoords="offset points", va="center", color=colour)
        upper.set(xscale="log", yscale="log", xlabel="environments side by side", ylabel="environment steps per second")
        upper.set_xticks(NUM_ENVS, [str(num_envs) for num_envs in NUM_ENVS])
        upper.set_xlim(right=100 * NUM_ENVS[-1])  # room for the names
        upper.set_title("Many environments side by side", loc="left")
        for place, row in enumerate(points):
            colour = style.BLUE if row.name.startswith(OURS) else style.BLACK
            lower.plot(row.rate, place, "o", color=colour, markersize=5)
            lower.annotate(_rounded(row.rate), (row.rate, place), (7, 0), textcoords="offset points", va="center", color=colour)
        lower.set(xscale="log", xlabel="environment steps per second")
        lower.set_yticks(range(len(points)), [f"{row.name}: {row.num_envs}" for row in points])
        lower.set_title("One number of environments, which stands behind the name", loc="left")
        lower.xaxis.set_major_formatter(EngFormatter(sep=" "))
        upper.yaxis.set_major_formatter(EngFormatter(sep=" "))
        lower.margins(x=0.12)
        for axes in (upper, lower):
            axes.minorticks_off()
            axes.grid(alpha=0.4)
        style.save(figure, path)


@exits()
def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print and write; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.peers", **described(__doc__))
    parser.add_argument("--repeats", type=int, default=7, help="turns of every case (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=0.3, help="length of one turn in s (default: %(default)s)")
    parser.add_argument("--out", type=Path, help="folder for peers.md and peers.png (default: only print)")
    options = parser.parse_args(arguments)
    if options.repeats < 1 or not options.seconds > 0:
        parser.error("--repeats must be at least 1, and --seconds above 0")
    left_out: list[str] = []
    peers = runnable_cases(left_out.append)
    cases = [*chain.from_iterable(peers.values()), *our_cases()]
    rows = rows_of(cases, measure(cases, options.repeats, options.seconds))
    command = " ".join(["python -m studies.peers", *(sys.argv[1:] if arguments is None else arguments)])
    versions = [versioned(name) for name in (*peers, "rough-turning")]
    text = page(rows, versions, command, left_out)
    print(text, end="")
    if options.out is not None:
        plot(rows, options.out / "peers.png")
        replace_file(options.out / "peers.md", lambda path: path.write_text(text, "utf-8"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
