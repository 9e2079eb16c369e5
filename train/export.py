"""Export trained agents as ONNX files, which play without PyTorch: see ``train/agents/agent_file.py``.

    python -m train.export runs/RoughTurning-v0/rough_turning/ppo-seed0 --out my-agents
    python -m train.export my_model.zip --env RoughTurning-v0 --name mine --out my-agents
    python -m train.export my_model.zip --statistics vec_normalize.pkl --out my-agents
    python -m train.export my_network.onnx --scenario my_mill.toml --seed 1 --out my-agents

An agent is the folder of a training run, or any file in it; a model that Stable-Baselines3 has saved; or a network in ONNX.
A file is written only if it acts as the agent does, on observations sampled from the observation space and on those of episodes.
"""

import argparse
import json
import math
import os
import re
import shlex
import sys
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from tqdm import tqdm

from baselines.belief import VectorBeliefObservation
from train.actor import Actor, ActorPolicy
from train.agents import agent_file
from train.agents.agent_file import FORMAT, NAME, ONNX_SUFFIX, Metadata, Space
from train.agents.network import tried
from train.agents.to_onnx import ModuleActor, adopted, sb3_actor, to_onnx
from train.run import HYPERPARAMETERS, Run, family_of, trained_on
from train.training import load_actor, stating_information
from turning_env import FAMILY_ID, IDS, Scenario
from turning_env.console import described, exits
from turning_env.family_env import vector_env
from turning_env.files import replace_file
from turning_env.scoring.onnx_session import OnnxPolicy
from turning_env.scoring.policy import Policy
from turning_env.scoring.seeds import tuning_seeds

NUM_ENVS, STEPS = (
    50,
    100,
)  # numbers of environments and steps in each of the two comparisons of agent and file
MAX_DIFFERENCE = 2e-5  # largest difference between an agent's action and its file's in episodes: rounding in single precision
MAX_SAMPLED_DIFFERENCE = 1e-3
"""Likewise on observations sampled from the observation space: no lathe has such, and a search on them may stop elsewhere."""
_VERSIONS = ("rough-turning", "torch", "onnx", "onnxscript")


@dataclass(frozen=True)
class _Agent:
    """An agent to export."""

    source: str
    about: Metadata
    actor: Actor | None  # the actor; None: the source is itself a network in ONNX

    def write(self, path: Path) -> dict[str, Any]:
        """Write the agent's file; see ``export``."""
        torch.set_num_threads(1)
        try:
            with torch.no_grad():
                content = (
                    adopted(Path(self.source), self.about)
                    if self.actor is None
                    else to_onnx(self.actor, self.about)
                )
            file = agent_file.checked(content)
            entries, actions = (
                len(space.low)
                for space in (file.metadata.observation_space, file.metadata.action_space)
            )
            session = tried(content, entries, actions, file.memory_size)
            policy = OnnxPolicy(session, file.memory_size, NUM_ENVS)
            sampled, difference = 0.0, 0.0
            if self.actor:
                env = _environments(file.metadata)
                sampled, difference = largest_differences(
                    ActorPolicy(self.actor, NUM_ENVS), policy, file.metadata, env
                )
            if not (difference <= MAX_DIFFERENCE and sampled <= MAX_SAMPLED_DIFFERENCE):
                raise ValueError(f"its file acts otherwise, by up to {max(sampled, difference):g}")
        except ValueError as error:
            raise ValueError(f"{self.source} cannot be exported: {error}") from error
        replace_file(path, lambda partial: partial.write_bytes(content))
        return {
            "path": str(path),
            "digest": file.digest,
            "size": len(content),
            "observations": 2 * NUM_ENVS * STEPS,
            "largest_difference": max(sampled, difference),
        }


def export(folder: Path, out: Path, name: str | None = None) -> dict[str, Any]:
    """Write the finished agent of one of your own runs to the folder ``out``; the file's name states agent and training seed.

    Return ``path``, ``digest`` (SHA-256) and ``size`` [bytes] of the file, the ``largest_difference`` of its actions from the
    agent's, and the number of compared ``observations``. ValueError says why there is no file, OSError that none can be written.
    """
    agent = _of_run(folder, name)
    return agent.write(out / f"{agent.about.label}{ONNX_SUFFIX}")


def export_torch(
    module: torch.nn.Module,
    path: str | os.PathLike[str],
    env_id: str = "RoughTurning-v0",
    *,
    scenario: Scenario | str | os.PathLike[str] | None = None,
    name: str | None = None,
    seed: int | None = None,
    trained_steps: int = 0,
) -> dict[str, Any]:
    """Write an agent's file for a PyTorch module from observations (n, entries) to actions (n, actions) in -1..1.

    Actions beyond -1..1 are clipped. A module with an attribute ``memory_size`` is recurrent: it takes observations and a memory
    (n, memory_size), which is 0 before an episode's first observation, and returns actions and the next memory.

    Args:
        module: the trained module.
        path: path of the file.
        env_id: the environment on which it was trained.
        scenario: the scenario on which it was trained; None: the id's own.
        name: the agent's name on leaderboards; None: the file's name.
        seed: training seed; agents of one name with several seeds are one policy. None: the seed in a file name such as
            ``me-seed3.onnx``, else 0.
        trained_steps: environment steps of the training.

    Returns:
        The same as ``export``; raises the same errors.
    """
    actor = module if isinstance(module, Actor) else ModuleActor(module)
    source = (
        scenario
        if isinstance(scenario, Scenario)
        else trained_on(env_id, None if scenario is None else os.fspath(scenario))
    )
    run = Run.elsewhere("torch", env_id, source, trained_steps, "train.export.export_torch")
    return _Agent(type(module).__name__, _foreign(run, Path(path), name, seed), actor).write(
        Path(path)
    )


def _of_run(folder: Path, name: str | None) -> _Agent:
    run = Run.read(folder)
    actor = load_actor(run)
    return _Agent(f"the agent in {folder}", metadata(stating_information(run), name), actor)


def _of_file(
    path: Path, run: Run, name: str | None, seed: int | None, statistics: Path | None
) -> _Agent:
    """Return the agent of a model of Stable-Baselines3 or a network in ONNX, trained on the environment of a run."""
    if path.suffix == ONNX_SUFFIX:
        if statistics is not None:
            raise ValueError(
                f"--statistics is for .zip files of Stable-Baselines3, but {path} is a network in ONNX"
            )
        return _Agent(str(path), _foreign(run, path, name, seed), None)
    try:
        trained, actor = sb3_actor(path, run, statistics)
    except ValueError as error:
        raise ValueError(f"{path} {error}") from error
    return _Agent(str(path), _foreign(trained, path, name, seed), actor)


def _foreign(run: Run, path: Path, name: str | None, seed: int | None) -> Metadata:
    """Return the metadata of an agent that was trained elsewhere; without a name, it gets its file's name."""
    plain = unicodedata.normalize("NFKD", path.stem).encode("ascii", "ignore").decode()
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", plain).lstrip(".-")
    stem, _, number = (
        plain.rpartition("-seed") if re.search(r"-seed\d{1,9}$", plain) else (plain, "", "0")
    )
    taken = (HYPERPARAMETERS / f"{stem}.toml").exists()  # by an agent that ships
    run = replace(run, seed=int(number) if seed is None else seed)
    return metadata(run, name or (f"my_{stem}" if taken else stem or "agent"))


def metadata(run: Run, name: str | None = None) -> Metadata:
    """Return the metadata of the file of a run's agent. Raise ValueError if the name is not allowed."""
    name = name or run.name
    if not re.fullmatch(NAME, name):
        raise ValueError(
            f"the name is {name!r}, but must be at most 128 letters, digits, _, . or -, the first no . or -"
        )
    return Metadata(
        format=FORMAT,
        algorithm=run.algorithm,
        name=name,
        seed=run.seed,
        env_id=run.env_id,
        scenario=run.scenario,
        observation_space=Space.of(agent_file.seen_space(run.env_id, run.scenario, run.parameters)),
        action_space=Space.of(agent_file.acting_space(run.scenario, run.parameters)),
        parameters=run.parameters,
        trained_steps=run.parameters["total_timesteps"],
        command=re.sub(
            r" --runs[ =]('[^']*'|\S+)", "", run.command
        ),  # without a folder of this machine
        versions={name: version(name) for name in _VERSIONS},
    )


def _environments(about: Metadata) -> Any:
    """Return ``NUM_ENVS`` environments like those of an agent's training; a guide's are compared on features alone."""
    if about.parameters.get("guide") is True:
        return None
    env = vector_env(
        family_of(about.env_id, about.parameters) or about.scenario,
        NUM_ENVS,
        AutoresetMode.SAME_STEP,
    )
    return VectorBeliefObservation(env) if about.parameters.get("belief") is True else env


def largest_differences(
    original: Policy, policy: Policy, about: Metadata, env: Any
) -> tuple[float, float]:
    """Return the largest differences between the actions of two policies of ``NUM_ENVS`` environments.

    Both see the same observations and keep their own memories. The first difference is on observations sampled from the
    observation space, the second in episodes on tuning seeds in which the original acts, if there are environments.
    """
    rng = np.random.default_rng(0)
    space, observations = about.observation_space, np.zeros(0, np.float32)
    if env is not None:
        observations, _ = env.reset(seed=tuning_seeds(NUM_ENVS))
    largest = [0.0, 0.0]
    for played in (False, True) if env is not None else (False,):
        begins = np.ones(NUM_ENVS, np.bool_)
        for _ in range(STEPS):
            seen = (
                observations
                if played
                else rng.uniform(space.low, space.high, (NUM_ENVS, len(space.low))).astype(
                    np.float32
                )
            )
            original.reset(begins)
            policy.reset(begins)
            mine, its = original.act(seen), policy.act(seen)
            if not np.isfinite(its).all():
                return math.inf, math.inf
            largest[played] = max(largest[played], float(np.max(np.abs(mine - its))))
            begins = np.zeros(NUM_ENVS, np.bool_)
            if played:
                observations, _, terminated, truncated, _ = env.step(mine)
                begins = terminated | truncated
    return largest[0], largest[1]


def _sources(path: Path) -> list[Path]:
    """Return the run folders that a path names (a run, a file in it, or a folder of several runs), or the path itself."""
    if (path.parent / "run.json").exists() and path.is_file():
        return [path.parent]
    below = sorted(found.parent for found in path.glob("*/run.json"))
    return [path] if (path / "run.json").exists() or not below else below


@exits(
    ValueError,
    interrupted="interrupted: the files named above are complete; the same command writes all again",
)
def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    parser = argparse.ArgumentParser(prog="python -m train.export", **described(__doc__))
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
    name_help = "the agent's name on leaderboards (default: the algorithm, with the scenario unless that is the id's own)"
    parser.add_argument("--name", help=name_help)
    parser.add_argument("--json", action="store_true", help="print one line of JSON per file")
    files = parser.add_argument_group(
        "agents from .zip and .onnx files, which do not state how they were trained"
    )
    files.add_argument(
        "--env", choices=[*IDS, FAMILY_ID], help="environment id (default: RoughTurning-v0)"
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
    statistics_help = "statistics of the VecNormalize of a .zip's training, written by its save: a pickle, so only your own"
    files.add_argument("--statistics", type=Path, metavar="FILE", help=statistics_help)
    parsed = parser.parse_args(arguments)
    if parsed.seed is not None and parsed.seed < 0:
        parser.error(f"--seed is {parsed.seed}, but must be 0 or more")
    env_id = parsed.env or "RoughTurning-v0"
    command = f"python -m train.export {shlex.join(arguments)}"
    elsewhere = Run.elsewhere("onnx", env_id, trained_on(env_id, parsed.scenario), 0, command)
    agents: dict[Path, _Agent] = {}
    for path in (source for given in parsed.agents for source in _sources(given)):
        if path.suffix in (".zip", ONNX_SUFFIX) and path.is_file():
            agent = _of_file(path, elsewhere, parsed.name, parsed.seed, parsed.statistics)
        elif not path.is_dir():
            raise ValueError(
                f"{path} holds no agent: give a folder of training runs, or a .zip or {ONNX_SUFFIX} file"
            )
        else:
            agent = _of_run(path, parsed.name)
            if given := [
                name
                for name in ("env", "scenario", "seed", "statistics")
                if getattr(parsed, name) is not None
            ]:
                raise ValueError(
                    f"--{given[0]} is for .zip and .onnx files, but {path} is a training run, which has its own"
                )
        target = parsed.out / f"{agent.about.label}{ONNX_SUFFIX}"
        if target in agents:
            raise ValueError(
                f"{agents[target].source} and {agent.source} would both be {target}: export them under other names"
            )
        agents[target] = agent
    for target, agent in tqdm(agents.items(), unit="agent", disable=None, leave=False):
        exported = agent.write(target)
        line = f"largest difference {exported['largest_difference']:.1e} on {exported['observations']} observations"
        tqdm.write(
            json.dumps(exported)
            if parsed.json
            else f"{exported['path']}: {exported['size']} bytes, {line}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
