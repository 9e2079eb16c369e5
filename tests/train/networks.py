"""Agents' files of any network, with the metadata of a tiny agent."""

from collections.abc import Mapping, Sequence

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from tests.train import onnx_agents


def of_nodes(
    nodes: Sequence[onnx.NodeProto], constants: Mapping[str, NDArray[np.generic]] | None = None, memory: int = 0
) -> bytes:
    """A file of nodes from ``observation`` (and ``memory``) to ``action`` (and ``next_memory``)."""

    def value(name: str, entries: int) -> onnx.ValueInfoProto:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["lanes", entries])

    inputs, outputs = [value("observation", 11)], [value("action", 2)]
    if memory:
        inputs, outputs = [*inputs, value("memory", memory)], [*outputs, value("next_memory", memory)]
    held = [numpy_helper.from_array(array, name) for name, array in (constants or {}).items()]
    model = helper.make_model(
        helper.make_graph(nodes, "network", inputs, outputs, held), opset_imports=[helper.make_opsetid("", 20)], ir_version=10
    )
    original = onnx.load_model_from_string(onnx_agents.content())
    helper.set_model_props(model, {entry.key: entry.value for entry in original.metadata_props})
    return bytes(model.SerializeToString())


def of_load(*nodes: onnx.NodeProto, **constants: NDArray[np.generic]) -> bytes:
    """A file that acts by the first two observations, after nodes that turn them into ``change``, shape (num_envs, 2)."""
    first = helper.make_node("Slice", ["observation", "start", "stop", "axis"], ["first"])
    bounds = {"start": [0], "stop": [2], "axis": [1]}
    given = {name: np.array(where, np.int64) for name, where in bounds.items()} | {"small": np.array([0.1], np.float32)}
    last = helper.make_node("Mul", ["change", "small"], ["action"])
    return of_nodes([first, *nodes, last], given | constants)


def plain() -> bytes:
    """A tenth of the first two observations."""
    return of_load(helper.make_node("Identity", ["first"], ["change"]))


def unbounded() -> bytes:
    """As ``plain``, but its actions are beyond 1 where observations are beyond 1."""
    big = np.array([9.9], np.float32)
    return of_load(helper.make_node("Mul", ["first", "big"], ["change"]), big=big)


def sociable() -> bytes:
    """Acts in an environment by the others."""
    axes = np.array([0], np.int64)
    mean = helper.make_node("ReduceMean", ["first", "axes"], ["mean"], keepdims=1)
    return of_load(mean, helper.make_node("Sub", ["first", "mean"], ["change"]), axes=axes)


def counting() -> bytes:
    """Acts in an environment by its index."""
    nodes = [
        helper.make_node("Mul", ["first", "zero"], ["nothing"]),
        helper.make_node("Add", ["nothing", "one"], ["ones"]),
        helper.make_node("CumSum", ["ones", "across"], ["place"]),
        helper.make_node("Softsign", ["place"], ["change"]),
    ]
    numbers = {"zero": np.zeros(1, np.float32), "one": np.ones(1, np.float32)}
    return of_load(*nodes, across=np.array(0, np.int64), **numbers)


def few() -> bytes:
    """Acts once for all environments."""
    axes = np.array([0], np.int64)
    return of_load(helper.make_node("ReduceMax", ["first", "axes"], ["change"], keepdims=1), axes=axes)


def toiling(products: int = 60, size: int = 900) -> bytes:
    """Multiplies matrices for seconds before it acts."""
    nodes = [
        helper.make_node("ReduceSum", ["first", "axes"], ["sum"], keepdims=1),
        helper.make_node("Mul", ["sum", "zero"], ["nothing"]),
        helper.make_node("Unsqueeze", ["nothing", "last"], ["lone"]),
        helper.make_node("Add", ["lone", "matrix"], ["product0"]),
        *(helper.make_node("MatMul", [f"product{k}", f"product{k}"], [f"product{k + 1}"]) for k in range(products)),
        helper.make_node("ReduceMax", [f"product{products}", "inner"], ["most"], keepdims=0),
        helper.make_node("Unsqueeze", ["most", "axes"], ["column"]),
        helper.make_node("Add", ["first", "column"], ["change"]),
    ]
    numbers = {
        "axes": np.array([1], np.int64),
        "last": np.array([2], np.int64),
        "inner": np.array([1, 2], np.int64),
        "zero": np.zeros(1, np.float32),
        "matrix": np.zeros((size, size), np.float32),
    }
    return of_load(*nodes, **numbers)


def swelling() -> bytes:
    """Asks for four megabytes per environment, eight times at once."""
    wide = np.zeros((1, 1_000_000), np.float32)
    nodes = [helper.make_node("ReduceSum", ["first", "axes"], ["sum"], keepdims=1)]
    nodes += [helper.make_node("Add", ["sum", f"wide{k}"], [f"swollen{k}"]) for k in range(2)]
    nodes += [
        helper.make_node("Sub", ["swollen0", "swollen1"], ["none"]),
        helper.make_node("ReduceMax", ["none", "axes"], ["column"], keepdims=1),
        helper.make_node("Add", ["first", "column"], ["change"]),
    ]
    return of_load(*nodes, axes=np.array([1], np.int64), wide0=wide, wide1=wide + 1.0)
