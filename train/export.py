"""Writes finished agents as ONNX files, which play without PyTorch: see ``agent_file.py``.

    python -m train.export runs/RoughTurning-v0/rough_turning/ppo-seed0 --out agents/RoughTurning-v0/rough_turning

A file is only written if it acts as the agent does, on observations drawn from the whole observation space and on those of play.

``python -m train.export --nc --help`` tells how to write what agents and rules command as programs for a lathe's control.
"""

import argparse
import json
import logging
import math
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import onnx
import torch
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
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
from turning_env.score.policy import Actions, Observations, Policy
from turning_env.score.seeds import tuning_seeds

OPSET = 20
LANES, STEPS = 50, 100
"""Of each of the two kinds of observations that are compared."""
MAX_DIFFERENCE = 1e-5
"""Between an agent's action and its file's."""
TIMED_CALLS = 2_000
_VERSIONS = ("rough-turning", "torch", "onnx", "onnxscript")


@dataclass(frozen=True)
class Exported:
    """A file that has been written."""

    path: str
    digest: str
    """SHA-256 of the file."""
    size: int  # [bytes]
    observations: int
    """On how many it has been compared with the agent."""
    largest_difference: float
    """Between an action of the agent and of the file, where both are in -1..1."""
    latency: float
    """Median time of a call with one observation [s]."""


def export(folder: Path, out: Path) -> Exported:
    """Write the finished agent of one of your own runs into the folder ``out``, named by algorithm and training seed.

    Raises:
        ValueError: there is no finished training, its network cannot be written as ONNX, or the file does not act as it does.
        OSError: the file cannot be written.
    """
    torch.set_num_threads(1)
    run = Run.read(folder)
    actor = load_actor(run)
    with torch.no_grad():
        content = to_onnx(actor, metadata(run))
    try:
        file = agent_file.checked(content)
        spaces = file.metadata.observation_space, file.metadata.action_space
        entries, actions = (len(space.low) for space in spaces)
        session = tried(content, entries, actions, file.memory_size)
    except ValueError as error:
        raise ValueError(f"the agent in {folder} cannot be exported: {error}") from error

    def from_file(num_envs: int) -> OnnxPolicy:
        return OnnxPolicy(session, file.memory_size, num_envs)

    difference = largest_difference(actor, from_file(LANES), run.scenario)
    if not difference <= MAX_DIFFERENCE:
        raise ValueError(f"the agent in {folder} cannot be exported: its file acts otherwise, by up to {difference:g}")
    path = out / f"{file.label}{ONNX_SUFFIX}"
    replace_file(path, lambda partial: partial.write_bytes(content))
    seconds = latency(from_file(1), len(file.metadata.observation_space.low))
    return Exported(str(path), file.digest, len(content), 2 * LANES * STEPS, difference, seconds)


def metadata(run: Run) -> Metadata:
    """What the file of a run's agent says of it."""
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
    """An actor whose action is a function of the observation, as a network of one input and one output."""

    def __init__(self, actor: Actor) -> None:
        super().__init__()
        self._actor = actor

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Actions."""
        action, _ = self._actor(observation, observation.new_zeros((observation.shape[0], 0)))
        result: torch.Tensor = action
        return result


def to_onnx(actor: Actor, about: Metadata) -> bytes:
    """An actor as an ONNX file's content: the same bytes every time.

    Raises:
        ValueError: PyTorch cannot write this actor as ONNX.
    """
    # Two lanes: what is one when a network is traced is taken to be one always.
    arguments: tuple[torch.Tensor, ...] = (torch.zeros(2, len(about.observation_space.low)),)
    network: torch.nn.Module = _WithoutMemory(actor)
    inputs, outputs = ["observation"], ["action"]
    if actor.memory_size:
        arguments += (torch.zeros(2, actor.memory_size),)
        network, inputs, outputs = actor, [*inputs, "memory"], [*outputs, "next_memory"]
    lanes = torch.export.Dim("lanes", min=1)
    try:
        with _quietly():
            program = torch.onnx.export(
                network.eval(),
                arguments,
                dynamo=True,
                input_names=inputs,
                output_names=outputs,
                dynamic_shapes=tuple({0: lanes} for _ in arguments),
                opset_version=OPSET,
                verbose=False,
            )
    except Exception as error:  # the exporter's are of many types
        raise ValueError(f"PyTorch cannot write {type(actor).__name__} as ONNX: {str(error).strip().splitlines()[0]}") from error
    assert program is not None
    model = program.model_proto
    _strip(model)
    onnx.helper.set_model_props(model, about.properties())
    return bytes(model.SerializeToString(deterministic=True))


@contextmanager
def _quietly() -> Iterator[None]:
    """Without what the exporter says of itself: that it calls deprecated functions, and what is not installed."""
    disabled = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(disabled)


def _strip(model: onnx.ModelProto) -> None:
    """Take away what tells of the exporter's machine: stack traces and the names of its files."""
    graph = model.graph
    for part in (model, graph, *graph.node, *graph.initializer, *graph.value_info, *graph.input, *graph.output):
        part.ClearField("doc_string")
        part.ClearField("metadata_props")


def largest_difference(actor: Actor, policy: Policy, scenario: Scenario) -> float:
    """By how much the actions of an actor and of a policy of ``LANES`` lanes differ at most, on the same observations.

    Half of these are drawn from the observation space, and half come of the actor's own play on tuning draws. Each of the two
    remembers for itself.
    """
    original = ActorPolicy(actor, LANES)
    largest = 0.0
    for world in (_Drawn(scenario), _Played(scenario)):
        observations, started = world.observations, np.ones(LANES, np.bool_)
        for _ in range(STEPS):
            original.reset(started)
            policy.reset(started)
            mine, its = original.act(observations), policy.act(observations)
            if not np.isfinite(its).all():
                return math.inf
            largest = max(largest, float(np.max(np.abs(mine - its))))
            observations, started = world.after(mine)
    return largest


class _Drawn:
    """Observations drawn evenly from the observation space, in episodes without an end."""

    def __init__(self, scenario: Scenario) -> None:
        box = observation_space(scenario)
        assert isinstance(box, Box)
        self._box, self._generator = box, np.random.default_rng(0)
        self.observations = self._draw()

    def _draw(self) -> Observations:
        box = self._box
        return self._generator.uniform(box.low, box.high, (LANES, *box.shape)).astype(np.float32)

    def after(self, actions: Actions) -> tuple[Observations, NDArray[np.bool_]]:
        """The next observations, and of which lanes they are the first."""
        return self._draw(), np.zeros(LANES, np.bool_)


class _Played:
    """Observations of episodes that are played."""

    def __init__(self, scenario: Scenario) -> None:
        self._env = RoughTurningVectorEnv(LANES, scenario, AutoresetMode.SAME_STEP)
        self.observations, _ = self._env.reset(seed=tuning_seeds(LANES))

    def after(self, actions: Actions) -> tuple[Observations, NDArray[np.bool_]]:
        """The next observations, and of which lanes they are the first."""
        observations, _, terminated, truncated, _ = self._env.step(actions)
        return observations, terminated | truncated


def latency(policy: Policy, entries: int) -> float:
    """Median time [s] of a call of a policy of one lane with an observation of so many entries."""
    observation = np.zeros((1, entries), np.float32)
    times = []
    for _ in range(TIMED_CALLS):
        start = time.perf_counter()
        policy.act(observation)
        times.append(time.perf_counter() - start)
    return float(np.median(times))


@exits(ValueError, interrupted="interrupted: the files named above are whole, and the same command writes all again")
def main(arguments: Sequence[str] | None = None) -> int:
    """Command line; returns the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if list(arguments[:1]) == ["--nc"]:
        from train.nc.command import main as nc

        return nc(arguments[1:])
    parser = argparse.ArgumentParser(
        prog="python -m train.export",
        **described(__doc__),
    )
    parser.add_argument("folders", nargs="+", type=Path, metavar="RUN_FOLDER", help="finished trainings of your own")
    parser.add_argument("--out", required=True, type=Path, metavar="FOLDER", help="where the files are written")
    parser.add_argument("--json", action="store_true", help="print one line of JSON per file")
    parsed = parser.parse_args(arguments)
    for folder in tqdm(parsed.folders, unit="agent", disable=None, leave=False):
        exported = export(folder, parsed.out)
        tqdm.write(json.dumps(asdict(exported)) if parsed.json else _line(exported))
    return 0


def _line(exported: Exported) -> str:
    return (
        f"{exported.path}: {exported.size} bytes, {1e6 * exported.latency:.0f} us per call, "
        f"largest difference {exported.largest_difference:.1e} on {exported.observations} observations"
    )


if __name__ == "__main__":
    sys.exit(main())
