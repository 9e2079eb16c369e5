"""Offline data sets in Minari's format.

    python -m examples.offline make --out runs/datasets
    python -m examples.offline make --behaviours mixture --episodes 20 --out runs/small
    python -m examples.offline make --env RoughTurning-Family-v0 --behaviours self_tuning --episodes 20

Behaviours: `grid_search`, the published controller; `analytic_gradient`, the best policy that ships; `mixture`, both by turns,
with noise; `load_rule`, a simple rule with noise that needs the wheel alone. Without --behaviours the first three are recorded.
On other ids, a behaviour is the name of a controller that is tuned there.
Episodes are those of seeds that no agent is trained on, no rule is tuned on and nothing is scored on.
"""

import argparse
import hashlib
import os
import sys
import warnings
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import gymnasium
import minari  # type: ignore[import-untyped]
import numpy as np
from gymnasium.vector import AutoresetMode
from minari.data_collector.episode_buffer import EpisodeBuffer  # type: ignore[import-untyped]
from tqdm import tqdm

from examples import data_card
from examples.shared import ENV_ID, at_least, run
from turning_env import FAMILY_ID, IDS, Family, Scenario
from turning_env.console import described, exits
from turning_env.family_env import vector_env
from turning_env.physics.quantities import OBS, layout
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.policy import Observations, PolicyFactory
from turning_env.scoring.seeds import TUNING_START

AGENT = (
    Path(__file__).parents[1] / "agents" / ENV_ID / "rough_turning" / "analytic_gradient-seed0.onnx"
)
FIRST_SEED = 999_000_000  # seeds of the last training seed, which is kept for data sets
MAX_EPISODES = TUNING_START - FIRST_SEED
NUM_ENVS = 64  # episodes played side by side


BEHAVIOURS = {
    "grid_search": (("grid_search",), 0.0),
    "analytic_gradient": (("analytic_gradient",), 0.0),
    "mixture": (("grid_search", "analytic_gradient"), 0.2),
    "load_rule": (("load_rule",), 0.2),
}
"""Policies that act in turn, and the standard deviation of the noise on their actions, which are then clipped to -1..1."""
CANONICAL = ("grid_search", "analytic_gradient", "mixture")


def acting(behaviour: str) -> tuple[tuple[str, ...], float]:
    """Return the policies of a behaviour, of which a controller's name is one, and the noise on their actions."""
    return BEHAVIOURS.get(behaviour, ((behaviour,), 0.0))


def load_rule(observations: Observations) -> Any:
    """Return actions that lower the feed while the power or the force is above 80 % of its limit, and raise it below."""
    feed = -0.3 * (observations[:, [OBS.power, OBS.thrust_force]].max(axis=1) + 1.0)
    return np.stack((np.zeros_like(feed), feed), axis=1)


def policy(name: str, env_id: str = ENV_ID, seeds: Sequence[int] = ()) -> PolicyFactory:
    """Return the controller or the agent with a name, as it plays the episodes of seeds.

    Raises:
        KeyError, ValueError: there is none on the id.
    """
    if name == "load_rule":
        return as_factory(load_rule)
    if name == "analytic_gradient":
        from train.agents import onnx_policy

        return onnx_policy.load(AGENT).make
    from baselines import catalogue

    if env_id == FAMILY_ID:
        family = Family.load("shop")
        return catalogue.spec(
            name, [family.job(seed).scenario for seed in seeds], Scenario.load(family.base)
        ).make
    return catalogue.spec(name, Scenario.load(IDS[env_id])).make


def record(
    make: PolicyFactory, seeds: Sequence[int], noise: float = 0.0, env_id: str = ENV_ID
) -> list[EpisodeBuffer]:
    """Play one episode per seed, all side by side: observations (T + 1, entries), actions (T, size), rewards [s] and ends (T).

    The noise of an episode depends on its seed alone.
    """
    envs = vector_env(
        "shop" if env_id == FAMILY_ID else IDS[env_id], len(seeds), AutoresetMode.NEXT_STEP
    )
    own = len(layout(envs.scenario))  # a controller does not see the context
    controller = make(len(seeds))
    generators = [np.random.default_rng(seed) for seed in seeds]
    observations, _ = envs.reset(seed=list(seeds))
    controller.reset(np.ones(len(seeds), np.bool_))
    seen, steps = [observations], []
    lengths = np.zeros(len(seeds), np.int64)
    while not lengths.all():
        actions = controller.act(observations[:, :own])
        if noise:
            actions = actions + np.stack(
                [each.normal(0.0, noise, actions.shape[1]) for each in generators]
            )
        actions = actions.clip(-1.0, 1.0).astype(np.float32)
        observations, rewards, terminated, truncated, _ = envs.step(actions)
        seen.append(observations)
        steps.append((actions, rewards, terminated, truncated))
        ended = terminated | truncated
        lengths[ended & (lengths == 0)] = len(steps)
        controller.reset(ended)
    entries, columns = (
        np.stack(seen, axis=1),
        [np.stack(column, axis=1) for column in zip(*steps, strict=True)],
    )
    return [
        EpisodeBuffer(
            None,
            seed,
            None,
            entries[index, : length + 1],
            *(column[index, :length] for column in columns),
            {},
        )
        for index, (seed, length) in enumerate(zip(seeds, lengths, strict=True))
    ]


def make(behaviour: str, episodes: int, out: Path, env_id: str = ENV_ID) -> Path:
    """Play and write a data set, whole or not at all; returns its folder. What is there already is left as it is."""
    name = f"{IDS.get(env_id, 'family')}-{behaviour}-v0"
    if (out / name).exists():
        return out / name
    policies, noise = acting(behaviour)
    buffers: list[EpisodeBuffer] = []
    with tqdm(total=episodes, desc=behaviour, unit="episode", disable=None) as bar:
        for number, each in enumerate(
            policies
        ):  # by turns: seed i is played by policy i modulo their number
            seeds = range(FIRST_SEED + number, FIRST_SEED + episodes, len(policies))
            for start in range(0, len(seeds), NUM_ENVS):
                some = seeds[start : start + NUM_ENVS]
                buffers += record(policy(each, env_id, some), some, noise, env_id)
                bar.update(len(buffers) - bar.n)
    buffers.sort(key=lambda buffer: buffer.seed)
    out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=out.resolve(), prefix=".partial-") as folder:
        write(name, behaviour, buffers, Path(folder), env_id)
        (Path(folder) / name).replace(out / name)
    return out / name


def write(name: str, behaviour: str, buffers: list[EpisodeBuffer], root: Path, env_id: str) -> None:
    """Have Minari write a data set below ``root``, with a description and its cards."""
    source = Family.load("shop") if env_id == FAMILY_ID else Scenario.load(IDS[env_id])
    policies, noise = acting(behaviour)
    folder = patch.dict(
        os.environ, {"MINARI_DATASETS_PATH": str(root)}
    )  # Minari takes the folder from nowhere else
    with folder, warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", message=".*(author|code_permalink)"
        )  # Minari would have a mail address
        dataset = minari.create_dataset_from_buffers(
            name,
            buffers,
            env=gymnasium.spec(env_id),
            eval_env=gymnasium.spec(env_id),
            algorithm_name=behaviour,
            description=f"{env_id}, by {' and '.join(policies)}; rewards in s of machine time.",
            requirements=["rough-turning"],
        )
    dataset.storage.update_metadata(
        {
            "scenario": source.to_toml() if isinstance(source, Scenario) else source.name,
            "scenario_digest": source.digest(),
            "action_noise": noise,
            "first_seed": buffers[0].seed,
            "last_seed": buffers[-1].seed,
            "seeds_are": "of training seed 999: none is trained on, tuned on or held out by the project",
        }
    )
    turns = zip(cycle(policies), buffers, strict=False)
    marks = [{"behaviour": name, "return": float(sum(each.rewards))} for name, each in turns]
    dataset.storage.update_episode_metadata(marks)
    data_card.write(root / name, dataset.storage.metadata, checksum(dataset))


def load(folder: Path) -> minari.MinariDataset:
    """Open a data set of ``make``.

    Raises:
        ValueError: the folder holds none.
    """
    dataset = minari.MinariDataset(folder.resolve() / "data")
    if "scenario_digest" not in dataset.storage.metadata:
        raise ValueError(f"{folder} holds a data set that this command did not make")
    return dataset


def checksum(dataset: minari.MinariDataset) -> str:
    """Return the SHA-256 of all arrays, episode by episode: observations, actions, rewards, terminations, truncations."""
    digest = hashlib.sha256()
    for episode in dataset.iterate_episodes():
        for array in (
            episode.observations,
            episode.actions,
            episode.rewards,
            episode.terminations,
            episode.truncations,
        ):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@exits(ValueError, KeyError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m examples.offline", **described(__doc__))
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("make", help="play, write data sets, print their checksums")
    making.add_argument(
        "--env",
        choices=[*IDS, FAMILY_ID],
        default=ENV_ID,
        help="environment id (default: %(default)s)",
    )
    making.add_argument(
        "--behaviours",
        nargs="+",
        metavar="NAME",
        default=CANONICAL,
        help=f"default: {' '.join(CANONICAL)}",
    )
    making.add_argument(
        "--episodes", type=at_least(1), default=200, help="of each (default: %(default)s)"
    )
    making.add_argument(
        "--out",
        type=Path,
        default=Path("runs/datasets"),
        help="folder of data sets (default: %(default)s)",
    )
    options = parser.parse_args(arguments)
    if options.episodes > MAX_EPISODES:
        parser.error(f"--episodes is {options.episodes}, but must be at most {MAX_EPISODES}")
    if options.env == ENV_ID and (
        unknown := [each for each in options.behaviours if each not in BEHAVIOURS]
    ):
        parser.error(f"--behaviours has {unknown[0]!r}, but must be of {', '.join(BEHAVIOURS)}")
    for behaviour in options.behaviours:
        folder = make(behaviour, options.episodes, options.out, options.env)
        dataset = load(folder)
        marks = list(dataset.storage.get_episode_metadata(dataset.episode_indices))
        returns = {
            name: [each["return"] for each in marks if each["behaviour"] == name]
            for name in acting(behaviour)[0]
        }
        means = ", ".join(
            f"{name} {np.mean(values):.1f} s" for name, values in returns.items() if values
        )
        print(
            f"{folder}: {dataset.total_episodes} episodes, {dataset.total_steps} steps; mean return of {means}"
        )
        print(f"    sha256 {checksum(dataset)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
