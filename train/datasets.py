"""Record data sets of a family's training jobs in Minari's format, for offline learners.

    python -m train.datasets --jobs 256 --out runs/datasets
    python -m train.datasets --policy self_tuning random --jobs 16 --out small

``self_tuning`` is the best rule. ``causal`` is the oracle on trajectories of its own: an action,
its reward and the next observation belong together, so every learner can use them. ``random`` draws
its actions. ``mixture`` holds three behaviours by turns of jobs: the rule, the rule with noise, and
random actions. Without ``--policy`` all four are recorded.

Observations are an agent's: those of the environment with the nominal model's numbers and the
derived inputs (``baselines/derived_observation.py``). Actions are the environment's own increments,
rewards are in seconds of machine time. The hidden state is apart from them, in ``infos``. Jobs are
the first training jobs; those of other splits are never recorded. ``examples/offline.py`` records
other ids.
"""

import argparse
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from unittest.mock import patch

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from baselines.comparators import CAUSAL
from baselines.derived_observation import DerivedObservation
from baselines.oracles.truthful import Truthful
from leaderboard.agents.agent_file import wrapped
from leaderboard.family import FamilyPlay
from leaderboard.inputs import Inputs
from turning_env import FAMILY_ID, MODEL_VERSION, Family, FamilyVectorEnv
from turning_env.console import Parser, described, exits, positive
from turning_env.extras import needed
from turning_env.files import folder_lock
from turning_env.progress import Counter, progress

SPLIT = "train"
BATCH = 64
"""Jobs that are played side by side."""
SPEED_AND_FEED = 2
"""Entries of an action that are changes of speed and feed; the next one changes the edge."""
OBSERVED = {"derived": True}
"""Settings of an agent (``train/terms.py``) whose observations are recorded."""
HIDDEN = (
    "hardness",  # of the cut over nominal [-], 0 in air
    "depth_of_cut",  # [mm], 0 in air
    "wear",  # flank wear [mm]
    "wear_factor",  # wear of the insert over nominal [-]
    "used_life",  # share of the edge's life [-]
    "edge_strength",  # thrust force that breaks the edge [N]
    "thrust_force",  # true, without noise [N]
    "power",  # likewise [kW]
)
"""Entries of ``info`` that are recorded as the hidden state."""


class Behaviour(NamedTuple):
    """A policy, and noise on its changes of speed and feed."""

    policy: str
    noise: float = 0.0
    """Standard deviation of the noise [-]; actions with noise are clipped to -1..1."""

    @property
    def name(self) -> str:
        """Name of the behaviour, such as ``self_tuning`` or ``self_tuning+noise``."""
        return f"{self.policy}+noise" if self.noise else self.policy


POLICIES = {
    "self_tuning": (Behaviour("self_tuning"),),
    CAUSAL: (Behaviour(CAUSAL),),
    "random": (Behaviour("random"),),
    "mixture": (
        Behaviour("self_tuning"),
        Behaviour("self_tuning", noise=0.3),
        Behaviour("random"),
    ),
}
"""Behaviours of each data set: of n behaviours, number i plays the jobs i, i + n, i + 2 n, ..."""


@dataclass(frozen=True)
class Recording:
    """One recorded episode of ``steps`` steps."""

    job: int
    """Number of the training job, which is the episode's seed."""
    behaviour: str
    observations: NDArray[np.float32]
    """Before each step and after the last one, shape (steps + 1, entries)."""
    actions: NDArray[np.float32]
    """In -1..1, shape (steps, action size)."""
    rewards: NDArray[np.float64]
    """[s], shape (steps,)."""
    terminations: NDArray[np.bool_]
    """Whether the episode terminates with the step, shape (steps,)."""
    truncations: NDArray[np.bool_]
    """Whether the job's time is over with the step, shape (steps,)."""
    hidden: dict[str, NDArray[np.float64]]
    """The hidden state at the observations, shape (steps + 1,) for each of ``HIDDEN``."""


class _Step(NamedTuple):
    """Results of a step, and the observations after it.

    Arrays have a first axis of environments.
    """

    observations: NDArray[np.float32]
    hidden: NDArray[np.float64]  # (num_envs, entries of HIDDEN)
    actions: NDArray[np.float32]
    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]


def play(
    family: Family,
    behaviour: Behaviour,
    jobs: Sequence[int],
    on_step: Callable[[int], None] = lambda ended: None,
) -> list[Recording]:
    """Play training jobs side by side; an episode does not depend on the others.

    The policy acts in environments of its own, whose nominal models are those that it knows: the
    oracle's are true. Twins of these environments take the same actions and show the observations
    of an agent. Random numbers are keyed by the job, so both are in the same state.

    Args:
        family: the family.
        behaviour: the policy and its noise.
        jobs: numbers of the training jobs.
        on_step: called after every step with the number of episodes that have ended.
    """
    num_envs = len(jobs)
    is_told = behaviour.policy == CAUSAL
    known_family = Truthful.of(family) if is_told else family
    plays = FamilyPlay(known_family, SPLIT, behaviour.policy, forgets=False)
    policy: Any = plays.make([known_family.job(job) for job in jobs])(num_envs)
    noises = [np.random.default_rng(job) for job in jobs]

    acting = FamilyVectorEnv(num_envs, known_family, SPLIT, "hidden", AutoresetMode.NEXT_STEP)
    twins = FamilyVectorEnv(num_envs, family, SPLIT, "told", AutoresetMode.NEXT_STEP)
    shown = wrapped(twins, Inputs.of(OBSERVED))
    seen, seen_infos = acting.reset(seed=list(jobs))
    observations, infos = shown.reset(seed=list(jobs))
    policy.reset(np.ones(num_envs, np.bool_))

    before_steps = (observations, _hidden(infos))
    steps: list[_Step] = []
    lengths = np.zeros(num_envs, np.int64)
    while not lengths.all():
        if is_told:
            policy.tell(seen_infos)
        actions = policy.act(seen)
        if behaviour.noise:
            actions = _with_noise(actions, behaviour.noise, noises)
        seen, _, _, _, seen_infos = acting.step(actions)
        observations, rewards, terminated, truncated, infos = shown.step(actions)
        step = _Step(
            observations=observations,
            hidden=_hidden(infos),
            actions=actions,
            rewards=rewards,
            terminated=terminated,
            truncated=truncated,
        )
        steps.append(step)
        ended = terminated | truncated
        lengths[ended & (lengths == 0)] = len(steps)
        on_step(int(np.count_nonzero(lengths)))
    return _recordings(behaviour, jobs, before_steps, steps, lengths)


def _hidden(infos: dict[str, Any]) -> NDArray[np.float64]:
    """Return the hidden state, shape (num_envs, entries of ``HIDDEN``)."""
    return np.stack([infos[name] for name in HIDDEN], axis=1)


def _with_noise(
    actions: NDArray[np.float32], deviation: float, noises: Sequence[np.random.Generator]
) -> NDArray[np.float32]:
    """Return actions with noise from each environment's generator on speed and feed."""
    noisy = actions.copy()
    for row, noise in zip(noisy, noises, strict=True):
        row[:SPEED_AND_FEED] += noise.normal(0.0, deviation, SPEED_AND_FEED)
    return noisy.clip(-1.0, 1.0)


def _recordings(
    behaviour: Behaviour,
    jobs: Sequence[int],
    before_steps: tuple[NDArray[np.float32], NDArray[np.float64]],
    steps: Sequence[_Step],
    lengths: NDArray[np.int64],
) -> list[Recording]:
    """Return the recording of each environment's first episode.

    Args:
        behaviour: what has acted.
        jobs: numbers of the jobs.
        before_steps: first observations and hidden states.
        steps: the steps of all environments.
        lengths: steps of each environment's first episode; what it played later is left out.
    """
    first_observations, first_hidden = before_steps
    observations = np.stack([first_observations, *(step.observations for step in steps)])
    hidden = np.stack([first_hidden, *(step.hidden for step in steps)])
    actions = np.stack([step.actions for step in steps])
    rewards = np.stack([step.rewards for step in steps])
    terminated = np.stack([step.terminated for step in steps])
    truncated = np.stack([step.truncated for step in steps])
    recordings = []
    for index, length in enumerate(lengths.tolist()):
        states = hidden[: length + 1, index]
        recording = Recording(
            job=jobs[index],
            behaviour=behaviour.name,
            observations=observations[: length + 1, index],
            actions=actions[:length, index],
            rewards=rewards[:length, index],
            terminations=terminated[:length, index],
            truncations=truncated[:length, index],
            hidden=dict(zip(HIDDEN, states.T, strict=True)),
        )
        recordings.append(recording)
    return recordings


def _batches(family: Family, policy: str, num_jobs: int) -> Iterator[list[Recording]]:
    """Yield the recordings of the first training jobs in batches, and show the progress."""
    behaviours = POLICIES[policy]
    with progress(total=num_jobs, desc=policy, unit="job") as bar:
        for number, behaviour in enumerate(behaviours):
            jobs = range(number, num_jobs, len(behaviours))
            for start in range(0, len(jobs), BATCH):
                yield play(family, behaviour, jobs[start : start + BATCH], Counter(bar))


def folder_of(out: Path, family: Family, policy: str) -> Path:
    """Return the folder of a data set below ``out``, such as ``out/shop-self_tuning-v0``."""
    return out / f"{family.name}-{policy}-v0"


def check(family: Family, policy: str, num_jobs: int, out: Path) -> None:
    """Raise ValueError if a data set cannot be recorded: see ``record``."""
    if policy not in POLICIES:
        raise ValueError(f"policy is {policy!r}, but must be one of {', '.join(POLICIES)}")
    if not 1 <= num_jobs <= family.jobs:
        raise ValueError(
            f"jobs is {num_jobs}, but must be 1 to {family.jobs}, the training jobs of family "
            f"{family.name!r}; jobs of other splits are not recorded"
        )
    folder = folder_of(out, family, policy)
    if folder.exists():
        raise ValueError(f"{folder} exists: delete it, or choose another --out")


def record(family: Family, policy: str, num_jobs: int, out: Path) -> Path:
    """Record a data set, whole or not at all; return its folder.

    Args:
        family: the family.
        policy: a name in ``POLICIES``.
        num_jobs: number of training jobs, from the first on.
        out: folder of data sets.

    Raises:
        ValueError: the policy is unknown, the family has fewer training jobs, the data set exists,
            or another process records into ``out``.
        ModuleNotFoundError: Minari is not installed.
        OSError: the data set cannot be written.
    """
    check(family, policy, num_jobs, out)
    folder = folder_of(out, family, policy)
    with folder_lock(out), TemporaryDirectory(dir=out.resolve(), prefix=".partial-") as partial:
        _write(family, policy, num_jobs, Path(partial))
        (Path(partial) / folder.name).replace(folder)
    return folder


def _write(family: Family, policy: str, num_jobs: int, root: Path) -> None:
    """Record a data set into the folder ``root``."""
    minari = _minari()
    name = folder_of(root, family, policy).name
    # Its specification has the wrapper, so Minari recovers an environment with these observations.
    env = DerivedObservation(gymnasium.make(FAMILY_ID, family=family.portable()))
    # Minari takes the folder from nowhere else.
    datasets_path = patch.dict(os.environ, {"MINARI_DATASETS_PATH": str(root)})
    with datasets_path, warnings.catch_warnings():
        # Minari would have an author's address.
        warnings.filterwarnings("ignore", message=".*(author|code_permalink)")
        dataset = minari.create_dataset_from_buffers(
            name,
            [],
            env=env,
            eval_env=env.spec,
            algorithm_name=policy,
            description=f"{FAMILY_ID}, training jobs of {family.name}; rewards in s of machine "
            "time, actions are increments of the environment, infos hold the hidden state.",
            requirements=["rough-turning"],
        )
    dataset.storage.update_metadata(
        {
            "family": family.name,
            "family_digest": family.digest(),
            "policy": policy,
            "model_version": MODEL_VERSION,
        }
        | OBSERVED
    )
    for recordings in _batches(family, policy, num_jobs):
        first = dataset.storage.total_episodes
        dataset.storage.update_episodes(_buffer(recording) for recording in recordings)
        dataset.storage.update_episode_metadata(
            [
                {"behaviour": recording.behaviour, "return": float(recording.rewards.sum())}
                for recording in recordings
            ],
            range(first, first + len(recordings)),
        )


def _buffer(recording: Recording) -> Any:
    """Return a recording as Minari's buffer; its seed is the job."""
    with needed():
        from minari.data_collector import EpisodeBuffer  # type: ignore[import-untyped]

    return EpisodeBuffer(
        seed=recording.job,
        observations=recording.observations,
        actions=recording.actions,
        rewards=recording.rewards,
        terminations=recording.terminations,
        truncations=recording.truncations,
        infos=recording.hidden,
    )


def _minari() -> Any:
    """Return the module Minari, which writes by h5py."""
    with needed():
        import h5py  # type: ignore[import-untyped]  # noqa: F401
        import minari  # type: ignore[import-untyped]

    return minari


def load(folder: Path) -> Any:
    """Return a data set of ``record`` as a ``minari.MinariDataset``.

    Raises:
        ValueError: the folder holds none.
        ModuleNotFoundError: Minari is not installed.
    """
    minari = _minari()
    if not (folder / "data").is_dir():
        raise ValueError(f"{folder} holds no data set: python -m train.datasets records one")
    dataset = minari.MinariDataset(folder.resolve() / "data")
    if "family_digest" not in dataset.storage.metadata:
        raise ValueError(f"{folder} holds a data set that python -m train.datasets did not record")
    return dataset


def summary(folder: Path) -> str:
    """Return a line on a data set, with the mean return of each behaviour [s]."""
    dataset = load(folder)
    returns: dict[str, list[float]] = {}
    for episode in dataset.storage.get_episode_metadata(dataset.episode_indices):
        returns.setdefault(episode["behaviour"], []).append(episode["return"])
    means = [f"{name} {np.mean(values):.0f} s" for name, values in returns.items()]
    return (
        f"{folder}: {dataset.total_episodes} jobs, {dataset.total_steps} steps; "
        f"mean return per job: {', '.join(means)}"
    )


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m train.datasets", **described(__doc__))
    parser.add_argument(
        "--policy",
        nargs="+",
        choices=POLICIES,
        default=list(POLICIES),
        help="what acts (default: all)",
    )
    parser.add_argument(
        "--scenario", default="shop", help="family, or its TOML file (default: %(default)s)"
    )
    parser.add_argument(
        "--jobs",
        type=positive,
        default=256,
        help="training jobs of each data set, from the first on (default: %(default)s)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("runs/datasets"),
        help="folder of data sets (default: %(default)s)",
    )
    return parser


@exits(ValueError, interrupted="interrupted: data sets that were complete are kept")
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    options = _parser().parse_args(arguments)
    family = Family.load(options.scenario)
    for policy in options.policy:
        check(family, policy, options.jobs, options.out)
    for policy in options.policy:
        print(summary(record(family, policy, options.jobs, options.out)), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
