"""Offline data sets in Minari's format.

    python -m examples.offline make --out runs/datasets
    python -m examples.offline make --behaviours mixture --episodes 20 --out runs/small
    python -m examples.offline make --env RoughTurning-Family-v1 --behaviours self_tuning

Behaviours: `grid_search`, the published controller; `analytic_gradient`, the best policy that
ships; `mixture`, both by turns, with noise; `load_rule`, a simple rule with noise that needs the
wheel alone. Without --behaviours the first three are recorded. On other ids, a behaviour is the
name of a controller that is tuned there. Episodes are those of seeds that no agent is trained on,
no rule is tuned on and nothing is scored on.
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
from typing import Any, NamedTuple
from unittest.mock import patch

import gymnasium
import minari  # type: ignore[import-untyped]
import numpy as np
from gymnasium.vector import AutoresetMode
from minari.data_collector.episode_buffer import EpisodeBuffer  # type: ignore[import-untyped]
from numpy.typing import NDArray
from tqdm import tqdm

from examples import data_card
from examples.shared import ENV_ID, at_least, run
from leaderboard.adapt import as_factory
from leaderboard.seeds import TUNING_START
from turning_env import ALL_IDS, FAMILY_ID, IDS, Family, Scenario
from turning_env.console import described, exits
from turning_env.family_env import vector_env
from turning_env.physics.quantities import OBS, OBSERVATION, Entry, layout
from turning_env.policy import Observations, PolicyFactory
from turning_env.scenario.arguments import environment_id
from turning_env.scenario.family import CONTEXT_LIMIT

AGENTS = Path(__file__).parents[1] / "agents"
AGENT = AGENTS / ENV_ID / "rough_turning" / "analytic_gradient-seed0.onnx"
FIRST_SEED = 999_000_000
"""First seed of the last training seed, which is kept for data sets."""
MAX_EPISODES = TUNING_START - FIRST_SEED
NUM_ENVS = 64
"""Number of episodes played side by side."""


class Behaviour(NamedTuple):
    """Policies that act in turn, with noise on their actions."""

    policies: tuple[str, ...]
    noise: float = 0.0
    """Standard deviation of the noise; actions with noise are clipped to -1..1."""


BEHAVIOURS = {
    "grid_search": Behaviour(("grid_search",)),
    "analytic_gradient": Behaviour(("analytic_gradient",)),
    "mixture": Behaviour(("grid_search", "analytic_gradient"), noise=0.2),
    "load_rule": Behaviour(("load_rule",), noise=0.2),
}
CANONICAL = ("grid_search", "analytic_gradient", "mixture")
"""Behaviours that are recorded without --behaviours."""


def behaviour_of(name: str) -> Behaviour:
    """Return the behaviour with a name; a controller's name is one, too."""
    return BEHAVIOURS.get(name, Behaviour((name,)))


def load_rule(observations: Observations) -> Any:
    """Return actions of a simple rule.

    They lower the feed while the power or the force is above 80 % of its limit, and raise it below.
    """
    # Loads are observed as 5 * (load / limit - 1): -1 is 80 % of the limit.
    load = observations[:, [OBS.power, OBS.thrust_force]].max(axis=1)
    feed = -0.3 * (load + 1.0)
    return np.stack((np.zeros_like(feed), feed), axis=1)


def policy(name: str, env_id: str = ENV_ID, seeds: Sequence[int] = ()) -> PolicyFactory:
    """Return the controller or the agent with a name, as it plays the episodes of seeds.

    Raises:
        KeyError, ValueError: there is none on the id.
    """
    if name == "load_rule":
        return as_factory(load_rule)
    if name == "analytic_gradient":
        from leaderboard.agents import onnx_policy

        return onnx_policy.load(AGENT).make
    from baselines import catalogue

    if env_id == FAMILY_ID:
        family = Family.load("shop")
        scenarios = [family.job(seed).scenario for seed in seeds]
        return catalogue.spec(name, scenarios, Scenario.load(family.base)).make
    return catalogue.spec(name, Scenario.load(IDS[env_id])).make


class Steps(NamedTuple):
    """Results of a step of all environments; arrays have a first axis of environments."""

    actions: NDArray[np.float32]
    rewards: NDArray[np.float64]  # [s]
    terminations: NDArray[np.bool_]
    truncations: NDArray[np.bool_]


def record(
    make: PolicyFactory, seeds: Sequence[int], noise: float = 0.0, env_id: str = ENV_ID
) -> list[EpisodeBuffer]:
    """Play one episode per seed, all side by side.

    The noise of an episode depends on its seed alone.

    Returns:
        per episode: observations (T + 1, entries), actions (T, size), rewards [s] and ends (T).
    """
    source = "shop" if env_id == FAMILY_ID else IDS[env_id]
    envs = vector_env(source, len(seeds), AutoresetMode.NEXT_STEP)
    # A controller does not see the context of a family's job, which follows the scenario's entries.
    entries = len(layout(envs.scenario))
    controller = make(len(seeds))
    generators = [np.random.default_rng(seed) for seed in seeds]

    first_observations, _ = envs.reset(seed=list(seeds))
    controller.reset(np.ones(len(seeds), np.bool_))
    observations = [first_observations]
    steps: list[Steps] = []
    lengths = np.zeros(len(seeds), np.int64)
    while not lengths.all():
        actions = controller.act(observations[-1][:, :entries])
        if noise:
            size = actions.shape[1]
            noises = [generator.normal(0.0, noise, size) for generator in generators]
            actions = actions + np.stack(noises)
        actions = actions.clip(-1.0, 1.0).astype(np.float32)
        next_observations, rewards, terminated, truncated, _ = envs.step(actions)
        observations.append(next_observations)
        steps.append(Steps(actions, rewards, terminated, truncated))
        ended = terminated | truncated
        lengths[ended & (lengths == 0)] = len(steps)
        controller.reset(ended)
    return _buffers(observations, steps, seeds, lengths)


def _buffers(
    observations: Sequence[NDArray[np.float32]],
    steps: Sequence[Steps],
    seeds: Sequence[int],
    lengths: NDArray[np.int64],
) -> list[EpisodeBuffer]:
    """Return Minari's buffer of each episode.

    What an environment played after its episode's end is left out.
    """
    observations_of_envs = np.stack(observations, axis=1)
    actions = np.stack([step.actions for step in steps], axis=1)
    rewards = np.stack([step.rewards for step in steps], axis=1)
    terminations = np.stack([step.terminations for step in steps], axis=1)
    truncations = np.stack([step.truncations for step in steps], axis=1)
    buffers = []
    for index, (seed, length) in enumerate(zip(seeds, lengths, strict=True)):
        buffer = EpisodeBuffer(
            seed=seed,
            observations=observations_of_envs[index, : length + 1],
            actions=actions[index, :length],
            rewards=rewards[index, :length],
            terminations=terminations[index, :length],
            truncations=truncations[index, :length],
            infos={},
        )
        buffers.append(buffer)
    return buffers


def make(behaviour: str, episodes: int, out: Path, env_id: str = ENV_ID) -> Path:
    """Play and write a data set, whole or not at all; return its folder.

    A data set that is there already is left as it is.
    """
    name = f"{IDS.get(env_id, 'family')}-{behaviour}-v0"
    if (out / name).exists():
        return out / name
    policies, noise = behaviour_of(behaviour)
    buffers: list[EpisodeBuffer] = []
    with tqdm(total=episodes, desc=behaviour, unit="episode", disable=None) as bar:
        # By turns: policy i of n plays the seeds i, i + n, i + 2 n, ... after the first.
        for number, policy_name in enumerate(policies):
            seeds = range(FIRST_SEED + number, FIRST_SEED + episodes, len(policies))
            for start in range(0, len(seeds), NUM_ENVS):
                some_seeds = seeds[start : start + NUM_ENVS]
                factory = policy(policy_name, env_id, some_seeds)
                buffers += record(factory, some_seeds, noise, env_id)
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
    policies, noise = behaviour_of(behaviour)
    # Minari takes the folder from nowhere else.
    datasets_path = patch.dict(os.environ, {"MINARI_DATASETS_PATH": str(root)})
    with datasets_path, warnings.catch_warnings():
        # Minari would have a mail address.
        warnings.filterwarnings("ignore", message=".*(author|code_permalink)")
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
            "seeds_are": "of training seed 999: none is trained on, tuned on or held out by the "
            "project",
        }
    )
    episodes = []
    for number, (policy_name, buffer) in enumerate(zip(cycle(policies), buffers, strict=False)):
        episodes.append(
            data_card.Episode(
                episode=number,
                seed=buffer.seed,
                behaviour=policy_name,
                steps=len(buffer.rewards),
                total_reward=float(sum(buffer.rewards)),
            )
        )
    dataset.storage.update_episode_metadata(
        [{"behaviour": row.behaviour, "return": row.total_reward} for row in episodes]
    )
    data_card.write(
        root / name,
        dataset.storage.metadata,
        checksum(dataset),
        episodes=episodes,
        observation=_observation_entries(source),
        action_size=buffers[0].actions.shape[1],
    )


def _observation_entries(source: Scenario | Family) -> list[data_card.ObservationEntry]:
    """Return the entries of the observations of a scenario or a family."""
    scenario = source if isinstance(source, Scenario) else source.job(0).scenario
    entries = [entry for entry in OBSERVATION if entry.present(scenario)]
    if isinstance(source, Family):
        meaning = "number of the nominal model, standardised"
        for name in source.context_names:
            entries.append(Entry(name, meaning, low=-CONTEXT_LIMIT, high=CONTEXT_LIMIT))
    rows = []
    for place, entry in enumerate(entries):
        rows.append(
            data_card.ObservationEntry(
                place=place,
                name=entry.name,
                meaning=entry.meaning,
                low=entry.low,
                high=entry.high,
            )
        )
    return rows


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
    """Return the SHA-256 of all arrays, episode by episode.

    The order is observations, actions, rewards, terminations, truncations.
    """
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


def _summary(folder: Path, behaviour: str, dataset: minari.MinariDataset) -> str:
    """Return a line on a data set, with the mean return of each policy."""
    episodes = list(dataset.storage.get_episode_metadata(dataset.episode_indices))
    means = []
    for name in behaviour_of(behaviour).policies:
        returns = [episode["return"] for episode in episodes if episode["behaviour"] == name]
        if returns:
            means.append(f"{name} {np.mean(returns):.1f} s")
    return (
        f"{folder}: {dataset.total_episodes} episodes, {dataset.total_steps} steps; "
        f"mean return of {', '.join(means)}"
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m examples.offline", **described(__doc__))
    commands = parser.add_subparsers(dest="command", required=True)
    make_parser = commands.add_parser("make", help="play, write data sets, print their checksums")
    make_parser.add_argument(
        "--env",
        type=environment_id,
        choices=ALL_IDS,
        default=ENV_ID,
        help="environment id (default: %(default)s)",
    )
    make_parser.add_argument(
        "--behaviours",
        nargs="+",
        metavar="NAME",
        default=CANONICAL,
        help=f"default: {' '.join(CANONICAL)}",
    )
    make_parser.add_argument(
        "--episodes", type=at_least(1), default=200, help="of each (default: %(default)s)"
    )
    make_parser.add_argument(
        "--out",
        type=Path,
        default=Path("runs/datasets"),
        help="folder of data sets (default: %(default)s)",
    )
    return parser


@exits(ValueError, KeyError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.episodes > MAX_EPISODES:
        parser.error(f"--episodes is {options.episodes}, but must be at most {MAX_EPISODES}")
    unknown = [name for name in options.behaviours if name not in BEHAVIOURS]
    if options.env == ENV_ID and unknown:
        parser.error(f"--behaviours has {unknown[0]!r}, but must be of {', '.join(BEHAVIOURS)}")
    for behaviour in options.behaviours:
        folder = make(behaviour, options.episodes, options.out, options.env)
        dataset = load(folder)
        print(_summary(folder, behaviour, dataset))
        print(f"    sha256 {checksum(dataset)}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
