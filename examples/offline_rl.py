"""Train offline algorithms of d3rlpy on data sets of examples.offline, and score them.

    pip install d3rlpy==2.8.0
    python -m examples.offline_rl --steps 300
    python -m examples.offline_rl runs/datasets/* --algorithms bc iql cql --out runs/offline

The algorithms are BC, IQL, CQL and TD3+BC. They are scored on held-out seeds. Without data sets the
command records 50 episodes of `load_rule`. Each run is kept in a file; the same command goes on
where it was interrupted, and then prints the table.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import d3rlpy
import minari  # type: ignore[import-untyped]
import numpy as np
from d3rlpy.algos import BCConfig, CQLConfig, IQLConfig, TD3PlusBCConfig
from d3rlpy.dataset import TransitionMiniBatch
from d3rlpy.models import VectorEncoderFactory
from d3rlpy.optimizers import AdamFactory
from d3rlpy.optimizers.lr_schedulers import CosineAnnealingLRFactory
from d3rlpy.preprocessing import MultiplyRewardScaler, StandardObservationScaler
from tqdm import tqdm

from examples.offline import load, make
from examples.shared import at_least, run
from leaderboard import score
from leaderboard.statistics import Bootstrap, Estimate, severe_share
from turning_env.console import described, exits
from turning_env.files import replace_file

ALGORITHMS = ("bc", "iql", "cql", "td3_bc")
STEPS = 3000  # gradient steps
BATCH_SIZE = 256
# Discount, reward scale and networks are those of PPO (train/ppo.py).
GAMMA = 0.8
REWARD_SCALE = 1 / 3
NET_ARCH = [64, 64]
LEARNING_RATE = 1e-3
FIELDS = ("return", "severe_overload_time", "engaged_time")
"""Columns of episodes that are kept."""


def learner(algorithm: str, steps: int, observations: Any) -> Any:
    """Return an untrained learner of d3rlpy.

    Observations are normalised by the data set's mean and standard deviation.
    """
    scaler = StandardObservationScaler(mean=observations.mean(axis=0), std=observations.std(axis=0))
    encoder = VectorEncoderFactory(NET_ARCH)
    adam = AdamFactory(lr_scheduler_factory=CosineAnnealingLRFactory(steps))
    if algorithm == "bc":
        config: Any = BCConfig(
            learning_rate=LEARNING_RATE,
            optim_factory=adam,
            encoder_factory=encoder,
            observation_scaler=scaler,
        )
        return config.create()

    common: dict[str, Any] = {
        "gamma": GAMMA,
        "actor_learning_rate": LEARNING_RATE,
        "critic_learning_rate": LEARNING_RATE,
        "actor_optim_factory": adam,
        "actor_encoder_factory": encoder,
        "critic_encoder_factory": encoder,
        "observation_scaler": scaler,
        "reward_scaler": MultiplyRewardScaler(REWARD_SCALE),
    }
    match algorithm:
        case "iql":
            config = IQLConfig(**common, value_encoder_factory=encoder)
        case "cql":
            config = CQLConfig(
                **common,
                n_action_samples=4,
                initial_temperature=0.1,
                temp_learning_rate=LEARNING_RATE,
            )
        case _:
            config = TD3PlusBCConfig(**common)
    return config.create()


def joined(arrays: Sequence[Any]) -> Any:
    """Return the arrays of all episodes as one, shape (steps, size)."""
    columns = [np.asarray(array, np.float32).reshape(len(array), -1) for array in arrays]
    return np.concatenate(columns)


def batches(dataset: minari.MinariDataset, steps: int, seed: int) -> Iterator[TransitionMiniBatch]:
    """Yield random transitions; d3rlpy's own sampling takes longer than the gradient step."""
    episodes = list(dataset.iterate_episodes())
    observations = joined([episode.observations[:-1] for episode in episodes])
    next_observations = joined([episode.observations[1:] for episode in episodes])
    actions = joined([episode.actions for episode in episodes])
    rewards = joined([episode.rewards for episode in episodes])
    terminals = joined([episode.terminations for episode in episodes])
    generator = np.random.default_rng(seed)
    for _ in range(steps):
        indices = generator.integers(len(actions), size=BATCH_SIZE)
        # After a terminal step, the next action is another episode's; no learner uses it there.
        next_indices = np.minimum(indices + 1, len(actions) - 1)
        yield TransitionMiniBatch(
            observations=observations[indices],
            actions=actions[indices],
            rewards=rewards[indices],
            next_observations=next_observations[indices],
            next_actions=actions[next_indices],
            terminals=terminals[indices],
            intervals=np.ones_like(rewards[indices]),
            transitions=[],
        )


def train(dataset: minari.MinariDataset, algorithm: str, steps: int, seed: int) -> Any:
    """Return a trained learner."""
    d3rlpy.seed(seed)
    observations = [episode.observations for episode in dataset.iterate_episodes()]
    untrained = learner(algorithm, steps, np.concatenate(observations))
    entries = dataset.observation_space.shape[0]
    actions = dataset.action_space.shape[0]
    untrained.create_impl((entries,), actions)
    progress = tqdm(
        batches(dataset, steps, seed), total=steps, desc=f"{algorithm} {seed}", disable=None
    )
    for batch in progress:
        untrained.update(batch)
    return untrained


def played(
    folder: Path, algorithm: str, seed: int, steps: int, seeds: int | None, out: Path
) -> dict[str, Any]:
    """Return the held-out episodes of a run, columns ``FIELDS``.

    They come from the run's file, or from training and scoring it.
    """
    path = out / f"{folder.name}-{algorithm}-{steps}-seed{seed}-on{seeds or 'all'}.npz"
    if not path.exists():
        trained = train(load(folder), algorithm, steps, seed)
        result = score(trained.predict, seeds=seeds)
        print(f"{folder.name}, {algorithm}, training seed {seed}: {result}", flush=True)
        columns: dict[str, Any] = {name: result.episodes[name] for name in FIELDS}
        replace_file(path, lambda partial: np.savez(partial, **columns))
    with np.load(path) as file:
        return {name: file[name] for name in FIELDS}


HEADER = (
    "| Data set | Algorithm | Return per edge [s] | Of each training seed [s] "
    "| Over a limit by > 5 % |"
)


def row(folder: Path, algorithm: str, runs: Sequence[dict[str, Any]]) -> str:
    """Return a row of the table: the interval is over training seeds and held-out seeds."""
    returns = np.stack([run["return"] for run in runs])
    severe_times = np.stack([run["severe_overload_time"] for run in runs])
    engaged_times = np.stack([run["engaged_time"] for run in runs])
    replicates = Bootstrap(returns.shape[1]).means(returns, f"{folder.name}-{algorithm}")
    mean = Estimate.of(float(returns.mean()), replicates)
    by_seed = ", ".join(f"{value:.0f}" for value in returns.mean(axis=1))
    share = severe_share(severe_times.ravel(), engaged_times.ravel())
    name = folder.name.removeprefix("rough_turning-").removesuffix("-v0")
    return (
        f"| `{name}` | {algorithm.upper()} "
        f"| {mean.value:.0f} ({mean.low:.0f} to {mean.high:.0f}) | {by_seed} | {share:.1%} |"
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m examples.offline_rl", **described(__doc__))
    parser.add_argument(
        "datasets",
        nargs="*",
        type=Path,
        help="folders that examples.offline has made (default: record one)",
    )
    parser.add_argument(
        "--algorithms", nargs="+", choices=ALGORITHMS, default=ALGORITHMS, help="default: all"
    )
    parser.add_argument(
        "--steps", type=at_least(1), default=STEPS, help="gradient steps (default: %(default)s)"
    )
    parser.add_argument(
        "--training-seeds",
        type=at_least(1),
        default=2,
        help="number of them (default: %(default)s)",
    )
    parser.add_argument(
        "--seeds",
        type=at_least(2),
        help="number of held-out seeds (default: all of the leaderboard)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("runs/offline"),
        help="folder of runs (default: %(default)s)",
    )
    return parser


@exits(ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    options = _parser().parse_args(arguments)
    lines = [HEADER, "|---|---|---|---|---|"]
    datasets = options.datasets or [make("load_rule", 50, options.out)]
    for folder, algorithm in product(datasets, options.algorithms):
        runs = [
            played(
                folder,
                algorithm,
                seed=seed,
                steps=options.steps,
                seeds=options.seeds,
                out=options.out,
            )
            for seed in range(options.training_seeds)
        ]
        lines.append(row(folder, algorithm, runs))
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
