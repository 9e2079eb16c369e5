"""Tiny untrained agents and their files.

They are written as text of nodes: PyTorch's exporter takes seconds.
"""

import functools
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper

from leaderboard.agents.agent_file import Metadata
from train.actor import Feedforward
from train.export import metadata
from train.run import Run
from turning_env import FAMILY_ID, Family, Scenario

SCENARIO = Scenario.model_validate({"name": "short", "control": {"time_limit": 0.2}})


class Remembering(torch.nn.Module):
    """A layer from observation and memory to the next memory, and one from that to the action."""

    memory_size = 7

    def __init__(self) -> None:
        super().__init__()
        self.cell = torch.nn.Linear(11 + 7, 7)
        self.head = torch.nn.Linear(7, 2)

    def forward(
        self, observation: torch.Tensor, memory: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        memory = self.cell(torch.cat((observation, memory), dim=1)).tanh()
        return self.head(memory).clamp(-1.0, 1.0), memory


def actor(memory: bool, seed: int = 0) -> Any:
    """Return an actor with or without memory."""
    torch.manual_seed(seed)
    return (
        Remembering()
        if memory
        else Feedforward(torch.nn.Linear(11, 16), torch.nn.ReLU(), torch.nn.Linear(16, 2))
    ).eval()


def run(folder: Path, seed: int = 0, algorithm: str = "ppo") -> Run:
    """Return a run that was never trained."""
    return Run(
        algorithm=algorithm,
        env_id="RoughTurning-v0",
        scenario=SCENARIO,
        seed=seed,
        parameters={"total_timesteps": 1000, "gamma": 0.8},
        command="train it",
        folder=folder,
    )


def of_text(body: str, about: Metadata | None = None, memory: int = 0, **weights: Any) -> bytes:
    """Return a file of nodes from ``observation`` to ``action``.

    With a memory, the nodes also take ``memory`` and give ``next_memory``.
    """
    about = about or metadata(run(Path()), "ppo")
    inputs = [value("observation", len(about.observation_space.low))]
    outputs = [value("action", len(about.action_space.low))]
    if memory:
        inputs.append(value("memory", memory))
        outputs.append(value("next_memory", memory))
    header = "g (float[n, 11] observation) => (float[n, 2] action)"
    nodes = onnx.parser.parse_graph(f"{header} {{ {body} }}").node
    tensors = []
    for name, array in weights.items():
        tensors.append(numpy_helper.from_array(np.asarray(array), name))
    graph = helper.make_graph(
        nodes,
        "network",
        inputs=inputs,
        outputs=outputs,
        initializer=tensors,
    )
    operator_sets = [helper.make_opsetid("", 20)]
    model = helper.make_model(graph, opset_imports=operator_sets, ir_version=10)
    helper.set_model_props(model, about.properties())
    return bytes(model.SerializeToString())


def value(name: str, size: int) -> onnx.ValueInfoProto:
    """Return an input or output for any number of environments."""
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size])


def layer(inner: str, name: str, outer: str) -> str:
    return f"{outer} = Gemm <transB = 1> ({inner}, {name}_weight, {name}_bias) "


@functools.cache
def content(memory: bool = False, seed: int = 0, algorithm: str = "ppo") -> bytes:
    """Return the file of an ``actor``."""
    state = actor(memory, seed).state_dict()
    weights = {name.replace(".", "_"): array.numpy() for name, array in state.items()}
    weights["low"] = np.float32(-1)
    weights["high"] = np.float32(1)
    if memory:
        body = (
            "seen = Concat <axis = 1> (observation, memory) "
            + layer("seen", "cell", "sums")
            + "next_memory = Tanh(sums) "
            + layer("next_memory", "head", "unclipped")
        )
    else:
        body = (
            layer("observation", "layers_0", "sums")
            + "hidden = Relu(sums) "
            + layer("hidden", "layers_2", "unclipped")
        )
    body += " action = Clip(unclipped, low, high)"
    about = metadata(run(Path(), seed, algorithm), algorithm)
    return of_text(
        body,
        about,
        memory=Remembering.memory_size if memory else 0,
        **weights,
    )


def write(folder: Path, seed: int = 0, algorithm: str = "ppo", memory: bool = False) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{algorithm}-seed{seed}.onnx"
    path.write_bytes(content(memory, seed, algorithm))
    return path


def stating(content: bytes, **properties: str) -> bytes:
    """Return a file that states other metadata."""
    model = onnx.load_model_from_string(content)
    stated = {entry.key: entry.value for entry in model.metadata_props}
    helper.set_model_props(model, stated | properties)
    return bytes(model.SerializeToString())


def write_of_family(folder: Path, family: Family, seed: int = 0) -> Path:
    """Write the file of an agent of a family.

    The agent holds its set point, nearly, and changes no edge.
    """
    mean, spread = family.context_scale
    context = {
        "names": list(family.context_names),
        "mean": mean.tolist(),
        "spread": spread.tolist(),
    }
    parameters = {"family": family.portable(), "context": context, "total_timesteps": 1000}
    about = metadata(
        Run("mine", FAMILY_ID, family.job(0).scenario, seed, parameters, "train it", folder)
    )
    weight = (
        np.random.default_rng(seed)
        .uniform(-1e-3, 1e-3, (3, len(about.observation_space.low)))
        .astype(np.float32)
    )
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{about.label}.onnx"
    body = layer("observation", "head", "action")
    path.write_bytes(
        of_text(
            body,
            about,
            head_weight=weight,
            head_bias=np.float32([0.0, 0.0, -0.5]),
        )
    )
    return path


def of_load(body: str, **weights: Any) -> bytes:
    """Return a file whose actions are a tenth of ``change``.

    The nodes of ``body`` make ``change`` of ``first``, the first two observations.
    """
    given = {
        "start": [0],
        "stop": [2],
        "axis": [1],
        "small": np.float32([0.1]),
    }
    return of_text(
        f"first = Slice(observation, start, stop, axis) {body} action = Mul(change, small)",
        **given | weights,
    )


AXES = np.array([1])
ONES = np.ones(1, np.float32)
WIDE = np.ones((1, 1_000_000), np.float32)
LOADS: dict[str, tuple[str, dict[str, Any]]] = {
    "plain": ("change = Identity(first)", {}),
    # Acts beyond 1 if observations are.
    "unbounded": ("change = Mul(first, big)", {"big": 9.9 * ONES}),
    # Acts by the other environments.
    "sociable": (
        "mean = ReduceMean(first, axes) change = Sub(first, mean)",
        {"axes": np.array([0])},
    ),
    # Acts by an environment's index.
    "counting": (
        "nothing = Mul(first, zero) ones = Add(nothing, one) "
        "place = CumSum(ones, across) change = Softsign(place)",
        {"across": np.array(0), "zero": 0.0 * ONES, "one": ONES},
    ),
    # Acts once for all environments.
    "few": ("change = ReduceMax(first, axes)", {"axes": np.array([0])}),
    # Asks for four megabytes per environment, several times at once.
    "swelling": (
        "sum = ReduceSum(first, axes) swollen0 = Add(sum, wide0) swollen1 = Add(sum, wide1) "
        "none = Sub(swollen0, swollen1) "
        "column = ReduceMax(none, axes) change = Add(first, column)",
        {"axes": AXES, "wide0": WIDE, "wide1": 2.0 * WIDE},
    ),
}
"""Nodes and weights of files by name."""


def named(name: str) -> bytes:
    """Return one of ``LOADS``, or ``toiling``."""
    if name == "toiling":
        return toiling()
    body, weights = LOADS[name]
    return of_load(body, **weights)


def toiling(products: int = 60, size: int = 900) -> bytes:
    """Return a file that multiplies matrices for seconds before it acts."""
    nodes = [
        "sum = ReduceSum(first, axes)",
        "nothing = Mul(sum, zero)",
        "lone = Unsqueeze(nothing, last)",
        "product0 = Add(lone, matrix)",
    ]
    nodes += [f"product{k + 1} = MatMul(product{k}, product{k})" for k in range(products)]
    nodes += [
        f"most = ReduceMax <keepdims = 0> (product{products}, inner)",
        "column = Unsqueeze(most, axes)",
        "change = Add(first, column)",
    ]
    return of_load(
        " ".join(nodes),
        axes=AXES,
        last=np.array([2]),
        inner=np.array([1, 2]),
        zero=0.0 * ONES,
        matrix=np.zeros((size, size), np.float32),
    )
