"""Export finished agents as ONNX files, which play without PyTorch: see ``train/agents/agent_file.py``.

    python -m train.export runs/RoughTurning-v0/rough_turning/ppo-seed0 --out agents/RoughTurning-v0/rough_turning

A file is only written if it acts as the agent does, on observations sampled from the observation space and on those of episodes.

Run ``python -m train.export --nc --help`` to export what agents and controllers command as part programs for a lathe's control.
"""

import argparse
import json
import logging
import math
import sys
import timeit
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import onnx
import torch
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from tqdm import tqdm

from train.actor import Actor, ActorPolicy
from train.agents import agent_file
from train.agents.agent_file import FORMAT, ONNX_SUFFIX, Metadata, Space
from train.agents.run_folder import load_actor
from train.agents.session import OnnxPolicy, tried
from train.run import Run
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.batch.driver import action_space, observation_space
from turning_env.console import described, exits
from turning_env.files import replace_file
from turning_env.score.policy import Policy
from turning_env.score.seeds import tuning_seeds

OPSET = 20
NUM_ENVS, STEPS = 50, 100
"""Environments and steps of each of the two comparisons of agent and file."""
MAX_DIFFERENCE = 1e-5
"""Largest difference between an agent's action and its file's."""
TIMED_CALLS = 2_000
_VERSIONS = ("rough-turning", "torch", "onnx", "onnxscript")


def export(folder: Path, out: Path) -> dict[str, Any]:
    """Write the finished agent of one of your own runs into the folder ``out``, named by algorithm and training seed.

    Returns:
        ``path``, ``digest`` (SHA-256) and ``size`` [bytes] of the file; the ``largest_difference`` between actions of the
        agent and of the file on so many ``observations``; ``latency``, the median time of a call with one observation [s].

    Raises:
        ValueError: training is not finished, the network cannot be written as ONNX, or the file does not act as the agent.
        OSError: the file cannot be written.
    """
    torch.set_num_threads(1)
    run = Run.read(folder)
    actor = load_actor(run)
    with torch.no_grad():
        content = to_onnx(actor, metadata(run))
    try:
        file = agent_file.checked(content)
        entries, actions = (len(space.low) for space in (file.metadata.observation_space, file.metadata.action_space))
        session = tried(content, entries, actions, file.memory_size)
    except ValueError as error:
        raise ValueError(f"the agent in {folder} cannot be exported: {error}") from error
    difference = largest_difference(actor, OnnxPolicy(session, file.memory_size, NUM_ENVS), run.scenario)
    if not difference <= MAX_DIFFERENCE:
        raise ValueError(f"the agent in {folder} cannot be exported: its file acts otherwise, by up to {difference:g}")
    path = out / f"{file.label}{ONNX_SUFFIX}"
    replace_file(path, lambda partial: partial.write_bytes(content))
    policy, observation = OnnxPolicy(session, file.memory_size, 1), np.zeros((1, entries), np.float32)
    return {
        "path": str(path),
        "digest": file.digest,
        "size": len(content),
        "observations": 2 * NUM_ENVS * STEPS,
        "largest_difference": difference,
        "latency": median(timeit.repeat(lambda: policy.act(observation), number=1, repeat=TIMED_CALLS)),
    }


def metadata(run: Run) -> Metadata:
    """Return the metadata of the file of a run's agent."""
    return Metadata(
        format=FORMAT,
        algorithm=run.algorithm,
        seed=run.seed,
        env_id=run.env_id,
        scenario=run.scenario,
        observation_space=Space.of(observation_space(run.scenario)),
        action_space=Space.of(action_space(run.scenario)),
        parameters=run.parameters,
        trained_steps=run.parameters["steps"],
        command=run.command,
        versions={name: version(name) for name in _VERSIONS},
    )


class _WithoutMemory(torch.nn.Module):
    """An actor without memory as a network of one input and one output."""

    def __init__(self, actor: Actor) -> None:
        super().__init__()
        self._actor = actor

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return actions."""
        action, _ = self._actor(observation, observation.new_zeros((observation.shape[0], 0)))
        result: torch.Tensor = action
        return result


def to_onnx(actor: Actor, about: Metadata) -> bytes:
    """Return the content of an actor's ONNX file: the same bytes every time.

    Raises:
        ValueError: PyTorch cannot write this actor as ONNX.
    """
    # Two environments: a size of one would be taken for a constant.
    arguments: tuple[torch.Tensor, ...] = (torch.zeros(2, len(about.observation_space.low)),)
    network: torch.nn.Module = _WithoutMemory(actor)
    inputs, outputs = ["observation"], ["action"]
    if actor.memory_size:
        arguments += (torch.zeros(2, actor.memory_size),)
        network, inputs, outputs = actor, [*inputs, "memory"], [*outputs, "next_memory"]
    num_envs = torch.export.Dim("lanes", min=1)  # the name of the axis in the file
    try:
        with _quietly():
            program = torch.onnx.export(
                network.eval(),
                arguments,
                dynamo=True,
                input_names=inputs,
                output_names=outputs,
                dynamic_shapes=tuple({0: num_envs} for _ in arguments),
                opset_version=OPSET,
                verbose=False,
            )
    except Exception as error:  # the exporter raises many types
        raise ValueError(f"PyTorch cannot write {type(actor).__name__} as ONNX: {str(error).strip().splitlines()[0]}") from error
    assert program is not None
    model = program.model_proto
    _strip(model)
    onnx.helper.set_model_props(model, about.properties())
    return bytes(model.SerializeToString(deterministic=True))


@contextmanager
def _quietly() -> Iterator[None]:
    """Silence the exporter's warnings about its own deprecated calls and missing optional packages."""
    disabled = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(disabled)


def _strip(model: onnx.ModelProto) -> None:
    """Remove stack traces and file names of the exporting machine."""
    graph = model.graph
    for part in (model, graph, *graph.node, *graph.initializer, *graph.value_info, *graph.input, *graph.output):
        part.ClearField("doc_string")
        part.ClearField("metadata_props")


def largest_difference(actor: Actor, policy: Policy, scenario: Scenario) -> float:
    """Return the largest difference between the actions of an actor and of a policy of ``NUM_ENVS`` environments.

    Both see the same observations and keep their own memories. Half of the observations are sampled from the observation space,
    half come from episodes on tuning seeds in which the actor acts.
    """
    original, generator = ActorPolicy(actor, NUM_ENVS), np.random.default_rng(0)
    env, box = RoughTurningVectorEnv(NUM_ENVS, scenario, AutoresetMode.SAME_STEP), observation_space(scenario)
    assert isinstance(box, Box)
    observations, _ = env.reset(seed=tuning_seeds(NUM_ENVS))
    largest = 0.0
    for played in (False, True):
        begins = np.ones(NUM_ENVS, np.bool_)
        for _ in range(STEPS):
            seen = observations if played else generator.uniform(box.low, box.high, (NUM_ENVS, *box.shape)).astype(np.float32)
            original.reset(begins)
            policy.reset(begins)
            mine, its = original.act(seen), policy.act(seen)
            if not np.isfinite(its).all():
                return math.inf
            largest = max(largest, float(np.max(np.abs(mine - its))))
            begins = np.zeros(NUM_ENVS, np.bool_)
            if played:
                observations, _, terminated, truncated, _ = env.step(mine)
                begins = terminated | truncated
    return largest


@exits(ValueError, interrupted="interrupted: the files named above are complete; the same command writes all again")
def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if list(arguments[:1]) == ["--nc"]:
        from train.nc.command import main as nc

        return nc(arguments[1:])
    parser = argparse.ArgumentParser(prog="python -m train.export", **described(__doc__))
    parser.add_argument("folders", nargs="+", type=Path, metavar="RUN_FOLDER", help="folders of finished trainings of your own")
    parser.add_argument("--out", required=True, type=Path, metavar="FOLDER", help="folder of the files")
    parser.add_argument("--json", action="store_true", help="print one line of JSON per file")
    parsed = parser.parse_args(arguments)
    for folder in tqdm(parsed.folders, unit="agent", disable=None, leave=False):
        exported = export(folder, parsed.out)
        us, difference = 1e6 * exported["latency"], exported["largest_difference"]
        line = f"{us:.0f} us per call, largest difference {difference:.1e} on {exported['observations']} observations"
        tqdm.write(json.dumps(exported) if parsed.json else f"{exported['path']}: {exported['size']} bytes, {line}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
