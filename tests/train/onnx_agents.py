"""Tiny untrained agents and their files, written node by node: PyTorch's exporter takes seconds."""

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from onnx.helper import make_node

from train.actor import Actor, Feedforward
from train.agents.agent_file import Metadata
from train.export import metadata
from train.run import Run
from turning_env import FAMILY_ID, Family, Scenario

SCENARIO = Scenario.model_validate({"name": "short", "control": {"time_limit": 0.2}})
Weights = Mapping[str, NDArray[np.generic]]


class Remembering(Actor):
    """A layer from observation and memory to the next memory, and one from that to the action."""

    def __init__(self) -> None:
        super().__init__()
        self.memory_size = 7
        self.cell, self.head = torch.nn.Linear(11 + 7, 7), torch.nn.Linear(7, 2)

    def forward(self, observation: torch.Tensor, memory: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        memory = self.cell(torch.cat((observation, memory), dim=1)).tanh()
        return self.head(memory).clamp(-1.0, 1.0), memory


def memoryless(seed: int = 0) -> Feedforward:
    torch.manual_seed(seed)
    return Feedforward(torch.nn.Linear(11, 16), torch.nn.ReLU(), torch.nn.Linear(16, 2)).eval()


def remembering(seed: int = 0) -> Remembering:
    torch.manual_seed(seed)
    return Remembering().eval()


def run(folder: Path, seed: int = 0, algorithm: str = "ppo") -> Run:
    """A run that was never trained."""
    return Run(algorithm, "RoughTurning-v0", SCENARIO, seed, {"steps": 1000, "discount": 0.8}, "train it", folder)


@functools.cache
def content(memory: bool = False, seed: int = 0, algorithm: str = "ppo") -> bytes:
    actor = remembering(seed) if memory else memoryless(seed)
    weights = {name: array.numpy() for name, array in actor.state_dict().items()}
    first, last = ("cell", "head") if memory else ("layers.0", "layers.2")
    state = "next_memory" if memory else "hidden"
    nodes = [make_node("Concat", ["observation", "memory"], ["seen"], axis=1)] if memory else []
    nodes += [
        make_node("Gemm", ["seen" if memory else "observation", f"{first}.weight", f"{first}.bias"], ["sums"], transB=1),
        make_node("Tanh" if memory else "Relu", ["sums"], [state]),
        make_node("Gemm", [state, f"{last}.weight", f"{last}.bias"], ["unclipped"], transB=1),
        make_node("Clip", ["unclipped", "low", "high"], ["action"]),
    ]
    bounds = {"low": np.array(-1, np.float32), "high": np.array(1, np.float32)}
    return of_nodes(nodes, weights | bounds, 7 if memory else 0, seed, algorithm)


def write(folder: Path, seed: int = 0, algorithm: str = "ppo", memory: bool = False) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{algorithm}-seed{seed}.onnx"
    path.write_bytes(content(memory, seed, algorithm))
    return path


def write_of_family(folder: Path, family: Family, seed: int = 0) -> Path:
    """The file of an agent of a family that holds its set point, nearly, and changes no edge."""
    context = {"names": list(family.context_names)}
    context |= {name: values.tolist() for name, values in zip(("mean", "spread"), family.context_scale, strict=True)}
    parameters = {"family": family.portable(), "context": context, "steps": 1000}
    about = metadata(Run("mine", FAMILY_ID, family.job(0).scenario, seed, parameters, "train it", folder))
    entries = len(about.observation_space.low)
    weights = {
        "head.weight": np.random.default_rng(seed).uniform(-1e-3, 1e-3, (3, entries)).astype(np.float32),
        "head.bias": np.array([0.0, 0.0, -0.5], np.float32),
    }
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{about.label}.onnx"
    nodes = [make_node("Gemm", ["observation", "head.weight", "head.bias"], ["action"], transB=1)]
    path.write_bytes(of_nodes(nodes, weights, about=about))
    return path


def of_nodes(
    nodes: Sequence[onnx.NodeProto],
    weights: Weights,
    memory: int = 0,
    seed: int = 0,
    algorithm: str = "ppo",
    actions: int = 2,
    about: Metadata | None = None,
) -> bytes:
    """A file of nodes from ``observation`` (and ``memory``) to ``action`` (and ``next_memory``)."""
    if about is None:
        about = metadata(run(Path(), seed, algorithm), algorithm)
    else:
        actions = len(about.action_space.low)

    def value(name: str, entries: int) -> onnx.ValueInfoProto:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["environments", entries])

    inputs, outputs = [value("observation", len(about.observation_space.low))], [value("action", actions)]
    if memory:
        inputs, outputs = [*inputs, value("memory", memory)], [*outputs, value("next_memory", memory)]
    held = [numpy_helper.from_array(array, name) for name, array in weights.items()]
    graph = helper.make_graph(nodes, "network", inputs, outputs, held)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    helper.set_model_props(model, about.properties())
    return bytes(model.SerializeToString())


def of_load(body: str, **weights: NDArray[np.generic]) -> bytes:
    """A file that acts by ``first``, the first two observations, after nodes that turn it into ``change``."""
    first = "first = Slice(observation, start, stop, axis)"
    parsed = onnx.parser.parse_graph(
        f"g (float[n, 11] observation) => (float[n, 2] action) {{ {first} {body} action = Mul(change, small) }}"
    )
    given = {"start": np.array([0]), "stop": np.array([2]), "axis": np.array([1]), "small": np.array([0.1], np.float32)}
    return of_nodes(list(parsed.node), given | weights)


AXES, ONES, WIDE = np.array([1]), np.ones(1, np.float32), np.ones((1, 1_000_000), np.float32)
LOADS: dict[str, tuple[str, dict[str, NDArray[np.generic]]]] = {
    "plain": ("change = Identity(first)", {}),
    "unbounded": ("change = Mul(first, big)", {"big": 9.9 * ONES}),  # beyond 1 if observations are
    "sociable": ("mean = ReduceMean(first, axes) change = Sub(first, mean)", {"axes": np.array([0])}),  # acts by the others
    "counting": (  # acts by an environment's index
        "nothing = Mul(first, zero) ones = Add(nothing, one) place = CumSum(ones, across) change = Softsign(place)",
        {"across": np.array(0), "zero": 0.0 * ONES, "one": ONES},
    ),
    "few": ("change = ReduceMax(first, axes)", {"axes": np.array([0])}),  # acts once for all environments
    "swelling": (  # asks for four megabytes per environment, several times at once
        "sum = ReduceSum(first, axes) swollen0 = Add(sum, wide0) swollen1 = Add(sum, wide1) none = Sub(swollen0, swollen1) "
        "column = ReduceMax(none, axes) change = Add(first, column)",
        {"axes": AXES, "wide0": WIDE, "wide1": 2.0 * WIDE},
    ),
}


def named(name: str) -> bytes:
    """One of ``LOADS``, or ``toiling``."""
    return toiling() if name == "toiling" else of_load(LOADS[name][0], **LOADS[name][1])


def toiling(products: int = 60, size: int = 900) -> bytes:
    """Multiplies matrices for seconds before it acts."""
    body = "sum = ReduceSum(first, axes) nothing = Mul(sum, zero) lone = Unsqueeze(nothing, last) product0 = Add(lone, matrix) "
    body += " ".join(f"product{k + 1} = MatMul(product{k}, product{k})" for k in range(products))
    body += (
        f" most = ReduceMax <keepdims = 0> (product{products}, inner) column = Unsqueeze(most, axes) change = Add(first, column)"
    )
    axes = {"axes": AXES, "last": np.array([2]), "inner": np.array([1, 2])}
    return of_load(body, zero=0.0 * ONES, matrix=np.zeros((size, size), np.float32), **axes)
