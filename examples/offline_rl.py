"""Train BC, IQL, CQL and TD3+BC of d3rlpy on the data sets of examples.offline and score them on held-out seeds.

    pip install d3rlpy==2.8.0
    python -m examples.offline_rl --steps 300
    python -m examples.offline_rl runs/datasets/* --algorithms bc iql cql --out runs/offline

Without data sets it records 50 episodes of `load_rule`. Each run is kept in a file; the same command goes on where it was
interrupted, and then prints the table.
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
from turning_env import score
from turning_env.console import described, exits
from turning_env.files import replace_file
from turning_env.scoring.statistics import Bootstrap, Estimate, severe_share

ALGORITHMS = ("bc", "iql", "cql", "td3_bc")
STEPS = 3000
BATCH = 256
DISCOUNT = 0.8
REWARD_SCALE = 1 / 3  # discount, scale and network as for PPO (train/hyperparameters/ppo.toml)
FIELDS = ("return", "severe_overload_time", "engaged_time")


def learner(algorithm: str, steps: int, observations: Any) -> Any:
    """Return an untrained learner of d3rlpy. Observations are normalised by the data set's mean and standard deviation."""
    scaler = StandardObservationScaler(mean=observations.mean(axis=0), std=observations.std(axis=0))
    encoder = VectorEncoderFactory([64, 64])
    adam = AdamFactory(lr_scheduler_factory=CosineAnnealingLRFactory(steps))
    if algorithm == "bc":
        config: Any = BCConfig(
            learning_rate=1e-3,
            optim_factory=adam,
            encoder_factory=encoder,
            observation_scaler=scaler,
        )
        return config.create()
    kind, own = {
        "iql": (IQLConfig, {"value_encoder_factory": encoder}),
        "cql": (
            CQLConfig,
            {"n_action_samples": 4, "initial_temperature": 0.1, "temp_learning_rate": 1e-3},
        ),
        "td3_bc": (TD3PlusBCConfig, {}),
    }[algorithm]
    config = kind(
        gamma=DISCOUNT,
        actor_learning_rate=1e-3,
        critic_learning_rate=1e-3,
        actor_optim_factory=adam,
        actor_encoder_factory=encoder,
        critic_encoder_factory=encoder,
        observation_scaler=scaler,
        reward_scaler=MultiplyRewardScaler(REWARD_SCALE),
        **own,
    )
    return config.create()


def batches(dataset: minari.MinariDataset, steps: int, seed: int) -> Iterator[TransitionMiniBatch]:
    """Yield random transitions; d3rlpy's own sampling takes longer than the gradient step."""
    episodes = list(dataset.iterate_episodes())

    def joined(arrays: Iterator[Any]) -> Any:
        return np.concatenate(
            [np.asarray(array, np.float32).reshape(len(array), -1) for array in arrays]
        )

    observations, actions = (
        joined(each.observations[:-1] for each in episodes),
        joined(each.actions for each in episodes),
    )
    following = joined(each.observations[1:] for each in episodes)
    rewards, terminals = (
        joined(each.rewards for each in episodes),
        joined(each.terminations for each in episodes),
    )
    generator = np.random.default_rng(seed)
    for _ in range(steps):
        at = generator.integers(len(actions), size=BATCH)
        last = np.minimum(at + 1, len(actions) - 1)
        yield TransitionMiniBatch(
            observations[at],
            actions[at],
            rewards[at],
            following[at],
            actions[last],
            terminals[at],
            np.ones_like(rewards[at]),
            [],
        )


def train(dataset: minari.MinariDataset, algorithm: str, steps: int, seed: int) -> Any:
    """Return a trained learner."""
    d3rlpy.seed(seed)
    made = learner(
        algorithm, steps, np.concatenate([each.observations for each in dataset.iterate_episodes()])
    )
    made.create_impl((dataset.observation_space.shape[0],), dataset.action_space.shape[0])
    for batch in tqdm(
        batches(dataset, steps, seed), total=steps, desc=f"{algorithm} {seed}", disable=None
    ):
        made.update(batch)
    return made


def played(
    folder: Path, algorithm: str, seed: int, steps: int, seeds: int | None, out: Path
) -> dict[str, Any]:
    """Return the held-out episodes of a run, of ``FIELDS``: from its file, or after training and scoring it."""
    file = out / f"{folder.name}-{algorithm}-{steps}-seed{seed}-on{seeds or 'all'}.npz"
    if not file.exists():
        found = score(train(load(folder), algorithm, steps, seed).predict, seeds=seeds)
        print(f"{folder.name}, {algorithm}, training seed {seed}: {found}", flush=True)
        columns: dict[str, Any] = {name: found.episodes[name] for name in FIELDS}
        replace_file(file, lambda path: np.savez(path, **columns))
    with np.load(file) as read:
        return {name: read[name] for name in FIELDS}


def row(folder: Path, algorithm: str, runs: Sequence[dict[str, Any]]) -> str:
    """Return a row of the table: the interval is over training seeds and held-out seeds."""
    returns, severe, engaged = (np.stack([each[name] for each in runs]) for name in FIELDS)
    mean = Estimate.of(
        float(returns.mean()),
        Bootstrap(returns.shape[1]).means(returns, f"{folder.name}-{algorithm}"),
    )
    share = severe_share(severe.ravel(), engaged.ravel())
    by_seed = ", ".join(f"{each:.0f}" for each in returns.mean(axis=1))
    name = folder.name.removeprefix("rough_turning-").removesuffix("-v0")
    return f"| `{name}` | {algorithm.upper()} | {mean.value:.0f} ({mean.low:.0f} to {mean.high:.0f}) | {by_seed} | {share:.1%} |"


@exits(ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
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
    options = parser.parse_args(arguments)
    rows = [
        "| Data set | Algorithm | Return per edge [s] | Of each training seed [s] | Over a limit by > 5 % |",
        "|---|---|---|---|---|",
    ]
    datasets = options.datasets or [make("load_rule", 50, options.out)]
    for folder, algorithm in product(datasets, options.algorithms):
        rest = (options.steps, options.seeds, options.out)
        runs = [played(folder, algorithm, seed, *rest) for seed in range(options.training_seeds)]
        rows.append(row(folder, algorithm, runs))
    print("\n".join(rows))
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
