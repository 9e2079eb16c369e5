"""Check that an agent's network is nothing but arithmetic of moderate size on its inputs and on weights inside the file.

Imports ONNX and nothing of the project, because strangers' files are checked in a process of their own: ``sandbox_child.py``.
"""

import math
from typing import NamedTuple

import onnx

MAX_BYTES = 20_000_000
MAX_NODES = 4_000
MAX_ENTRIES = 1_000_000
"""Of any intermediate value, per environment."""
MAX_MEMORY = 65_536
"""Entries of the memory, per environment."""
MAX_METADATA = 1_000_000
"""Characters."""
OPSETS = range(13, 27)
"""Versions of ONNX's operators that the pinned ONNX Runtime runs, and that are tried in the tests."""
_OPERATORS = """
Abs Add And ArgMax Cast Clip Concat Constant Conv CumSum Div Einsum Elu Equal Erf Exp Expand Flatten GRU Gather GatherElements
Gelu Gemm Greater GreaterOrEqual HardSigmoid HardTanh Identity LSTM LayerNormalization LeakyRelu Less LessOrEqual Log LogSoftmax
MatMul Max Min Mish Mul Neg Not Or Pow RNN Reciprocal ReduceMax ReduceMean ReduceMin ReduceSum Relu Reshape Selu Shape Sigmoid
Sign Slice Softmax Softplus Softsign Split Sqrt Squeeze Sub Sum Swish Tanh Transpose Unsqueeze Where
"""
OPERATORS = frozenset(_OPERATORS.split())
"""Allowed operators: arithmetic whose output size shape inference knows beforehand."""


class Outline(NamedTuple):
    """Metadata and shapes of a file."""

    properties: dict[str, str]
    inputs: dict[str, int]
    """Entries per environment of each input."""
    outputs: dict[str, int]


def read(content: bytes) -> tuple[onnx.ModelProto, Outline]:
    """Return the network of a file's content, and its outline; ``check_sizes`` is still to be called.

    Raises:
        ValueError: it is no network, or not plain arithmetic; says why.
    """
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
    shapes = [{value.name: _entries(value) for value in values} for values in (model.graph.input, model.graph.output)]
    return model, Outline(properties, *shapes)


def _check_plain(model: onnx.ModelProto) -> None:
    """Check that the model is nothing but arithmetic on weights that it holds itself."""
    graph = model.graph
    opsets = [(opset.domain, opset.version) for opset in model.opset_import]
    if len(opsets) != 1 or opsets[0][0] not in ("", "ai.onnx") or opsets[0][1] not in OPSETS:
        raise ValueError(f"uses operator sets {opsets}, but must use ONNX's own, {OPSETS[0]} to {OPSETS[-1]}, alone")
    if model.functions or model.training_info or graph.sparse_initializer or graph.quantization_annotation:
        raise ValueError("holds functions, training or sparse or quantized weights, which agents have no need of")
    if len(graph.node) > MAX_NODES:
        raise ValueError(f"has {len(graph.node)} nodes, but may have {MAX_NODES}")
    tensors = list(graph.initializer)
    for node in graph.node:
        if node.domain not in ("", "ai.onnx") or node.op_type not in OPERATORS:
            raise ValueError(f"uses the operator {node.op_type!r}, which agents may not use")
        for attribute in node.attribute:
            if attribute.type in (onnx.AttributeProto.GRAPH, onnx.AttributeProto.GRAPHS) or attribute.HasField("g"):
                raise ValueError(f"{node.op_type} holds a graph of its own, which agents may not")
            if attribute.type == onnx.AttributeProto.TENSOR:
                tensors.append(attribute.t)
    for tensor in tensors:
        if tensor.external_data or tensor.data_location == onnx.TensorProto.EXTERNAL:
            raise ValueError(f"keeps its weights {tensor.name!r} in another file: all must be inside")
        if any(size < 0 for size in tensor.dims) or math.prod(tensor.dims) > MAX_BYTES:
            raise ValueError(f"holds weights {tensor.name!r} of impossible size")


def _entries(value: onnx.ValueInfoProto) -> int:
    """Return the entries per environment of a float32 value of shape (any number of environments, entries)."""
    tensor = value.type.tensor_type
    sizes = tensor.shape.dim
    if tensor.elem_type != onnx.TensorProto.FLOAT or len(sizes) != 2 or sizes[0].HasField("dim_value"):
        raise ValueError(f"{value.name!r} must be float32 of shape (any number of environments, entries)")
    return int(sizes[1].dim_value)


def check_sizes(model: onnx.ModelProto) -> None:
    """Check that for one environment the size of every value is known beforehand, and moderate.

    Raises:
        ValueError: it is not, or the network is invalid; says why.
    """
    single = onnx.ModelProto()
    single.CopyFrom(model)
    del single.graph.value_info[:]
    for value in [*single.graph.input, *single.graph.output]:
        value.type.tensor_type.shape.dim[0].dim_value = 1
    try:
        onnx.checker.check_model(single)
        graph = onnx.shape_inference.infer_shapes(single, check_type=True, strict_mode=True, data_prop=True).graph
    except Exception as error:  # of several unrelated types
        raise ValueError(f"is not valid ONNX: {str(error).strip().splitlines()[0]}") from error
    sizes = {value.name: value.type.tensor_type.shape for value in [*graph.value_info, *graph.output]}
    for name in (name for node in graph.node for name in node.output if name):
        dimensions = sizes[name].dim if name in sizes else None
        if dimensions is None or not all(size.HasField("dim_value") for size in dimensions):
            raise ValueError(f"value {name!r} is of a size that depends on more than the number of environments")
        if math.prod(size.dim_value for size in dimensions) > MAX_ENTRIES:
            raise ValueError(f"value {name!r} has more than {MAX_ENTRIES} entries per environment")
