"""Write an offline data set in Minari's format, and clone a policy from it.

    python -m examples.offline make --behaviour mixture --episodes 200 --out runs/datasets
    python -m examples.offline clone runs/datasets/rough_turning-mixture-v0

Behaviours: `grid_search`, the published controller; `analytic_gradient`, the best agent that ships; `mixture`, both in turn;
`load_rule`, a simple rule with noise. The episodes' seeds are not used for training, tuning or scoring.
"""

import argparse
import os
import sys
import warnings
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from tqdm import tqdm

from examples.shared import ENV_ID, NUM_SEEDS, FunctionPolicy, at_least, network_policy, run, score
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.console import described
from turning_env.extras import needed
from turning_env.physics.quantities import OBS
from turning_env.scoring.policy import Observations, PolicyFactory

with needed():
    import minari  # type: ignore[import-untyped]
    from minari.data_collector.episode_buffer import EpisodeBuffer  # type: ignore[import-untyped]

AGENT = Path(__file__).parents[1] / "agents" / ENV_ID / "rough_turning" / "analytic_gradient-seed0.onnx"
FIRST_SEED = 999_000_000
"""Seeds of the last training seed, which is kept for data sets."""
MAX_EPISODES = 1_000_000
NUM_ENVS = 64
"""Episodes played side by side."""
BEHAVIOURS = {
    "grid_search": ("grid_search",),
    "analytic_gradient": ("analytic_gradient",),
    "mixture": ("grid_search", "analytic_gradient"),
    "load_rule": ("load_rule",),
}


def load_rule(observations: Observations) -> Any:
    """Return actions that lower the feed while the power or the force is above 80 % of its limit, and raise it below."""
    feed = -0.3 * (observations[:, [OBS.power, OBS.thrust_force]].max(axis=1) + 1.0)
    return np.stack((np.zeros_like(feed), feed), axis=1)


def policy(behaviour: str) -> PolicyFactory:
    """Return the rule or the agent with a name."""
    if behaviour == "load_rule":
        noise = np.random.default_rng(0)
        return lambda num_envs: FunctionPolicy(lambda seen: load_rule(seen) + noise.normal(0.0, 0.2, (len(seen), 2)))
    if behaviour == "analytic_gradient":
        from train.agents import onnx_policy

        return onnx_policy.load(AGENT).make
    from baselines import catalogue

    return catalogue.spec(behaviour, Scenario.load("rough_turning")).make


def record(make: PolicyFactory, seeds: Sequence[int]) -> list[EpisodeBuffer]:
    """Play one episode per seed, all side by side: observations (T + 1, 11), actions (T, 2), rewards [s] and ends (T)."""
    envs = RoughTurningVectorEnv(len(seeds), "rough_turning", AutoresetMode.SAME_STEP)
    controller = make(len(seeds))
    observations, _ = envs.reset(seed=list(seeds))
    controller.reset(np.ones(len(seeds), np.bool_))
    seen, steps = [observations], []
    lengths = np.zeros(len(seeds), np.int64)
    last = np.zeros_like(observations)
    while not lengths.all():
        actions = controller.act(observations).clip(-1.0, 1.0)
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        steps.append((actions, rewards, terminated, truncated))
        seen.append(observations)
        ended = terminated | truncated
        for index in np.flatnonzero(ended & (lengths == 0)).tolist():
            lengths[index], last[index] = len(steps), infos["final_obs"][index]
        controller.reset(ended)
    columns = [np.stack(column) for column in zip(*steps, strict=True)]
    episodes = []
    for index, (seed, length) in enumerate(zip(seeds, lengths.tolist(), strict=True)):
        entries = [*(row[index] for row in seen[:length]), last[index]]
        acted, rewarded, worn, late = (column[:length, index] for column in columns)
        episodes.append(EpisodeBuffer(None, seed, None, np.stack(entries), acted, rewarded, worn, late, {}))
    return episodes


def make(behaviour: str, episodes: int, out: Path) -> Path:
    """Play and write a data set, whole or not at all; return its folder.

    Raises:
        FileExistsError: a data set of this name exists.
    """
    name = f"rough_turning-{behaviour}-v0"
    if (out / name).exists():
        raise FileExistsError(f"{out / name} exists: delete it, or choose another --out")
    names = BEHAVIOURS[behaviour]
    buffers: list[EpisodeBuffer] = []
    with tqdm(total=episodes, unit="episode", disable=None) as bar:
        for number, each in enumerate(names):  # by turns: seed i is played by behaviour i modulo their number
            seeds = range(FIRST_SEED + number, FIRST_SEED + episodes, len(names))
            for start in range(0, len(seeds), NUM_ENVS):
                buffers += record(policy(each), seeds[start : start + NUM_ENVS])
                bar.update(len(buffers) - bar.n)
    buffers.sort(key=lambda buffer: buffer.seed)
    out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=out.resolve(), prefix=".partial-") as folder:
        write(name, behaviour, buffers, Path(folder))
        (Path(folder) / name).replace(out / name)
    return out / name


def write(name: str, behaviour: str, buffers: list[EpisodeBuffer], root: Path) -> None:
    """Write a data set with a description below ``root``, using Minari."""
    scenario = Scenario.load("rough_turning")
    folder = patch.dict(os.environ, {"MINARI_DATASETS_PATH": str(root)})  # Minari takes the folder from nowhere else
    with folder, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*(author|code_permalink)")  # Minari would have a mail address
        dataset = minari.create_dataset_from_buffers(
            name,
            buffers,
            env=gymnasium.spec(ENV_ID),
            eval_env=gymnasium.spec(ENV_ID),
            algorithm_name=behaviour,
            description=f"One edge per episode, by {' and '.join(BEHAVIOURS[behaviour])}; rewards in s of machine time.",
            requirements=["rough-turning"],
        )
    dataset.storage.update_metadata(
        {
            "scenario": scenario.to_toml(),
            "scenario_digest": scenario.digest(),
            "first_seed": buffers[0].seed,
            "last_seed": buffers[-1].seed,
            "seeds_are": "of training seed 999: none is trained on, tuned on or held out by the project",
        }
    )
    names = BEHAVIOURS[behaviour]
    marks = [{"behaviour": names[number % len(names)], "return": float(sum(each.rewards))} for number, each in enumerate(buffers)]
    dataset.storage.update_episode_metadata(marks)


def clone(dataset: minari.MinariDataset, epochs: int, seed: int = 0) -> torch.nn.Module:
    """Train a small network to predict a data set's actions from its observations, by least squares."""
    torch.manual_seed(seed)
    episodes = list(dataset.iterate_episodes())
    observations = torch.from_numpy(np.concatenate([episode.observations[:-1] for episode in episodes]))
    actions = torch.from_numpy(np.concatenate([episode.actions for episode in episodes]))
    sizes = (observations.shape[1], 128, 128, actions.shape[1])
    layers = [layer for pair in pairwise(sizes) for layer in (torch.nn.Linear(*pair), torch.nn.ReLU())]
    network = torch.nn.Sequential(*layers[:-1])
    batches = -(-len(actions) // 1024)
    optimizer = torch.optim.Adam(network.parameters())
    falling = torch.optim.lr_scheduler.OneCycleLR(optimizer, 3e-3, epochs * batches)
    for _ in tqdm(range(epochs), unit="epoch", disable=None):
        for indices in torch.randperm(len(actions)).chunk(batches):
            optimizer.zero_grad()
            error: Any = torch.nn.functional.mse_loss(network(observations[indices]), actions[indices])
            error.backward()
            optimizer.step()
            falling.step()
    return network


def load(folder: Path) -> minari.MinariDataset:
    """Open a data set that ``make`` has written.

    Raises:
        ValueError: the folder does not hold such a data set.
    """
    dataset = minari.MinariDataset(folder.resolve() / "data")
    if (behaviour := dataset.storage.metadata.get("algorithm_name")) not in BEHAVIOURS:
        raise ValueError(f"{folder} is by {behaviour!r}, but must be by {', '.join(BEHAVIOURS)}")
    return dataset


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m examples.offline", **described(__doc__))
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make", help="play episodes and write a data set")
    making.add_argument("--behaviour", choices=BEHAVIOURS, default="mixture", help="default: %(default)s")
    making.add_argument("--episodes", type=at_least(1), default=200, help="default: %(default)s")
    making.add_argument("--out", type=Path, default=Path("runs/datasets"), help="folder of data sets (default: %(default)s)")
    cloning = commands.add_parser("clone", help="train a network on a data set's actions, and score it")
    cloning.add_argument("dataset", type=Path, help="the folder that make printed")
    cloning.add_argument("--epochs", type=at_least(1), default=20, help="default: %(default)s")
    cloning.add_argument("--tuning-seeds", type=at_least(1), default=NUM_SEEDS, help="seeds of the score (default: %(default)s)")
    options = parser.parse_args(arguments)
    try:
        if options.command == "make":
            if options.episodes > MAX_EPISODES:
                parser.error(f"--episodes is {options.episodes}, but must be at most {MAX_EPISODES}")
            print(make(options.behaviour, options.episodes, options.out))
            return 0
        dataset = load(options.dataset)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{dataset.total_episodes} episodes, {dataset.total_steps} steps")
    for name in BEHAVIOURS[dataset.storage.metadata["algorithm_name"]]:
        print(f"{name}: {score(policy(name), options.tuning_seeds)}")
    network = clone(dataset, options.epochs)
    print(f"clone: {score(lambda num_envs: network_policy(network), options.tuning_seeds)}")
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
