"""Compare algorithms on equal terms: the same position, memory, price of life and steps, and as many trials of tuning.

    python -m studies.equal_terms --jobs 2
    python -m studies.equal_terms --seeds 10 --seeds-apart 3 --jobs 2 --out docs/equal_terms.md
    python -m studies.equal_terms --agents ppo ppo-position --seeds 3
    python -m leaderboard show --results runs/equal_terms/results --information

An agent with a name such as ``ppo`` has all terms: position along the bar, memory (four observations, or its network's own) and
edge life charged at p(D). ``ppo-position`` is the same without its position, ``ppo-memory`` without memory, and ``ppo-price``
is charged the environment's flat price. Hyperparameters are those of ``studies/equal_terms.toml``, tuned with all terms.

All agents play the same held-out seeds; those with all terms also play the splits. ``RUNS/equal_terms`` keeps trainings and
results: the same command continues where it stopped, and one with more seeds adds to them.
"""

import argparse
import dataclasses
import json
import shlex
import sys
import tomllib
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from leaderboard.result import Result, ResultError, Task, read_result, result_folder, result_path, write_result
from leaderboard.standings import Standing, rank
from studies.ablation import ProcessorTime, text
from train import analytic_gradient, ppo, recurrent_ppo, sac, tqc
from train.actor import ActorPolicy
from train.run import Run
from train.training import SEEDS, train
from turning_env import IDS, SPLITS, Scenario
from turning_env.console import described, exits
from turning_env.files import replace_file
from turning_env.scoring.overload import CONFIDENCE
from turning_env.scoring.play import play
from turning_env.scoring.policy import PolicySpec, ScenarioId
from turning_env.scoring.seeds import held_out_seeds
from turning_env.scoring.statistics import Bootstrap, Estimate
from turning_env.scoring.workers import spread, workers

ENV_ID = "RoughTurning-v0"
ALGORITHMS = {module.ALGORITHM.name: module.ALGORITHM for module in (analytic_gradient, recurrent_ppo, ppo, tqc, sac)}
TUNED: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
"""Tuned hyperparameters of each algorithm."""
TERMS = ("position", "memory", "price")


def terms(algorithm: str) -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Return the hyperparameters of an algorithm with and without each term."""
    found: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
        "position": ({"position": True}, {"position": False}),
        "price": ({"life_price": "marginal"}, {"life_price": "flat"}),
    }
    if algorithm == "analytic_gradient":
        found["memory"] = ({"memory": True}, {"memory": False})
    elif algorithm != "recurrent_ppo":  # they are PPO without their memory
        found["memory"] = ({"frames": 4}, {"frames": 1})
    return found


AGENTS = [*ALGORITHMS, *(f"{name}-{term}" for name in ALGORITHMS for term in TERMS if term in terms(name))]


def parameters(agent: str) -> dict[str, Any]:
    """Return the hyperparameters of an agent that differ from those of its algorithm's file."""
    algorithm, _, missing = agent.partition("-")
    values = dict(TUNED[algorithm])
    for term, (with_it, without_it) in terms(algorithm).items():
        values |= without_it if term == missing else with_it
    return values


@dataclasses.dataclass(frozen=True)
class Played:
    """A trained agent and what it has played."""

    results: dict[str, Result]
    """Its results by scenario."""
    seconds: float
    """Processor time of its training [s]."""


def planned(agent: tuple[str, int], steps: int, runs: Path) -> Run:
    """Return the training of an agent with a training seed."""
    name, seed = agent
    algorithm = name.partition("-")[0]
    settings = parameters(name) | {"steps": steps}
    chosen = " ".join(f"--set {key}={json.dumps(value)}" for key, value in settings.items())
    command = f"python -m train.{algorithm} --seed {seed} {chosen}"
    return Run.plan(algorithm, ENV_ID, Scenario.load(IDS[ENV_ID]), seed, runs / "equal_terms" / name, command, settings)


def play_agent(agent: tuple[str, int], seeds: int, steps: int, runs: Path) -> Played:
    """Train an agent with a training seed and play it, unless that is done.

    Raises:
        ValueError: the training's folder holds a training with other settings, or numbers have not stayed finite.
    """
    (name, seed), run = agent, planned(agent, steps, runs)
    algorithm = dataclasses.replace(ALGORITHMS[run.algorithm], callbacks=lambda run: [ProcessorTime()])
    path = train(run, algorithm)
    home = ScenarioId.of(run.scenario)
    spec = PolicySpec(name=name, kind="agent", parameters=run.parameters, training_seed=seed, command=run.command, tuned_for=home)
    results = {}
    for scenario in (run.scenario, *(map(Scenario.load, SPLITS) if name in ALGORITHMS else ())):
        task = Task(env_id=ENV_ID, scenario=scenario, seeds=held_out_seeds(seeds))
        folder = result_folder(runs / "equal_terms" / "results", ENV_ID, scenario.name)
        try:
            result: Result | None = read_result(result_path(folder, spec))
        except ResultError:
            result = None
        if result is None or not result.is_of(task, spec):
            result = Result.of(task, spec, play(partial(ActorPolicy, algorithm.actor(path)), scenario, task.seeds))
            write_result(result, folder)
        results[scenario.name] = result
    model: Any = algorithm.model.load(path, device="cpu")
    return Played(results, model.processor_time)


def compared(agents: Mapping[str, Sequence[Played]]) -> list[str]:
    """Return the lines of a Markdown table of the agents with all terms, the best first."""
    scenarios = list(next(iter(agents.values()))[0].results)
    standings = {
        scenario: {each.name: each for each in rank([played.results[scenario] for seeds in agents.values() for played in seeds])}
        for scenario in scenarios
    }
    home, *splits = (standings[scenario] for scenario in scenarios)
    best = max(home, key=lambda name: home[name].mean_return.value)
    lines = [
        "| Algorithm | Return [s] | Over the first [s] | Worst to best training [s] | Severe overload [% of cutting time] "
        f"| {' | '.join(f'`{name}`' for name in scenarios[1:])} | Training [s of processor time] |",
        f"|{'---|' * (6 + len(splits))}",
    ]
    for name in sorted(home, key=lambda name: -home[name].mean_return.value):
        standing, means = home[name], [np.mean(_returns(each)) for each in agents[name]]
        seconds = np.mean([each.seconds for each in agents[name]])
        over = "" if name == best else text(_difference(agents[name], agents[best]), 1)
        cells = [f"`{name}`", _mark(standing, text(standing.mean_return, 1)), over, f"{min(means):.0f} to {max(means):.0f}"]
        cells += [f"{100 * standing.severe_share:.2f}"]
        cells += [_mark(split[name], f"{split[name].mean_return.value:.0f}") for split in splits]
        lines.append(f"| {' | '.join([*cells, f'{seconds:.0f}'])} |")
    return lines


def apart(agents: Mapping[str, Sequence[Played]]) -> list[str]:
    """Return the lines of a Markdown table of returns without a term less those with all [s], by algorithm and term."""
    names = [name for name in ALGORITHMS if name in agents]
    lines = [f"| Algorithm | {' | '.join(f'without {term}' for term in TERMS)} |", f"|{'---|' * (1 + len(TERMS))}"]
    for name in names:
        taken = [agents.get(f"{name}-{term}") for term in TERMS]
        cells = ["" if each is None else text(_difference(each, agents[name]), 1) for each in taken]
        if any(cells):
            lines.append(f"| `{name}` | {' | '.join(cells)} |")
    return lines[2:] and lines


def _returns(played: Played) -> list[float]:
    return next(iter(played.results.values())).episodes["return"]


def _difference(agents: Sequence[Played], others: Sequence[Played]) -> Estimate:
    """Return the mean return of agents less that of others [s], paired by held-out seed."""
    names, values = [], []
    for group in (agents, others):
        names.append(next(iter(group[0].results.values())).policy.name)
        values.append(np.array([_returns(each) for each in group]))
    bootstrap = Bootstrap(values[0].shape[1])
    ours, theirs = (bootstrap.means(*each) for each in zip(values, names, strict=True))
    return Estimate.of(float(values[0].mean() - values[1].mean()), ours - theirs)


def _mark(standing: Standing, number: str) -> str:
    return number if standing.feasible else f"{number}, not feasible"


def page(command: str, agents: Mapping[str, Sequence[Played]], steps: int) -> str:
    """Return the tables as a Markdown page with the command and an explanation."""
    whole = {name: agents[name] for name in ALGORITHMS if name in agents}
    seeds = len(_returns(next(iter(whole.values()))[0]))
    told = (
        f"Every agent trains for {steps:,} steps on `{ENV_ID}` and plays {seeds} held-out seeds. It is told its position\n"
        "along the bar, remembers (4 observations, or its network's own memory), and is charged p(D) for edge life.\n"
        "Hyperparameters are tuned on these terms, in as many trials of each algorithm (`studies/equal_terms.toml`).\n"
        f"Brackets hold {100 * CONFIDENCE:.0f} % bootstrap intervals over held-out seeds and training seeds; differences are\n"
        "paired by held-out seed."
    )
    counts = ", ".join(f"`{name}` {len(each)}" for name, each in agents.items())
    lines = [
        "# Algorithms on equal terms",
        "",
        "```bash",
        command,
        "```",
        "",
        told,
        f"Trainings: {counts}.",
        "",
        *compared(whole),
    ]
    if without := apart(agents):
        lines += ["", "Returns without one of the terms, less those with all [s]:", "", *without]
    return "\n".join([*lines, ""])


@exits(ValueError, interrupted="interrupted: run the same command again to go on")
def main(arguments: Sequence[str] | None = None) -> int:
    """Train the missing agents, play all, print the tables; return the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    parser = argparse.ArgumentParser(prog="python -m studies.equal_terms", **described(__doc__))
    which = f"agents to train, from {', '.join(AGENTS)} (default: all)"
    parser.add_argument("--agents", nargs="+", choices=AGENTS, default=AGENTS, metavar="NAME", help=which)
    parser.add_argument("--seeds", type=int, default=10, help="trainings of an agent with all terms (default: %(default)s)")
    parser.add_argument(
        "--seeds-apart", type=int, default=3, help="trainings of an agent that lacks a term (default: %(default)s)"
    )
    parser.add_argument("--steps", type=int, default=1_200_000, help="environment steps per training (default: %(default)s)")
    parser.add_argument("--episodes", type=int, default=256, help="held-out seeds that each agent plays (default: %(default)s)")
    who = parser.add_mutually_exclusive_group()
    who.add_argument("--jobs", type=int, default=1, metavar="N", help="trainings at the same time (default: %(default)s)")
    who.add_argument("--scheduler", metavar="URL", help="train on the workers of a Dask cluster, such as tcp://host:8786")
    parser.add_argument("--trained", action="store_true", help="train nothing: compare the agents that are trained already")
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of all runs (default: %(default)s)")
    parser.add_argument("--out", type=Path, help="Markdown file for the tables (default: only print)")
    parsed = parser.parse_args(arguments)
    for option, most in (("seeds", SEEDS), ("seeds_apart", SEEDS), ("steps", 10**12), ("episodes", 10**6), ("jobs", 1000)):
        if not 1 <= (value := getattr(parsed, option)) <= most:
            parser.error(f"--{option.replace('_', '-')} is {value}, but must be 1 to {most}")
    counts = {name: parsed.seeds if name in ALGORITHMS else parsed.seeds_apart for name in AGENTS if name in parsed.agents}
    pieces = [(name, seed) for name, count in counts.items() for seed in range(count)]
    if parsed.trained:
        pieces = [piece for piece in pieces if planned(piece, parsed.steps, parsed.runs).policy.exists()]
    names = list(dict.fromkeys(name for name, _ in pieces))
    if not names:
        parser.error(f"--trained finds no agent in {parsed.runs / 'equal_terms'}")
    if alone := [name for name in names if name.partition("-")[0] not in names]:
        parser.error(f"{alone[0]} is compared with {alone[0].partition('-')[0]}: name and train that, too")
    pieces.sort(key=lambda piece: piece[1])
    work = partial(play_agent, seeds=parsed.episodes, steps=parsed.steps, runs=parsed.runs)
    played: dict[str, list[Played]] = {name: [] for name in names}
    done = {}
    with workers(parsed.jobs, parsed.scheduler) as over, tqdm(total=len(pieces), unit="agent", disable=None) as bar:
        for piece, outcome in spread(over, work, zip(pieces, pieces, strict=True)):
            done[piece] = outcome
            bar.set_postfix_str(f"{piece[0]}, seed {piece[1]}")
            bar.update()
    for piece in pieces:
        played[piece[0]].append(done[piece])
    content = page(f"python -m studies.equal_terms {shlex.join(arguments)}".strip(), played, parsed.steps)
    print(content)
    if parsed.out:
        replace_file(parsed.out, lambda path: path.write_text(content, "utf-8"))
    return 0


if __name__ == "__main__":
    from studies import equal_terms  # under the name by which workers know it

    sys.exit(equal_terms.main())
