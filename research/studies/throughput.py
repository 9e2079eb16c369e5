"""Measure environment steps per second, beside other environments.

    python -m research.studies.throughput
    python -m research.studies.throughput --training
    python -m research.studies.throughput --against ../before

It prints a Markdown table of this project and of every peer that is installed (``pip install -e
'.[peers]'``). All cases take turns, so other load on the machine affects them equally, and ratios
are taken within a turn. Steps per CPU second show which case used more than one core or waited for
one. Actions are random and drawn beforehand. Resets count. ``--training`` measures trainings by PPO
instead, all with the same network and batches. ``--against`` compares one environment of
RoughTurning-v0 and a batch with those of another checkout; a process of each takes turns.
"""

import argparse
import importlib
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from itertools import cycle, product
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from matplotlib.ticker import EngFormatter
from tqdm import tqdm

from turning_env import FAMILY_ID, IDS
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.console import UserError, described, exits, positive

MAIN = "RoughTurning-v0"
NUM_ENVS = 1024  # number of environments of a batch, unless stated
SIZES = (1, 16, 256, 4096, 65536)  # numbers of environments side by side
REFERENCE = "Gymnasium Pendulum, unwrapped"  # the case that ratios refer to
_ACTIONS = 16  # batches of random actions, drawn beforehand and used in turn
_SCAN = 64  # steps in one call of a compiled loop
_TURNS = f"""
import sys, time, gymnasium, turning_env
single = gymnasium.make("{MAIN}").unwrapped
batch = gymnasium.make_vec("{MAIN}", {NUM_ENVS}, vectorization_mode="vector_entry_point")
envs = single, batch
for env in envs:
    env.action_space.seed(0)
actions = [[env.action_space.sample() for _ in range({_ACTIONS})] for env in envs]
for line in sys.stdin:
    for size, env, drawn in zip((1, {NUM_ENVS}), envs, actions):
        env.reset(seed=0), env.step(drawn[0])
        steps, begun = 0, time.process_time()
        while (taken := time.process_time() - begun) < float(sys.argv[1]):
            for action in drawn:
                _, _, terminated, truncated, _ = env.step(action)
                if size == 1 and (terminated or truncated):
                    env.reset()
            steps += size * len(drawn)
        print(steps / taken, end=" ")
    print(flush=True)
"""
"""Code that runs in each of two checkouts.

For each line of input, it prints the steps per CPU second of a turn.
"""


class Case(NamedTuple):
    """Something to time: ``step`` makes ``steps`` environment steps per call."""

    name: str
    num_envs: int
    steps: int
    step: Callable[[], object]


class Timing(NamedTuple):
    """Environment steps of one turn per second of wall time, and of CPU time of all threads."""

    rate: float
    cpu_rate: float


def one(name: str, env: gymnasium.Env[Any, Any]) -> Case:
    """Return the case of a single environment, reset whenever its episode ends."""
    env.reset(seed=0)
    action = _actions_of(env.action_space)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(action())
        if terminated or truncated:
            env.reset()

    return Case(name, 1, 1, step)


def many(name: str, env: Any, num_envs: int, space: gymnasium.Space[Any]) -> Case:
    """Return the case of a vector environment, which starts its next episodes itself."""
    action = _actions_of(space, num_envs)
    return Case(name, num_envs, num_envs, lambda: env.step(action()))


def vector(env_id: str, num_envs: int = NUM_ENVS) -> Case:
    """Return the case of a batch of one of the project's ids, on one thread."""
    env = gymnasium.make_vec(env_id, num_envs, vectorization_mode="vector_entry_point")
    env.reset(seed=0)
    return many(f"{env_id}, vector", env, num_envs, env.single_action_space)


def _actions_of(space: gymnasium.Space[Any], *num_envs: int) -> Callable[[], Any]:
    """Return a function that returns random actions of a space, for all environments."""
    rng = np.random.default_rng(0)
    if isinstance(space, gymnasium.spaces.Discrete):
        drawn: Any = rng.integers(0, space.n, (_ACTIONS, *num_envs))
    else:
        assert isinstance(space, gymnasium.spaces.Box)
        drawn = rng.uniform(space.low, space.high, (_ACTIONS, *num_envs, *space.shape)).astype(
            space.dtype
        )
    return cycle(drawn).__next__


def measure(cases: Sequence[Case], repeats: int, seconds: float) -> list[list[Timing]]:
    """Time every case (first index) in every turn (second) for about ``seconds`` of wall time."""
    counts = [calls_within(case, seconds) for case in cases]
    timings: list[list[Timing]] = [[] for _ in cases]
    # Every turn times all cases, so that a slow minute of the computer slows all of them.
    turns = tqdm(range(repeats), unit="turn", dynamic_ncols=True, disable=None)
    for _ in turns:
        for case, count, of_case in zip(cases, counts, timings, strict=True):
            of_case.append(timed(case, count))
    return timings


def calls_within(case: Case, seconds: float) -> int:
    """Return the number of calls of a case that take about ``seconds``."""
    case.step()  # compiles, or loads compiled code
    count = 1
    # The quickest of three: a single pause would look like slow calls, and turns of a few calls
    # would time cold caches.
    while (
        taken := count * case.steps / max(timed(case, count).rate for _ in range(3))
    ) < 0.2 * seconds:
        count *= 2
    return max(1, round(count * seconds / taken))


def timed(case: Case, count: int) -> Timing:
    """Time ``count`` calls of a case."""
    wall_start = time.perf_counter()
    cpu_start = time.process_time()
    for _ in range(count):
        case.step()
    wall = time.perf_counter() - wall_start
    cpu = time.process_time() - cpu_start
    steps = count * case.steps
    return Timing(rate=steps / wall, cpu_rate=steps / max(cpu, 1e-9))


def our_cases() -> Iterator[Case]:
    """Yield cases of this project."""
    yield one(f"{MAIN}, unwrapped", gymnasium.make(MAIN).unwrapped)
    yield one(MAIN, gymnasium.make(MAIN))
    yield from (vector(MAIN, num_envs) for num_envs in SIZES)
    yield from (vector(env_id) for env_id in (*IDS, FAMILY_ID) if env_id != MAIN)


def gymnasium_cases() -> Iterator[Case]:
    """Yield cases of Gymnasium's own environments; the first is the reference."""
    yield one(REFERENCE, gymnasium.make("Pendulum-v1").unwrapped)
    yield one("Gymnasium Pendulum", gymnasium.make("Pendulum-v1"))
    for num_envs in SIZES:
        yield vector("CartPole-v1", num_envs)._replace(name="Gymnasium CartPole, vector")


def envpool_cases() -> Iterator[Case]:
    """Yield cases of EnvPool on one thread."""
    envpool = importlib.import_module("envpool")
    for num_envs in SIZES[1:-1]:
        env = envpool.make_gymnasium("Pendulum-v1", num_envs=num_envs, num_threads=1)
        env.reset()
        yield many("EnvPool Pendulum, 1 thread", env, num_envs, env.action_space)


def gymnax_cases() -> Iterator[Case]:
    """Yield cases of gymnax: a compiled loop over steps and random actions."""
    jax = importlib.import_module("jax")
    gymnax = importlib.import_module("gymnax")
    env, parameters = gymnax.make("Pendulum-v1")

    def step(state: Any, key: Any) -> tuple[Any, Any]:
        act, move = jax.random.split(key)
        action = env.action_space(parameters).sample(act)
        _, state, reward, *_ = env.step(move, state, action, parameters)
        return state, reward

    def scan(states: Any, key: Any) -> Any:
        def all_envs(states: Any, key: Any) -> Any:
            num_envs = jax.tree_util.tree_leaves(states)[0].shape[0]
            return jax.vmap(step)(states, jax.random.split(key, num_envs))

        return jax.lax.scan(all_envs, states, jax.random.split(key, _SCAN))

    compiled_scan = jax.jit(scan)
    reset_all = jax.vmap(env.reset, in_axes=(0, None))
    for num_envs in SIZES[2:]:
        key = jax.random.PRNGKey(0)
        _, states = reset_all(jax.random.split(key, num_envs), parameters)

        def run(states: Any = states, key: Any = key) -> None:
            jax.block_until_ready(compiled_scan(states, key))

        yield Case("gymnax Pendulum, scan", num_envs, num_envs * _SCAN, run)


def motor_cases() -> Iterator[Case]:
    """Yield a case of gym-electric-motor, the nearest field."""
    motor = importlib.import_module("gym_electric_motor")
    yield one("gym-electric-motor Cont-CC-PMSM", motor.make("Cont-CC-PMSM-v0"))


def training_cases() -> Iterator[Case]:
    """Yield trainings by PPO, a rollout and its updates at a time; the first is the reference."""
    sb3 = importlib.import_module("stable_baselines3")
    util = importlib.import_module("stable_baselines3.common.env_util")
    ppo = importlib.import_module("train.ppo")
    run = importlib.import_module("train.run")
    training = importlib.import_module("train.training")
    same = {
        "n_steps": 32,
        "batch_size": 2048,
        "n_epochs": 3,
        "policy_kwargs": {"net_arch": [64, 64]},
        "device": "cpu",
    }
    libraries = {"Stable-Baselines3": sb3}
    if find_spec("sbx"):
        libraries["SBX"] = importlib.import_module("sbx")
    tasks = {
        "Gymnasium Pendulum": util.make_vec_env("Pendulum-v1", 512),
        MAIN: RoughTurningVecEnv(IDS[MAIN], 512),
    }
    models: dict[str, Any] = {}
    for (library, module), (task, envs) in product(libraries.items(), tasks.items()):
        models[f"{library}, {task}"] = module.PPO("MlpPolicy", envs, **same)
    added: tuple[dict[str, Any], ...] = ({}, {"frames": 4}, {"belief": True})
    for env_id, terms in product((MAIN, FAMILY_ID), added):
        plan = run.Run.plan("ppo", env_id, run.trained_on(env_id, None), 0, Path(), "", terms)
        models[", ".join(["train.ppo", env_id, *terms])] = training.new_model(plan, ppo.ALGORITHM)
    for name, model in models.items():
        model.tensorboard_log = None
        steps = model.n_steps * model.n_envs
        learn = partial(model.learn, steps, reset_num_timesteps=False)
        yield Case(name, model.n_envs, steps, learn)


PEERS: dict[str, Callable[[], Iterator[Case]]] = {
    "gymnasium": gymnasium_cases,
    "envpool": envpool_cases,
    "gymnax": gymnax_cases,
    "gym_electric_motor": motor_cases,
    "rough-turning": our_cases,
}
"""Cases by module, the reference first."""


def runnable_cases(peers: dict[str, Callable[[], Iterator[Case]]]) -> tuple[list[Case], list[str]]:
    """Return the cases of the peers that run here, and a remark on each peer.

    A remark is the peer's version, or says why it is left out.
    """
    cases: list[Case] = []
    remarks = []
    for module, peer in peers.items():
        try:
            cases_of_peer = list(peer())
            remark = f"{module} {version(module)}"
            for case in cases_of_peer:
                case.step()  # some fail only here
        except Exception as error:  # a failing peer must not stop the others
            remarks.append(f"left out: {module}: {type(error).__name__}: {error}")
            continue
        cases += cases_of_peer
        remarks.append(remark)
    return cases, remarks


def medians_table(cases: Sequence[Case], timings: Sequence[Sequence[Timing]]) -> list[str]:
    """Return the lines of a Markdown table of medians over the turns.

    Ratios are to the first case in the same turn.
    """
    lines = [
        "| Case | Environments | Steps per second | Per CPU second | Ratio |",
        "|---|---:|---:|---:|---:|",
    ]
    rounded = EngFormatter(places=1, sep=" ")
    for case, turns in zip(cases, timings, strict=True):
        rates, cpu_rates = zip(*turns, strict=True)
        rate = rounded(statistics.median(rates))
        cpu_rate = rounded(statistics.median(cpu_rates))
        ratios = []
        for turn, base in zip(turns, timings[0], strict=True):
            ratios.append(turn.rate / base.rate)
        cells = (case.name, str(case.num_envs), rate, cpu_rate, text(ratios))
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def text(ratios: Sequence[float]) -> str:
    """Return the median and the range of ratios."""
    return f"{statistics.median(ratios):.3g} ({min(ratios):.3g} to {max(ratios):.3g})"


def machine() -> str:
    """Return processor, cores, system and Python."""
    information = Path("/proc/cpuinfo")
    lines = []
    if information.exists():
        lines = information.read_text("utf-8").splitlines()
    model = platform.processor() or platform.machine()
    for line in lines:
        key, _, value = line.partition(":")
        if key.startswith("model name"):
            model = value.strip()
            break
    return (
        f"{model}, {os.cpu_count()} logical cores, {platform.system()}, "
        f"Python {platform.python_version()}"
    )


def against(other: Path, repeats: int, seconds: float) -> list[str]:
    """Return a line per case: speed of this checkout over that of another, median and range.

    Speeds are steps per CPU second, compared within a turn.
    """
    with ExitStack() as stack:
        checkouts: list[Any] = []
        for folder in (Path(__file__).parents[2], other.resolve()):
            process = subprocess.Popen(
                [sys.executable, "-P", "-c", _TURNS, str(seconds)],
                env=os.environ | {"PYTHONPATH": str(folder)},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                bufsize=1,
            )
            checkouts.append(stack.enter_context(process))
        turns = []
        for _ in tqdm(range(repeats), unit="turn", dynamic_ncols=True, disable=None):
            rates = []
            for process in checkouts:
                process.stdin.write("\n")
                rates.append([float(rate) for rate in process.stdout.readline().split()])
            if not all(rates):
                raise UserError(f"--against {other}: {MAIN} cannot be timed in both checkouts")
            here, there = rates
            turns.append([rate / other_rate for rate, other_rate in zip(here, there, strict=True)])
    names = f"one {MAIN}", f"{NUM_ENVS} environments"
    return [
        f"{name}: {text(ratios)} times {other}"
        for name, ratios in zip(names, zip(*turns, strict=True), strict=True)
    ]


@exits()
def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print and draw; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m research.studies.throughput", **described(__doc__)
    )
    parser.add_argument(
        "--repeats",
        type=positive,
        default=9,
        help="turns that every case gets (default: %(default)s)",
    )
    parser.add_argument(
        "--seconds", type=float, default=0.25, help="length of one turn in s (default: %(default)s)"
    )
    parser.add_argument(
        "--training", action="store_true", help="measure trainings by PPO instead of environments"
    )
    parser.add_argument(
        "--against", type=Path, metavar="DIR", help="another checkout to compare with"
    )
    options = parser.parse_args(arguments)
    if not options.seconds > 0:
        parser.error("--seconds must be above 0")
    if options.against is not None:
        if not (options.against / "turning_env").is_dir():
            raise UserError(f"--against {options.against}: there is no folder turning_env")
        print(*against(options.against, options.repeats, options.seconds), sep="\n")
        return 0
    cases, remarks = runnable_cases(
        {"stable_baselines3": training_cases} if options.training else PEERS
    )
    timings = measure(cases, options.repeats, options.seconds)
    print(
        f"Machine: {machine()}. Versions: {', '.join(remarks)}.",
        "",
        *medians_table(cases, timings),
        sep="\n",
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
