"""Check that an agent's network is plain arithmetic of moderate size, and try it.

Strangers' files are checked by a process that imports this file without the rest of the package: ``sandbox_child.py``.
"""

import math
from typing import Any

import numpy as np
import onnx

from turning_env.scoring.onnx_session import (
    Floats,
    OnnxPolicy,
    check_actions,
    first_line,
    session_of,
)
from turning_env.scoring.sandbox_child import Outline

MAX_BYTES = 20_000_000
MAX_NODES = 4_000
MAX_ENTRIES = 1_000_000  # largest size of any intermediate value, per environment
MAX_MEMORY = 65_536  # largest size of the memory, per environment
MAX_METADATA = 1_000_000  # characters
OPSETS = range(
    13, 27
)  # versions of ONNX's operators that the pinned ONNX Runtime runs, and that are tried in the tests
_OPERATORS = """
Abs Add And ArgMax Cast Clip Concat Constant Conv CumSum Div Einsum Elu Equal Erf Exp Expand Flatten GRU Gather GatherElements
Gelu Gemm Greater GreaterOrEqual HardSigmoid HardTanh Identity LSTM LayerNormalization LeakyRelu Less LessOrEqual Log LogSoftmax
MatMul Max Min Mish Mul Neg Not Or Pow RNN Reciprocal ReduceMax ReduceMean ReduceMin ReduceSum Relu Reshape Selu Shape Sigmoid
Sign Slice Softmax Softplus Softsign Split Sqrt Squeeze Sub Sum Swish Tanh Transpose Unsqueeze Where
"""
OPERATORS = frozenset(
    _OPERATORS.split()
)  # allowed operators: arithmetic whose output size shape inference knows beforehand
TOLERANCE = 1e-4
"""Largest difference of an environment's action when other environments are in the batch: sums may be taken in another order."""
_NUM_ENVS = 8  # with which a network is tried


def read(content: bytes) -> tuple[onnx.ModelProto, Outline]:
    """Return network and outline, or raise ValueError if it is not plain arithmetic; ``check_sizes`` is still to be called."""
    if len(content) > MAX_BYTES:
        raise ValueError(f"is larger than {MAX_BYTES} bytes")
    try:
        model = onnx.load_model_from_string(content)
    except Exception as error:  # a parser can raise anything on garbled bytes
        raise ValueError(f"is no ONNX file: {error}") from error
    if not model.HasField("graph"):
        raise ValueError("is no ONNX file: it has no graph")
    _check_plain(model)
    properties = {entry.key: entry.value for entry in model.metadata_props}
    if len(properties) != len(model.metadata_props):
        raise ValueError("metadata names something twice")
    if sum(len(text) for entry in properties.items() for text in entry) > MAX_METADATA:
        raise ValueError(f"metadata holds more than {MAX_METADATA} characters")
    shapes = [
        {value.name: _entries(value) for value in values}
        for values in (model.graph.input, model.graph.output)
    ]
    return model, Outline(properties, *shapes)


def _check_plain(model: onnx.ModelProto) -> None:
    graph = model.graph
    opsets = [(opset.domain, opset.version) for opset in model.opset_import]
    if len(opsets) != 1 or opsets[0][0] not in ("", "ai.onnx") or opsets[0][1] not in OPSETS:
        raise ValueError(
            f"uses operator sets {opsets}, but must use ONNX's own, {OPSETS[0]} to {OPSETS[-1]}, alone"
        )
    if (
        model.functions
        or model.training_info
        or graph.sparse_initializer
        or graph.quantization_annotation
    ):
        raise ValueError(
            "holds functions, training or sparse or quantized weights, which agents have no need of"
        )
    if len(graph.node) > MAX_NODES:
        raise ValueError(f"has {len(graph.node)} nodes, but may have {MAX_NODES}")
    tensors = list(graph.initializer)
    for node in graph.node:
        if node.domain not in ("", "ai.onnx") or node.op_type not in OPERATORS:
            raise ValueError(f"uses the operator {node.op_type!r}, which agents may not use")
        for attribute in node.attribute:
            if attribute.type in (
                onnx.AttributeProto.GRAPH,
                onnx.AttributeProto.GRAPHS,
            ) or attribute.HasField("g"):
                raise ValueError(f"{node.op_type} holds a graph of its own, which agents may not")
            if attribute.type == onnx.AttributeProto.TENSOR:
                tensors.append(attribute.t)
    for tensor in tensors:
        if tensor.external_data or tensor.data_location == onnx.TensorProto.EXTERNAL:
            raise ValueError(
                f"keeps its weights {tensor.name!r} in another file: all must be inside"
            )
        if any(size < 0 for size in tensor.dims) or math.prod(tensor.dims) > MAX_BYTES:
            raise ValueError(f"holds weights {tensor.name!r} of impossible size")


def _entries(value: onnx.ValueInfoProto) -> int:
    """Return the entries per environment of a float32 value of shape (any number of environments, entries)."""
    tensor = value.type.tensor_type
    sizes = tensor.shape.dim
    if (
        tensor.elem_type != onnx.TensorProto.FLOAT
        or len(sizes) != 2
        or sizes[0].HasField("dim_value")
    ):
        raise ValueError(
            f"{value.name!r} must be float32 of shape (any number of environments, entries)"
        )
    return int(sizes[1].dim_value)


def check_sizes(model: onnx.ModelProto) -> None:
    """Raise ValueError unless the size of every value for one environment is known beforehand, and moderate."""
    single = onnx.ModelProto()
    single.CopyFrom(model)
    del single.graph.value_info[:]
    for value in [*single.graph.input, *single.graph.output]:
        value.type.tensor_type.shape.dim[0].dim_value = 1
    try:
        onnx.checker.check_model(single)
        graph = onnx.shape_inference.infer_shapes(
            single, check_type=True, strict_mode=True, data_prop=True
        ).graph
    except Exception as error:  # of several unrelated types
        raise ValueError(f"is not valid ONNX: {first_line(error)}") from error
    sizes = {
        value.name: value.type.tensor_type.shape.dim for value in [*graph.value_info, *graph.output]
    }
    for name in (name for node in graph.node for name in node.output if name):
        if name not in sizes or not all(size.HasField("dim_value") for size in sizes[name]):
            raise ValueError(
                f"value {name!r} is of a size that depends on more than the number of environments"
            )
        if math.prod(size.dim_value for size in sizes[name]) > MAX_ENTRIES:
            raise ValueError(f"value {name!r} has more than {MAX_ENTRIES} entries per environment")


def tried(content: bytes, entries: int, actions: int, memory_size: int) -> Any:
    """Return the session of a file's content, or raise ValueError if a trial gives no actions, or none that are reproducible."""
    session, generator = session_of(content), np.random.default_rng(0)
    sampled = generator.uniform(-1.0, 1.0, (2, _NUM_ENVS, entries)).astype(np.float32)
    for given in (np.zeros((2, 2, entries), np.float32), sampled):
        policy = OnnxPolicy(session, memory_size, given.shape[1])
        for observations in given:  # the second time with a memory
            check_actions(
                act_checked(policy, observations, generator), (len(observations), actions)
            )
    return session


def act_checked(policy: OnnxPolicy, observations: Floats, generator: np.random.Generator) -> Floats:
    """Act, and raise ValueError if actions are not reproducible, or depend on the other environments in the batch."""
    before = policy.memory
    actions = policy.act(observations)
    again, _ = policy.run(observations, before)
    if again.tobytes() != actions.tobytes():
        raise ValueError("gives other actions for the same observations")
    if len(observations) > 1:
        for part in np.array_split(generator.permutation(len(observations)), 2):
            alone = policy.run(observations[part], before[part])
            for mine, its in zip((actions, policy.memory), alone, strict=True):
                if not np.allclose(mine[part], its, rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True):
                    raise ValueError(
                        "an environment's actions or memory depend on the other environments in the batch"
                    )
    return actions
