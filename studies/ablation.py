"""Measure the worth of each choice in PPO's training: agents that differ in one choice play the same tuning seeds.

    python -m studies.ablation
    python -m studies.ablation --steps 2000000 --seeds 3 --out docs/ablation.md
    python -m studies.ablation --variants as_it_is discount_0.99
    python -m studies.ablation --seeds 5 --jobs 8

All variants train for the same number of steps, with ``train/hyperparameters/ppo.toml`` except for the choice that names the row.
The environment's own return scores every agent, whatever its training rewards. ``RUNS/ablation`` keeps the trainings: the same
command continues where it stopped, and a command with more seeds adds to them.
"""

import argparse
import dataclasses
import shlex
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from train import ppo
from train.actor import ActorPolicy
from train.run import Run
from train.training import SEEDS, train
from turning_env import IDS, Scenario
from turning_env.console import described, exits
from turning_env.files import replace_file
from turning_env.scoring.overload import CONFIDENCE, ratio, severe_share
from turning_env.scoring.play import Episodes, play
from turning_env.scoring.seeds import tuning_seeds
from turning_env.scoring.statistics import Bootstrap, Estimate
from turning_env.scoring.workers import spread, workers

ENV_ID = "RoughTurning-v0"
NUM_SEEDS = 128
"""Tuning seeds that each agent plays."""


class ProcessorTime(BaseCallback):
    """A callback that keeps a training's processor time [s] in its model, so checkpoints and the agent's file hold it."""

    def _on_training_start(self) -> None:
        self._start = time.process_time() - getattr(self.model, "processor_time", 0.0)

    def _on_rollout_start(self) -> None:
        self._note()

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self._note()

    def _note(self) -> None:
        model: Any = self.model
        model.processor_time = time.process_time() - self._start


@dataclass(frozen=True)
class Variant:
    """A variant of PPO's training."""

    title: str
    """Name in the table."""
    parameters: dict[str, Any] = field(default_factory=dict)
    """Hyperparameters that differ."""
    control: dict[str, Any] = field(default_factory=dict)
    """Fields of the scenario's section ``control`` that differ in training and in play."""

    def scenario(self, base: Scenario) -> Scenario:
        """Return the scenario with the differences."""
        values = base.model_dump()
        values["control"] |= self.control
        return Scenario.model_validate(values)


VARIANTS = {
    "as_it_is": Variant("unchanged"),
    "set_point": Variant("set points instead of increments", control={"action": "set_point"}),
    "charged_at_end": Variant("edge charged at its end", {"life_price": "end"}),
    "discount_0.5": Variant("discount 0.5", {"discount": 0.5}),
    "discount_0.95": Variant("discount 0.95", {"discount": 0.95}),
    "discount_0.99": Variant("discount 0.99", {"discount": 0.99}),
    "charged_at_end_discount_0.99": Variant("edge charged at its end, discount 0.99", {"life_price": "end", "discount": 0.99}),
    "four_frames": Variant("the last 4 observations", {"frames": 4}),
    "life_by_left": Variant("life priced by the share left", {"life_price": "marginal"}),
}
"""Variants by name, in the table's order. The table compares all others with the first that is played."""


@dataclass(frozen=True)
class Played:
    """The agents of a variant on the tuning seeds."""

    name: str
    episodes: Episodes
    """Episodes as ``turning_env.scoring.play`` returns them, each field of shape (training seeds, tuning seeds)."""
    seconds: float
    """Processor time of a training [s], mean over training seeds."""


def play_agent(
    agent: tuple[str, int], base: Scenario, runs: Path, overrides: dict[str, Any], command: str
) -> tuple[Episodes, float]:
    """Train a variant's agent with a training seed, unless that is finished, and play it.

    Returns:
        The episodes, each of shape (tuning seeds,), and the training's processor time [s].

    Raises:
        ValueError: the training's folder holds a training with other settings, or numbers have not stayed finite.
    """
    name, seed = agent
    variant = VARIANTS[name]
    algorithm = dataclasses.replace(ppo.ALGORITHM, callbacks=lambda run: [ProcessorTime()])
    scenario = variant.scenario(base)
    run = Run.plan("ppo", ENV_ID, scenario, seed, runs / "ablation" / name, command, variant.parameters | overrides)
    path = train(run, algorithm)
    episodes = play(partial(ActorPolicy, algorithm.actor(path).eval()), scenario, tuning_seeds(NUM_SEEDS))
    model: Any = algorithm.model.load(path, device="cpu")
    return episodes, model.processor_time


def gathered(name: str, agents: Sequence[tuple[Episodes, float]]) -> Played:
    """Stack a variant's agents by training seed."""
    episodes = {key: np.stack([each[key] for each, _ in agents]) for key in agents[0][0]}
    return Played(name, episodes, float(np.mean([seconds for _, seconds in agents])))


def table(rows: Sequence[Played]) -> list[str]:
    """Return the lines of a Markdown table of the variants; differences are to the first row."""
    bootstrap = Bootstrap(rows[0].episodes["return"].shape[1])
    lines = [
        "| Variant | return [s] | difference to the first row [s] | severe overload [% of cutting time] | edges broken per 100 "
        "| training [s of processor time] |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        difference = "" if row is rows[0] else text(_difference(bootstrap, row, rows[0]), 1)
        mean_return = Estimate.of(row.episodes["return"].mean(), bootstrap.means(row.episodes["return"], row.name))
        severe = severe_share(row.episodes["severe_overload_time"].ravel(), row.episodes["engaged_time"].ravel())
        broken = ratio(*(row.episodes[key].sum(keepdims=True) for key in ("edges_broken", "edges_used"))).item()
        cells = (VARIANTS[row.name].title, text(mean_return, 0), difference, f"{100 * severe:.2f}", f"{100 * broken:.1f}")
        lines.append(f"| {' | '.join(cells)} | {row.seconds:.0f} |")
    return lines


def _difference(bootstrap: Bootstrap, row: Played, other: Played) -> Estimate:
    """Return the mean return [s] less another variant's, paired by seed."""
    ours, theirs = row.episodes["return"], other.episodes["return"]
    replicates = bootstrap.means(ours, row.name) - bootstrap.means(theirs, other.name)
    return Estimate.of(ours.mean() - theirs.mean(), replicates)


def text(estimate: Estimate, decimals: int) -> str:
    """Return an estimate with its interval as text."""
    value, low, high = (f"{number:.{decimals}f}" for number in (estimate.value, estimate.low, estimate.high))
    return f"{value} ({low} to {high})"


def page(command: str, lines: Sequence[str], steps: int, seeds: int) -> str:
    """Return the table as a Markdown page with the command and an explanation."""
    over = "tuning seeds and training seeds" if seeds > 1 else "tuning seeds only, not over training seeds"
    text = (
        "This page measures the worth of each choice in PPO's training. Every variant uses `train/hyperparameters/ppo.toml`\n"
        f"except for the choice that its row names. It trains for {steps:,} steps with {seeds} training seed{'s' * (seeds > 1)}\n"
        f"and plays the same {NUM_SEEDS} tuning seeds of `{ENV_ID}`. Returns are the environment's own, whatever the training\n"
        f"rewards. Brackets hold {100 * CONFIDENCE:.0f} % bootstrap intervals over {over}.\nDifferences are paired by seed."
    )
    return "\n".join(["# Ablation of PPO's training", "", "```bash", command, "```", "", text, "", *lines, ""])


@exits(ValueError, interrupted="interrupted: run the same command again to go on")
def main(arguments: Sequence[str] | None = None) -> int:
    """Train the missing agents, play all, print the table; return the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    parser = argparse.ArgumentParser(prog="python -m studies.ablation", **described(__doc__))
    parser.add_argument("--steps", type=int, default=2_000_000, help="environment steps per training (default: %(default)s)")
    parser.add_argument("--seeds", type=int, default=1, help="trainings per variant (default: %(default)s)")
    parser.add_argument(
        "--variants",
        nargs="+",
        choices=VARIANTS,
        default=list(VARIANTS),
        help=f"variants to train, from {', '.join(VARIANTS)} (default: all)",
        metavar="NAME",
    )
    who = parser.add_mutually_exclusive_group()
    who.add_argument("--jobs", type=int, default=1, metavar="N", help="trainings at the same time (default: %(default)s)")
    who.add_argument("--scheduler", metavar="URL", help="train on the workers of a Dask cluster, such as tcp://host:8786")
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="folder of all runs (default: %(default)s)")
    parser.add_argument("--out", type=Path, help="Markdown file for the table (default: only print)")
    parsed = parser.parse_args(arguments)
    for name, most in (("steps", 10**12), ("seeds", SEEDS), ("jobs", 1000)):
        if not 1 <= (value := getattr(parsed, name)) <= most:
            parser.error(f"--{name} is {value}, but must be 1 to {most}")
    command = f"python -m studies.ablation {shlex.join(arguments)}".strip()
    names = list(dict.fromkeys(parsed.variants))
    overrides = {"steps": parsed.steps}
    base = Scenario.load(IDS[ENV_ID])
    work = partial(play_agent, base=base, runs=parsed.runs, overrides=overrides, command=command)
    agents = [(name, seed) for name in names for seed in range(parsed.seeds)]
    played = {}
    with (
        workers(parsed.jobs, parsed.scheduler) as over,
        tqdm(total=len(agents), unit="agent", disable=None) as bar,
    ):
        for agent, outcome in spread(over, work, zip(agents, agents, strict=True)):
            played[agent] = outcome
            bar.set_postfix_str(f"{agent[0]}, seed {agent[1]}")
            bar.update()
    rows = [gathered(name, [played[name, seed] for seed in range(parsed.seeds)]) for name in names]
    lines = table(rows)
    print("\n".join(lines))
    if parsed.out:
        content = page(command, lines, parsed.steps, parsed.seeds)
        replace_file(parsed.out, lambda path: path.write_text(content, "utf-8"))
    return 0


if __name__ == "__main__":
    from studies import ablation  # under the name by which workers know it

    sys.exit(ablation.main())
