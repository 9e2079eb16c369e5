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
from numpy.typing import NDArray
from tqdm import tqdm

from leaderboard import __main__ as leaderboard_command
from train import ppo, tune
from train.run import Run
from train.training import train
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.console import described, exits, positive

# A function that fills a folder, or continues to fill it, and returns the exit status.
Program = Callable[[Path], int]

SCENARIO = Scenario.model_validate(
    {"name": "short", "tool": {"wear_criterion": 0.1}, "control": {"time_limit": 2.0}}
)
LOG = ".log"  # output of a program, in its folder
MIN_STEPS = 10_000  # of a batch: memory counts from a tenth of them on, at least one call of step
MAX_GROWTH = 8_000_000  # growth of memory that is tolerated [bytes]
MAX_SECONDS = 600.0  # time after which a program counts as hung [s]
MAX_ORPHAN_SECONDS = 30.0  # time within which the processes of a killed program must end [s]
POLL_SECONDS = 0.02  # time between two looks at the processes of a killed program [s]


def training(folder: Path) -> int:
    """Train PPO for a few seconds, with eight checkpoints."""
    settings = {
        "num_envs": 8,
        "n_steps": 64,
        "batch_size": 256,
        "n_epochs": 2,
        "total_timesteps": 4096,
    }
    train(
        Run.plan(
            "ppo",
            "RoughTurning-v0",
            scenario=SCENARIO,
            seed=0,
            runs=folder,
            command="soak",
            given=settings,
        ),
        ppo.ALGORITHM,
        checkpoint_every=512,
    )
    return 0


def tuning_of_rules(folder: Path) -> int:
    """Search for the parameters of two rules."""
    words = [
        "rules",
        "--scenario",
        _scenario(folder),
        "--rules",
        "fixed_tuned",
        "rescaled_grid_search",
        "--trials",
        "10",
        "--seeds",
        "4",
        "--out",
        str(folder / "tuned" / "short.json"),
    ]
    return tune.main(words)


def tuning_of_an_agent(folder: Path) -> int:
    """Search for PPO's hyperparameters, which trains an agent per setting."""
    words = [
        "agent",
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
    # Written files contain its path, so all folders of a program share it.
    path = folder.parent / "short.toml"
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
    orphans: int = 0  # kills that processes of the program survive
    seconds: float = 0.0

    @property
    def is_clean(self) -> bool:
        """Whether the kills have harmed nothing."""
        return self.torn == 0 and self.differing == 0 and self.orphans == 0


def kill(program: Program, kills: int, folder: Path, random: Random) -> Toll:
    """Kill a program ``kills`` times, each in a new folder and at a random moment of its duration.

    Each time it is started again, and its results are compared with those of an undisturbed run.

    Raises:
        RuntimeError: the program fails although it was not killed.
    """
    toll = Toll()
    # The server of processes imports all that is needed once, before times are measured.
    _started(_nothing, folder / "warm").join()
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
            toll.orphans += not _kill_alone(process)
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
    # It and its children are a process group, whose id is its own.
    os.setsid()
    with (folder / LOG).open("a", encoding="utf-8") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        sys.exit(program(folder))


def _kill_alone(process: BaseProcess) -> bool:
    """Kill a process, but not its children; return whether these end by themselves."""
    assert process.pid is not None
    group = process.pid
    process.kill()
    process.join()
    deadline = time.monotonic() + MAX_ORPHAN_SECONDS
    while time.monotonic() < deadline:
        try:
            # Signal 0 does nothing, but fails once the group has no process.
            os.killpg(group, 0)
        except ProcessLookupError:
            return True
        time.sleep(POLL_SECONDS)
    with suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)
    return False


def _finish(program: Program, folder: Path) -> None:
    process = _started(program, folder)
    process.join(MAX_SECONDS)
    if process.exitcode != 0:
        process.kill()
        lines = (folder / LOG).read_text("utf-8").strip().splitlines()
        last_lines = "\n".join(lines[-5:])
        raise RuntimeError(f"it ended with status {process.exitcode}: {last_lines}")


def files(folder: Path) -> Iterator[Path]:
    """Yield the result files, without hidden ones, which are being written, and TensorBoard's."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        is_hidden = any(part.startswith(".") for part in parts)
        if path.is_file() and not is_hidden and "tensorboard" not in parts:
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
    digests = {}
    for path in files(folder):
        if path.suffix != ".log" and path.name != "run.json":
            content = path.read_bytes()
            with suppress(Exception):  # unreadable files differ
                content = _read(path)
            name = str(path.relative_to(folder))
            digests[name] = sha256(content).hexdigest()
    return digests


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
            return _without_times(content)
        case ".zip":
            return _weights(path)
    return content


def _without_times(content: bytes) -> bytes:
    """Return the numbers of a CSV file but for the wall time."""
    rows = []
    for row in csv.DictReader(content.decode("utf-8").splitlines()):
        numbers = {key: float(value) for key, value in row.items() if key != "wall_time"}
        rows.append(numbers)
    return json.dumps(rows).encode()


def _weights(path: Path) -> bytes:
    """Return weights and optimisers' states of a model of Stable-Baselines3; the rest has times."""
    weights = []
    with zipfile.ZipFile(path) as archive:
        for name in sorted(archive.namelist()):
            if name.endswith((".pth", ".pt")):
                weights.append(archive.read(name))
    return b"".join(weights)


class Endured(NamedTuple):
    """Outcome of long use."""

    steps: int
    episodes: int
    growth: int  # of memory after the first tenth [bytes]
    seconds: float
    differing: int  # environments that differ from single ones

    @property
    def is_clean(self) -> bool:
        """Whether memory is bounded and all environments match single ones."""
        return self.growth <= MAX_GROWTH and self.differing == 0


@dataclass
class Single:
    """A single environment that is stepped beside an environment of a batch."""

    env: RoughTurningEnv
    ended: bool = False

    def step(self, action: NDArray[np.float32]) -> NDArray[np.float32]:
        """Take a step as a batch does, a reset after the end; return the observation."""
        if self.ended:
            observation, _ = self.env.reset()
            self.ended = False
            return observation
        observation, _, terminated, truncated, _ = self.env.step(action)
        self.ended = terminated or truncated
        return observation


def step_long(count: int, num_envs: int = 1024, checked: int = 8) -> Endured:
    """Step a batch with random actions, ``count`` steps of single environments in all.

    The first ``checked`` environments are compared with single ones of the same seeds and actions,
    bit for bit, at every step.
    """
    import psutil  # type: ignore[import-untyped]  # only this part needs it

    env = RoughTurningVectorEnv(num_envs)
    env.reset(seed=0)
    singles = [Single(RoughTurningEnv()) for _ in range(checked)]
    for seed, single in enumerate(singles):
        single.env.reset(seed=seed)
    random = np.random.default_rng(0)
    differing: set[int] = set()
    steps = max(1, count // num_envs)
    episodes = num_envs
    memory_before = 0
    process = psutil.Process()
    start = time.perf_counter()
    for number in tqdm(range(steps), desc=f"{num_envs} environments", disable=None):
        # Buffers and caches have their final size after the first tenth.
        if number == steps // 10:
            memory_before = process.memory_info().rss
        actions = random.uniform(-1.0, 1.0, (num_envs, 2)).astype(np.float32)
        observations, _, terminated, truncated, _ = env.step(actions)
        ended = terminated | truncated
        episodes += int(np.count_nonzero(ended))
        for index, single in enumerate(singles):
            observation = single.step(actions[index])
            is_same = observation.tobytes() == observations[index].tobytes()
            if not is_same or single.ended != ended[index]:
                differing.add(index)
    growth = process.memory_info().rss - memory_before
    seconds = time.perf_counter() - start
    env.close()
    return Endured(
        steps=steps * num_envs,
        episodes=episodes,
        growth=growth,
        seconds=seconds,
        differing=len(differing),
    )


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
    is_clean = True
    if parsed.only != "steps":
        is_clean &= _kill_all(parsed.kills, Random(0))
    if parsed.only != "kills":
        endured = step_long(parsed.steps)
        _print_endured(endured)
        is_clean &= endured.is_clean
    return 0 if is_clean else 1


def _print_endured(endured: Endured) -> None:
    print(
        "\n| steps | episodes | per second | growth [MB] "
        "| differing from single environments |\n"
        "|---|---|---|---|---|"
    )
    rate = f"{endured.steps / endured.seconds:.0f}"
    growth = f"{endured.growth / 1e6:.1f}"
    print(f"| {endured.steps} | {endured.episodes} | {rate} | {growth} | {endured.differing} |")


def _kill_all(kills: int, random: Random) -> bool:
    """Kill all programs and print a table; return whether the kills have harmed nothing."""
    print(
        "| program | kills | files torn | other results | processes left | undisturbed [s] |\n"
        "|---|---|---|---|---|---|"
    )
    is_clean = True
    with ExitStack() as stack:
        programs = dict(PROGRAMS)
        with suppress(ModuleNotFoundError):  # Dask is optional
            from distributed import LocalCluster

            local: Callable[..., LocalCluster] = LocalCluster
            cluster = local(n_workers=2, threads_per_worker=1, dashboard_address=None)
            stack.enter_context(cluster)
            scheduler = ("--scheduler", cluster.scheduler_address)
            programs["leaderboard, Dask"] = partial(leaderboard, more=scheduler)
        for name, program in programs.items():
            with TemporaryDirectory() as folder:
                toll = kill(program, kills, Path(folder), random)
            harm = f"{toll.torn} | {toll.differing} | {toll.orphans}"
            print(f"| {name} | {toll.kills} | {harm} | {toll.seconds:.0f} |", flush=True)
            is_clean &= toll.is_clean
    return is_clean


if __name__ == "__main__":
    from tools import soak  # under the name by which other processes know it

    sys.exit(soak.main())
