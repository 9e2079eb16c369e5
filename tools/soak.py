"""Kill programs at random moments, and step environments for months of cutting: an hour.

Kills: SIGKILL, which no program can catch, ends each program, which is then started again. After
each kill, every file must be readable and no process may be left. The final results must equal
those of an undisturbed run.

Steps: environments are stepped and reset in one process. Memory must not grow, and the environments
of a batch must match single ones bit for bit.

The exit status is 1 if any of this does not hold.

    python -m tools.soak
    python -m tools.soak --only steps --steps 1000000
    python -m tools.soak --only kills --kills 2
"""

import argparse
import csv
import json
import lzma
import os
import signal
import sys
import time
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from baselines import tune as rule_tuning
from leaderboard import __main__ as leaderboard_command
from train import ppo, tune
from train.run import Run
from train.training import train
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.console import described, exits, positive

Program = Callable[
    [Path], int
]  # a function that fills a folder, or continues to fill it, and returns the exit status

SCENARIO = Scenario.model_validate(
    {"name": "short", "tool": {"wear_criterion": 0.1}, "control": {"time_limit": 2.0}}
)
LOG = ".log"  # output of a program, in its folder
MIN_STEPS = 10_000  # of a batch: memory counts from a tenth of them on, at least one call of step
MAX_GROWTH = 8_000_000  # growth of memory that is tolerated [bytes]
MAX_SECONDS = 600.0  # time after which a program counts as hung [s]
MAX_ORPHAN_SECONDS = 30.0  # time within which the processes of a killed program must end [s]


def training(folder: Path) -> int:
    """Train PPO for a few seconds, with eight checkpoints."""
    small = {
        "num_envs": 8,
        "n_steps": 64,
        "batch_size": 256,
        "n_epochs": 2,
        "total_timesteps": 4096,
    }
    train(
        Run.plan("ppo", "RoughTurning-v0", SCENARIO, 0, folder, "soak", small),
        ppo.ALGORITHM,
        checkpoint_every=512,
    )
    return 0


def tuning_of_rules(folder: Path) -> int:
    """Search for the parameters of two rules."""
    words = ["--scenario", _scenario(folder), "--rules", "fixed_tuned", "rescaled_grid_search"]
    return rule_tuning.main(
        [*words, "--trials", "10", "--seeds", "4", "--out", str(folder / "tuned" / "short.json")]
    )


def tuning_of_an_agent(folder: Path) -> int:
    """Search for PPO's hyperparameters, which trains an agent per setting."""
    words = [
        "--algorithm",
        "ppo",
        "--scenario",
        _scenario(folder),
        "--steps",
        "4096",
        "--trials",
        "3",
    ]
    return tune.main([*words, "--runs", str(folder / "runs")])


def leaderboard(folder: Path, more: Sequence[str] = ()) -> int:
    """Play a few rules."""
    words = [
        "run",
        "--results",
        str(folder / "results"),
        "--env",
        "RoughTurning-Override-v1",
        "--seeds",
        "16",
        *more,
    ]
    rules = ["constant_force_limit", "programmed_feed", "fuzzy_override", "omative", "tmac"]
    return leaderboard_command.main([*words, "--policies", *rules])


def _scenario(folder: Path) -> str:
    path = (
        folder.parent / "short.toml"
    )  # beside the folders, because written files contain its path
    SCENARIO.save(path)
    return str(path)


PROGRAMS: dict[str, Program] = {
    "training": training,
    "tuning of rules": tuning_of_rules,
    "tuning of an agent": tuning_of_an_agent,
    "leaderboard": leaderboard,
    "leaderboard, 2 processes": partial(leaderboard, more=("--jobs", "2")),
}


@dataclass
class Toll:
    """Outcome of the kills of a program, and the duration of its undisturbed run [s]."""

    kills: int = 0
    torn: int = 0  # files that cannot be read
    differing: int = 0  # results
    orphans: int = 0  # processes that survive
    seconds: float = 0.0


def kill(program: Program, kills: int, folder: Path, random: Random) -> Toll:
    """Kill a program ``kills`` times, each in a new folder and at a random moment of its duration.

    Each time it is started again, and its results are compared with those of an undisturbed run.

    Raises:
        RuntimeError: the program fails although it was not killed.
    """
    toll = Toll()
    _started(
        _nothing, folder / "warm"
    ).join()  # the server of processes imports all that is needed, once
    start = time.monotonic()
    _finish(program, folder / "undisturbed")
    toll.seconds = time.monotonic() - start
    expected = contents(folder / "undisturbed")
    while toll.kills < kills:
        here = folder / f"killed{toll.kills}"
        process = _started(program, here)
        process.join(random.uniform(0.0, toll.seconds))
        if process.is_alive():
            toll.kills += 1
            toll.orphans += not _killed(process)
            toll.torn += len(unreadable(here))
        _finish(program, here)
        toll.differing += contents(here) != expected
    return toll


def _started(program: Program, folder: Path) -> BaseProcess:
    folder.mkdir(parents=True, exist_ok=True)
    # The server has no threads or other state that a fork would break.
    context = get_context("forkserver")
    context.set_forkserver_preload(["tools.soak"])
    process = context.Process(target=_run, args=(program, folder))
    process.start()
    return process


def _nothing(folder: Path) -> int:
    return 0


def _run(program: Program, folder: Path) -> None:
    os.setsid()  # it and its processes are a group
    with (folder / LOG).open("a", encoding="utf-8") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        sys.exit(program(folder))


def _killed(process: BaseProcess) -> bool:
    """Kill a process, but not its children; return whether these end by themselves."""
    assert process.pid is not None
    process.kill()
    process.join()
    deadline = time.monotonic() + MAX_ORPHAN_SECONDS
    while time.monotonic() < deadline:
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    return False


def _finish(program: Program, folder: Path) -> None:
    process = _started(program, folder)
    process.join(MAX_SECONDS)
    if process.exitcode != 0:
        process.kill()
        said = (folder / LOG).read_text("utf-8").strip().splitlines()[-5:]
        raise RuntimeError(f"it ended with status {process.exitcode}: " + "\n".join(said))


def files(folder: Path) -> Iterator[Path]:
    """Yield the result files, without hidden ones, which are being written, and TensorBoard's."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        if (
            path.is_file()
            and "tensorboard" not in parts
            and not any(part.startswith(".") for part in parts)
        ):
            yield path


def unreadable(folder: Path) -> list[str]:
    """Return the files that cannot be read to their end, each with the reason."""
    complaints = []
    for path in files(folder):
        try:
            _read(path)
        except Exception as error:  # of any reader
            complaints.append(f"{path}: {error!r}")
            print(complaints[-1], file=sys.stderr)
    return complaints


def contents(folder: Path) -> dict[str, str]:
    """Return digests of the files, without times and journals, which also hold killed trials."""
    found = {}
    for path in files(folder):
        if path.suffix != ".log" and path.name != "run.json":
            content = path.read_bytes()
            with suppress(Exception):  # unreadable files differ
                content = _read(path)
            found[str(path.relative_to(folder))] = sha256(content).hexdigest()
    return found


def _read(path: Path) -> bytes:
    """Read a file to its end and return the content that must be equal in all runs."""
    content = path.read_bytes()
    if not content:
        raise ValueError("it is empty")
    match path.suffix:
        case ".xz":
            json.loads(lzma.decompress(content, format=lzma.FORMAT_XZ))
        case ".json":
            json.loads(content)
        case ".html" if not content.rstrip().endswith(b"</html>"):
            raise ValueError("it has no end")
        case ".csv":
            rows = list(csv.DictReader(content.decode("utf-8").splitlines()))
            return json.dumps(
                [{key: float(row[key]) for key in row if key != "wall_time"} for row in rows]
            ).encode()
        case ".zip":
            # A model of Stable-Baselines3: weights and optimisers' states; the rest names times.
            with zipfile.ZipFile(path) as archive:
                return b"".join(
                    archive.read(name)
                    for name in sorted(archive.namelist())
                    if name.endswith((".pth", ".pt"))
                )
    return content


class Endured(NamedTuple):
    """Outcome of long use."""

    steps: int
    episodes: int
    growth: int  # of memory after the first tenth [bytes]
    seconds: float
    differing: int  # environments that differ from single ones


def step_long(count: int, num_envs: int = 1024, checked: int = 8) -> Endured:
    """Step a batch with random actions, ``count`` steps of single environments in all.

    The first ``checked`` environments are compared with single ones of the same seeds and actions,
    bit for bit, at every step.
    """
    import psutil  # type: ignore[import-untyped]

    env = RoughTurningVectorEnv(num_envs)
    env.reset(seed=0)
    singles = [RoughTurningEnv() for _ in range(checked)]
    ended = np.zeros(checked, np.bool_)
    for seed, single in enumerate(singles):
        single.reset(seed=seed)
    random = np.random.default_rng(0)
    apart: set[int] = set()
    steps = max(1, count // num_envs)
    episodes = num_envs
    settled = 0
    process, start = psutil.Process(), time.perf_counter()
    for number in tqdm(range(steps), desc=f"{num_envs} environments", disable=None):
        if number == steps // 10:
            settled = process.memory_info().rss
        actions = random.uniform(-1.0, 1.0, (num_envs, 2)).astype(np.float32)
        observations, _, terminated, truncated, _ = env.step(actions)
        episodes += int(np.count_nonzero(terminated | truncated))
        for index, single in enumerate(singles):
            if ended[index]:  # the batch's next step is a reset
                observation, ended[index] = single.reset()[0], False
            else:
                observation, _, worn, late, _ = single.step(actions[index])
                ended[index] = worn or late
            if (
                observation.tobytes() != observations[index].tobytes()
                or ended[index] != (terminated | truncated)[index]
            ):
                apart.add(index)
    growth, seconds = process.memory_info().rss - settled, time.perf_counter() - start
    env.close()
    return Endured(steps * num_envs, episodes, growth, seconds, len(apart))


@exits(RuntimeError, interrupted="interrupted: run it again from the start", checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Soak, print and judge; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.soak", **described(__doc__))
    parser.add_argument("--only", choices=("kills", "steps"), help="run this part alone")
    parser.add_argument(
        "--kills",
        type=positive,
        default=20,
        metavar="N",
        help="kills of each program (default: %(default)s)",
    )
    parser.add_argument(
        "--steps",
        type=int,
        default=100_000_000,
        metavar="N",
        help="steps of a batch (default: %(default)s)",
    )
    parsed = parser.parse_args(arguments)
    if parsed.steps < MIN_STEPS:
        parser.error(f"--steps is {parsed.steps}, but must be at least {MIN_STEPS}")
    held = True
    if parsed.only != "steps":
        held &= _kill_all(parsed.kills, Random(0))
    if parsed.only != "kills":
        came = step_long(parsed.steps)
        print(
            "\n| steps | episodes | per second | growth [MB] "
            "| differing from single environments |\n"
            "|---|---|---|---|---|"
        )
        rate, growth = f"{came.steps / came.seconds:.0f}", f"{came.growth / 1e6:.1f}"
        print(f"| {came.steps} | {came.episodes} | {rate} | {growth} | {came.differing} |")
        held &= came.growth <= MAX_GROWTH and came.differing == 0
    return 0 if held else 1


def _kill_all(kills: int, random: Random) -> bool:
    print(
        "| program | kills | files torn | other results | processes left | undisturbed [s] |\n"
        "|---|---|---|---|---|---|"
    )
    held = True
    with ExitStack() as stack:
        programs = dict(PROGRAMS)
        with suppress(ModuleNotFoundError):  # Dask is optional
            from distributed import LocalCluster

            local: Callable[..., LocalCluster] = LocalCluster
            cluster = stack.enter_context(
                local(n_workers=2, threads_per_worker=1, dashboard_address=None)
            )
            programs["leaderboard, Dask"] = partial(
                leaderboard, more=("--scheduler", cluster.scheduler_address)
            )
        for name, program in programs.items():
            with TemporaryDirectory() as folder:
                toll = kill(program, kills, Path(folder), random)
            figures = (toll.kills, toll.torn, toll.differing, toll.orphans, f"{toll.seconds:.0f}")
            print(f"| {name} | {' | '.join(map(str, figures))} |", flush=True)
            held &= toll.torn == toll.differing == toll.orphans == 0
    return held


if __name__ == "__main__":
    from tools import soak  # under the name by which other processes know it

    sys.exit(soak.main())
