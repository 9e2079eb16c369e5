"""Export trained agents as ONNX files, which play without PyTorch.

    python -m train.export runs/RoughTurning-v0/rough_turning/ppo-seed0 --out my-agents
    python -m train.export my_model.zip --env RoughTurning-v0 --name mine --out my-agents
    python -m train.export my_model.zip --statistics vec_normalize.pkl --out my-agents
    python -m train.export my_network.onnx --scenario my_mill.toml --seed 1 --out my-agents
    python -m train.export my_model.zip --set load_target=true --set derived=true --out my-agents

An agent is the folder of a training run, or any file in it; a model that Stable-Baselines3 has
saved; or a network in ONNX. A file is written only if it acts as the agent does, on observations
sampled from the observation space and on those of episodes. See
``leaderboard/agents/agent_file.py`` for what a file holds.
"""

import argparse
import json
import math
import os
import re
import shlex
import sys
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from tqdm import tqdm

from leaderboard.agents import agent_file
from leaderboard.agents.agent_file import (
    FORMAT,
    NAME,
    ONNX_SUFFIX,
    AgentFile,
    Metadata,
    Space,
    training_family,
)
from leaderboard.agents.network import session_after_trial
from leaderboard.agents.onnx_session import OnnxPolicy
from leaderboard.inputs import TRAINING_INPUTS, Inputs
from leaderboard.seeds import tuning_seeds
from train.actor import Actor, ActorPolicy
from train.run import ALGORITHMS, Run, settings_of, trained_on, typed
from train.to_onnx import ModuleActor, adopted, sb3_actor, to_onnx
from train.training import load_actor, stating_information
from turning_env import ALL_IDS, Family, Scenario
from turning_env.console import Parser, described, exits
from turning_env.family_env import vector_env
from turning_env.files import write_file
from turning_env.policy import Policy
from turning_env.scenario.arguments import environment_id
from turning_env.scenario.section import names_instead

# Numbers of environments and steps in each of the two comparisons of agent and file.
NUM_ENVS = 50
STEPS = 100
MAX_DIFFERENCE = 2e-5
"""Largest difference between an agent's action and its file's in episodes: rounding in single
precision."""
MAX_SAMPLED_DIFFERENCE = 1e-3
"""Likewise on observations sampled from the observation space: no lathe has such observations, and
a search on them may stop elsewhere."""
SETTINGS = {
    "belief": False,
    "derived": False,
    "load_target": False,
    "training_information": ["rewards"],
}
"""Settings of a training elsewhere, with a value of the same type each: the terms of
``train/terms.py`` that play provides, and the inputs of the training, names in
``leaderboard.inputs.TRAINING_INPUTS``."""
_VERSIONS = ("rough-turning", "torch", "onnx", "onnxscript")


class Differences(NamedTuple):
    """Largest differences between the actions of an agent and of its file."""

    sampled: float  # on observations sampled from the observation space
    played: float  # on those of episodes

    @property
    def largest(self) -> float:
        """The larger of the two."""
        return max(self.sampled, self.played)

    @property
    def are_small(self) -> bool:
        """Whether the file acts as the agent does; not with NaN."""
        return self.played <= MAX_DIFFERENCE and self.sampled <= MAX_SAMPLED_DIFFERENCE


@dataclass(frozen=True)
class _Agent:
    """An agent to export."""

    source: str
    metadata: Metadata
    actor: Actor | None  # the actor; None: the source is itself a network in ONNX

    @property
    def file_name(self) -> str:
        return f"{self.metadata.label}{ONNX_SUFFIX}"

    def write(self, path: Path) -> dict[str, Any]:
        """Write the agent's file; see ``export``."""
        torch.set_num_threads(1)
        try:
            file = self._file()
            differences = self._differences(file)
            if not differences.are_small:
                raise ValueError(f"its file acts otherwise, by up to {differences.largest:g}")
        except ValueError as error:
            raise ValueError(f"{self.source} cannot be exported: {error}") from error
        write_file(path, file.content)
        return {
            "path": str(path),
            "digest": file.digest,
            "size": len(file.content),
            "observations": 2 * NUM_ENVS * STEPS,
            "largest_difference": differences.largest,
        }

    def _file(self) -> AgentFile:
        with torch.no_grad():
            if self.actor is None:
                content = adopted(Path(self.source), self.metadata)
            else:
                content = to_onnx(self.actor, self.metadata)
        return agent_file.checked(content)

    def _differences(self, file: AgentFile) -> Differences:
        """Try the file, and compare it with the agent; a network in ONNX is the file itself."""
        session = session_after_trial(
            file.content,
            entries=len(file.metadata.observation_space.low),
            actions=len(file.metadata.action_space.low),
            memory_size=file.memory_size,
        )
        if self.actor is None:
            return Differences(sampled=0.0, played=0.0)
        return largest_differences(
            ActorPolicy(self.actor, NUM_ENVS),
            OnnxPolicy(session, file.memory_size, NUM_ENVS),
            metadata=file.metadata,
            env=_environments(file.metadata),
        )


def export(folder: Path, out: Path, name: str | None = None) -> dict[str, Any]:
    """Write the finished agent of one of your own runs to the folder ``out``.

    The file's name states agent and training seed.

    Returns:
        ``path``, ``digest`` (SHA-256) and ``size`` [bytes] of the file, the ``largest_difference``
        of its actions from the agent's, and the number of compared ``observations``.

    Raises:
        ValueError: the run has no finished agent, its network cannot be written as ONNX, or the
            file would act otherwise.
        OSError: no file can be written.
    """
    agent = _of_run(folder, name)
    return agent.write(out / agent.file_name)


def export_torch(
    module: torch.nn.Module,
    path: str | os.PathLike[str],
    env_id: str = "RoughTurning-v0",
    *,
    scenario: Scenario | str | os.PathLike[str] | None = None,
    name: str | None = None,
    seed: int | None = None,
    trained_steps: int = 0,
    settings: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Write an agent's file for a PyTorch module.

    The module takes observations (n, entries) and returns actions (n, actions); actions beyond
    -1..1 are clipped. A module with an attribute ``memory_size`` is recurrent: it also takes a
    memory (n, memory_size), which is 0 before an episode's first observation, and also returns the
    next memory.

    Args:
        module: the trained module.
        path: path of the file.
        env_id: the environment on which it was trained.
        scenario: the scenario on which it was trained; None: the id's own.
        name: the agent's name on leaderboards; None: the file's name.
        seed: training seed; agents of one name with several seeds are one policy. None: the seed in
            a file name such as ``me-seed3.onnx``, else 0.
        trained_steps: environment steps of the training.
        settings: ``belief``, ``derived`` or ``load_target`` is True if the environments of the
            training had ``VectorBeliefObservation``, ``VectorDerivedObservation`` or
            ``VectorLoadTargetAction`` around them. ``training_information`` lists what the training
            was given beside observations, names in ``leaderboard.inputs.TRAINING_INPUTS`` such as
            "rewards"; without it, the agent is ranked as one whose file does not state it.

    Returns:
        The same as ``export``; raises the same errors.
    """
    path = Path(path)
    actor = module if isinstance(module, Actor) else ModuleActor(module)
    source: Scenario | Family
    if isinstance(scenario, Scenario):
        source = scenario
    else:
        source = trained_on(env_id, None if scenario is None else os.fspath(scenario))
    run = Run.elsewhere(
        "torch", env_id, scenario=source, steps=trained_steps, command="train.export.export_torch"
    )
    run = _stating(run, settings or {})
    agent = _Agent(type(module).__name__, _foreign_metadata(run, path, name=name, seed=seed), actor)
    return agent.write(path)


def _stating(run: Run, settings: Mapping[str, Any]) -> Run:
    """Return a run elsewhere whose parameters also state settings.

    Raises:
        ValueError: there is no such setting, or it has another type or value.
    """
    checked = {}
    for name, value in settings.items():
        if name not in SETTINGS:
            instead = names_instead(name, SETTINGS, "")
            raise ValueError(f"a training elsewhere has no setting {name!r}; {instead}")
        checked[name] = typed(name, value, SETTINGS[name])
    for name in checked.get("training_information", []):
        if name not in TRAINING_INPUTS:
            instead = names_instead(name, TRAINING_INPUTS, "")
            raise ValueError(f"training_information has {name!r}; {instead}")
    return replace(run, parameters=run.parameters | checked)


def _of_run(folder: Path, name: str | None) -> _Agent:
    run = Run.read(folder)
    actor = load_actor(run)
    return _Agent(f"the agent in {folder}", metadata(stating_information(run), name), actor)


def _of_file(
    path: Path, run: Run, name: str | None, seed: int | None, statistics: Path | None
) -> _Agent:
    """Return the agent of a model of Stable-Baselines3 or a network in ONNX.

    It was trained on the environment of a run.
    """
    if path.suffix == ONNX_SUFFIX:
        if statistics is not None:
            raise ValueError(
                f"--statistics is for .zip files of Stable-Baselines3, "
                f"but {path} is a network in ONNX"
            )
        return _Agent(str(path), _foreign_metadata(run, path, name=name, seed=seed), actor=None)
    try:
        trained_run, actor = sb3_actor(path, run, statistics)
    except ValueError as error:
        raise ValueError(f"{path} {error}") from error
    return _Agent(str(path), _foreign_metadata(trained_run, path, name=name, seed=seed), actor)


def _foreign_metadata(run: Run, path: Path, name: str | None, seed: int | None) -> Metadata:
    """Return the metadata of an agent that was trained elsewhere.

    Without a name, it gets its file's name; without a seed, the seed in the file's name.
    """
    # Names on leaderboards are plain ASCII: accents are dropped, other characters become _.
    ascii_stem = unicodedata.normalize("NFKD", path.stem).encode("ascii", "ignore").decode()
    stem = re.sub(r"[^A-Za-z0-9_.-]+", "_", ascii_stem).lstrip(".-")
    seed_in_name = 0
    match = re.search(r"-seed(\d{1,9})$", stem)
    if match:
        stem = stem[: match.start()]
        seed_in_name = int(match[1])
    if not name:
        # The name of an algorithm is that of an agent that ships.
        name = f"my_{stem}" if stem in ALGORITHMS else stem
    return metadata(replace(run, seed=seed_in_name if seed is None else seed), name or "agent")


def metadata(run: Run, name: str | None = None) -> Metadata:
    """Return the metadata of the file of a run's agent. Raise ValueError if the name is no good."""
    name = name or run.name
    if not re.fullmatch(NAME, name):
        raise ValueError(
            f"the name is {name!r}, but must be at most 128 letters, digits, _, . or -, "
            "the first no . or -"
        )
    observation_space = agent_file.seen_space(run.env_id, run.scenario, run.parameters)
    action_space = agent_file.acting_space(run.scenario, run.parameters)
    return Metadata(
        format=FORMAT,
        algorithm=run.algorithm,
        name=name,
        seed=run.seed,
        env_id=run.env_id,
        scenario=run.scenario,
        observation_space=Space.of(observation_space),
        action_space=Space.of(action_space),
        parameters=run.parameters,
        trained_steps=run.parameters["total_timesteps"],
        # Without a folder of this machine.
        command=re.sub(r" --runs[ =]('[^']*'|\S+)", "", run.command),
        versions={package: version(package) for package in _VERSIONS},
    )


def _environments(metadata: Metadata) -> Any:
    """Return ``NUM_ENVS`` environments like those of an agent's training."""
    source = training_family(metadata.env_id, metadata.parameters) or metadata.scenario
    env = vector_env(source, NUM_ENVS, AutoresetMode.SAME_STEP)
    return agent_file.wrapped(env, Inputs.of(metadata.parameters))


def largest_differences(
    original: Policy, policy: Policy, metadata: Metadata, env: Any
) -> Differences:
    """Return the largest differences between the actions of two policies.

    Both see the same observations in ``NUM_ENVS`` environments and keep their own memories. In
    episodes on tuning seeds the original acts.
    """
    sampled = _sampled_difference(original, policy, metadata.observation_space)
    played = _played_difference(original, policy, env)
    return Differences(sampled=sampled, played=played)


def _sampled_difference(original: Policy, policy: Policy, space: Space) -> float:
    # The memory is cleared once: it must agree over a sequence of steps, too.
    rng = np.random.default_rng(0)
    shape = (NUM_ENVS, len(space.low))
    starts = np.ones(NUM_ENVS, np.bool_)
    largest = 0.0
    for _ in range(STEPS):
        observations = rng.uniform(space.low, space.high, shape).astype(np.float32)
        original.reset(starts)
        policy.reset(starts)
        difference = _difference(original.act(observations), policy.act(observations))
        largest = max(largest, difference)
        starts = np.zeros(NUM_ENVS, np.bool_)
    return largest


def _played_difference(original: Policy, policy: Policy, env: Any) -> float:
    observations, _ = env.reset(seed=tuning_seeds(NUM_ENVS))
    starts = np.ones(NUM_ENVS, np.bool_)
    largest = 0.0
    for _ in range(STEPS):
        original.reset(starts)
        policy.reset(starts)
        actions = original.act(observations)
        largest = max(largest, _difference(actions, policy.act(observations)))
        observations, _, terminated, truncated, _ = env.step(actions)
        starts = terminated | truncated
    return largest


def _difference(expected: NDArray[np.float32], actions: NDArray[np.float32]) -> float:
    """Return the largest difference between actions; infinite if some are not finite."""
    if not np.isfinite(actions).all():
        return math.inf
    return float(np.max(np.abs(expected - actions)))


def _sources(path: Path) -> list[Path]:
    """Return the run folders that a path names, or the path itself.

    The path may be a run, a file in it, or a folder of several runs.
    """
    if (path.parent / "run.json").exists() and path.is_file():
        return [path.parent]
    if (path / "run.json").exists():
        return [path]
    runs_below = sorted(description.parent for description in path.glob("*/run.json"))
    return runs_below or [path]


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m train.export", **described(__doc__))
    parser.add_argument(
        "agents",
        nargs="+",
        type=Path,
        metavar="AGENT",
        help="run folders, or .zip or .onnx files, of your own",
    )
    parser.add_argument(
        "--out", required=True, type=Path, metavar="FOLDER", help="folder to write the files to"
    )
    parser.add_argument(
        "--name",
        help="the agent's name on leaderboards "
        "(default: the algorithm, with the scenario unless that is the id's own)",
    )
    parser.add_argument("--json", action="store_true", help="print one line of JSON per file")
    files = parser.add_argument_group(
        "agents from .zip and .onnx files, which do not state how they were trained"
    )
    files.add_argument(
        "--env",
        type=environment_id,
        choices=ALL_IDS,
        help="environment id (default: RoughTurning-v0)",
    )
    files.add_argument(
        "--scenario",
        help="preset or TOML file of a scenario, or of a family (default: the id's own)",
    )
    files.add_argument(
        "--seed",
        type=int,
        help="training seed (default: the one in a name such as me-seed3.zip, else 0)",
    )
    files.add_argument(
        "--statistics",
        type=Path,
        metavar="FILE",
        help="statistics of the VecNormalize of a .zip's training, written by its save: "
        "a pickle, so only your own",
    )
    files.add_argument(
        "--set",
        action="append",
        metavar="KEY=VALUE",
        help="what the training had: load_target=true, derived=true, belief=true, "
        """training_information='["rewards"]'; repeat the option to set several""",
    )
    return parser


def _agent(path: Path, elsewhere: Run, parsed: argparse.Namespace) -> _Agent:
    """Return the agent of a run's folder or of a file.

    Args:
        path: a run's folder, or a .zip or .onnx file.
        elsewhere: description of the training of a file, which does not state it.
        parsed: the command line's options.

    Raises:
        ValueError: the path holds no agent, or options are given that do not apply to it.
    """
    if path.suffix in (".zip", ONNX_SUFFIX) and path.is_file():
        return _of_file(
            path, elsewhere, name=parsed.name, seed=parsed.seed, statistics=parsed.statistics
        )
    if not path.is_dir():
        raise ValueError(
            f"{path} holds no agent: "
            f"give a folder of training runs, or a .zip or {ONNX_SUFFIX} file"
        )
    agent = _of_run(path, parsed.name)
    for option in ("env", "scenario", "seed", "statistics", "set"):
        if getattr(parsed, option) is not None:
            raise ValueError(
                f"--{option} is for .zip and .onnx files, "
                f"but {path} is a training run, which has its own"
            )
    return agent


@exits(
    ValueError,
    interrupted="interrupted: the files named above are complete; "
    "the same command writes all again",
)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    if arguments is None:
        arguments = sys.argv[1:]
    parser = _parser()
    parsed = parser.parse_args(arguments)
    if parsed.seed is not None and parsed.seed < 0:
        parser.error(f"--seed is {parsed.seed}, but must be 0 or more")

    env_id = parsed.env or "RoughTurning-v0"
    elsewhere = Run.elsewhere(
        "onnx",
        env_id,
        scenario=trained_on(env_id, parsed.scenario),
        steps=0,
        command=f"python -m train.export {shlex.join(arguments)}",
    )
    elsewhere = _stating(elsewhere, settings_of(parsed.set or []))
    agents: dict[Path, _Agent] = {}
    for given in parsed.agents:
        for path in _sources(given):
            agent = _agent(path, elsewhere, parsed)
            target = parsed.out / agent.file_name
            if target in agents:
                raise ValueError(
                    f"{agents[target].source} and {agent.source} would both be {target}: "
                    "export them under other names"
                )
            agents[target] = agent

    for target, agent in tqdm(agents.items(), unit="agent", disable=None, leave=False):
        exported = agent.write(target)
        if parsed.json:
            line = json.dumps(exported)
        else:
            line = (
                f"{exported['path']}: {exported['size']} bytes, "
                f"largest difference {exported['largest_difference']:.1e} "
                f"on {exported['observations']} observations"
            )
        tqdm.write(line)
    return 0


if __name__ == "__main__":
    sys.exit(main())
