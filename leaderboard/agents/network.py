"""Check that an agent's network is plain arithmetic of moderate size, and try it.

``StrictNetwork`` does so in the process that runs a stranger's file (``sandbox_child.py``), which
imports this file without the rest of the package. What the metadata mean is left to
``agent_file.py``.
"""

import math
from typing import Any

import numpy as np
import onnx

from leaderboard.agents.messages import MAX_METADATA, Outline, is_short
from leaderboard.agents.onnx_session import (
    EXPORT,
    Floats,
    OnnxPolicy,
    check_actions,
    first_line,
    session_of,
)

MAX_BYTES = 20_000_000
MAX_NODES = 4_000
MAX_ENTRIES = 1_000_000
"""Largest size of any intermediate value, per environment."""
MAX_MEMORY = 65_536
"""Largest size of the memory, per environment."""
OPSETS = range(13, 27)
"""Versions of ONNX's operators that the pinned ONNX Runtime runs, and that the tests try."""
_OPERATORS = """
Abs Add And ArgMax Cast Clip Concat Constant Conv CumSum Div Einsum Elu Equal Erf Exp Expand Flatten
GRU Gather GatherElements Gelu Gemm Greater GreaterOrEqual HardSigmoid HardTanh Identity LSTM
LayerNormalization LeakyRelu Less LessOrEqual Log LogSoftmax MatMul Max Min Mish Mul Neg Not Or Pow
RNN Reciprocal ReduceMax ReduceMean ReduceMin ReduceSum Relu Reshape Selu Shape Sigmoid Sign Slice
Softmax Softplus Softsign Split Sqrt Squeeze Sub Sum Swish Tanh Transpose Unsqueeze Where
"""
OPERATORS = frozenset(_OPERATORS.split())
"""Allowed operators: arithmetic whose output size shape inference knows beforehand."""
TOLERANCE = 1e-4
"""Largest difference of an environment's action when other environments are in the batch: sums may
be taken in another order."""
_MAX_QUOTED = 60  # characters of a damaged text that an error quotes
_NUM_ENVS = 8  # with which a network is tried
_DOMAINS = ("", "ai.onnx")  # both name ONNX's own operators
# The first actions are checked, and then one of so many at random, which no network can foresee.
_FIRST_CHECKS = 2
_CHECK_EVERY = 32


class StrictNetwork:
    """A network that is plain arithmetic of moderate size, and acts reproducibly."""

    def read(self, content: bytes) -> Outline:
        """Return the outline, or raise ValueError if the file is not plain arithmetic."""
        self._content = content
        self._model, self._outline = read(content)
        return self._outline

    def session(self) -> Any:
        """Return the session. Raise ValueError if sizes are too large, or a trial fails."""
        check_sizes(self._model)
        del self._model
        self._generator = np.random.default_rng()
        outline = self._outline
        return session_after_trial(
            self._content,
            entries=outline.inputs["observation"],
            actions=outline.outputs["action"],
            memory_size=outline.inputs.get("memory", 0),
        )

    def act(self, policy: OnnxPolicy, observations: Floats, call: int) -> Floats:
        """Return a policy's actions, and check some of them.

        Raises:
            ValueError: actions depend on more than the observations.
        """
        if call < _FIRST_CHECKS or self._generator.integers(_CHECK_EVERY) == 0:
            return act_checked(policy, observations, self._generator)
        return policy.act(observations)


def read(content: bytes) -> tuple[onnx.ModelProto, Outline]:
    """Return network and outline; ``check_sizes`` is still to be called.

    Raises:
        ValueError: the network is not plain arithmetic.
    """
    if len(content) > MAX_BYTES:
        raise ValueError(f"is larger than {MAX_BYTES} bytes")
    try:
        model = onnx.load_model_from_string(content)
    except Exception as error:  # a parser can raise anything on garbled bytes
        raise ValueError(f"is no ONNX file: {error}") from error
    if not model.HasField("graph"):
        raise ValueError("is no ONNX file: it has no graph")
    _check_texts(model)
    _check_plain(model)

    properties = {entry.key: entry.value for entry in model.metadata_props}
    if len(properties) != len(model.metadata_props):
        raise ValueError("metadata names something twice")
    if not is_short(properties):
        raise ValueError(f"metadata holds more than {MAX_METADATA} characters")
    inputs = {value.name: _entries(value) for value in model.graph.input}
    outputs = {value.name: _entries(value) for value in model.graph.output}
    return model, Outline(properties, inputs, outputs)


def _check_texts(model: onnx.ModelProto) -> None:
    """Raise ValueError unless names and metadata are text: damaged ones are read as bytes."""
    texts: list[Any] = []
    for entry in model.metadata_props:
        texts += [entry.key, entry.value]
    for value in [*model.graph.input, *model.graph.output]:
        texts.append(value.name)
    for text in texts:
        if not isinstance(text, str):
            raise ValueError(f"is damaged: {text[:_MAX_QUOTED]!r} in it is not UTF-8")


def _check_plain(model: onnx.ModelProto) -> None:
    """Raise ValueError unless a model consists of allowed operators and of weights inside it."""
    graph = model.graph
    opsets = [(opset.domain, opset.version) for opset in model.opset_import]
    if len(opsets) != 1 or opsets[0][0] not in _DOMAINS or opsets[0][1] not in OPSETS:
        raise ValueError(
            f"uses operator sets {opsets}, "
            f"but must use ONNX's own, {OPSETS[0]} to {OPSETS[-1]}, alone"
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
        tensors += _constants(node)
    for tensor in tensors:
        _check_weights(tensor)


def _constants(node: onnx.NodeProto) -> list[onnx.TensorProto]:
    """Return the constants of a node. Raise ValueError if the operator is not allowed."""
    if node.domain not in _DOMAINS or node.op_type not in OPERATORS:
        raise ValueError(f"uses the operator {node.op_type!r}, which agents may not use")
    constants = []
    graph_types = (onnx.AttributeProto.GRAPH, onnx.AttributeProto.GRAPHS)
    for attribute in node.attribute:
        # A field without its type would be overlooked by some readers, but not by others.
        if attribute.type in graph_types or attribute.HasField("g"):
            raise ValueError(f"{node.op_type} holds a graph of its own, which agents may not")
        if attribute.type == onnx.AttributeProto.TENSOR:
            constants.append(attribute.t)
    return constants


def _check_weights(tensor: onnx.TensorProto) -> None:
    if tensor.external_data or tensor.data_location == onnx.TensorProto.EXTERNAL:
        raise ValueError(f"keeps its weights {tensor.name!r} in another file: all must be inside")
    if any(size < 0 for size in tensor.dims) or math.prod(tensor.dims) > MAX_BYTES:
        raise ValueError(f"holds weights {tensor.name!r} of impossible size")


def _entries(value: onnx.ValueInfoProto) -> int:
    """Return the entries per environment of a float32 value.

    Its shape is (any number of environments, entries).
    """
    tensor = value.type.tensor_type
    axes = tensor.shape.dim
    is_float = tensor.elem_type == onnx.TensorProto.FLOAT
    if not is_float or len(axes) != 2 or axes[0].HasField("dim_value"):
        raise ValueError(
            f"{value.name!r} must be float32 of shape (any number of environments, entries): "
            f"{EXPORT}"
        )
    return int(axes[1].dim_value)


def check_sizes(model: onnx.ModelProto) -> None:
    """Check that the size of every value for one environment is known beforehand, and moderate.

    Raises:
        ValueError: a size is unknown or too large, or the model is not valid ONNX.
    """
    single = onnx.ModelProto()
    single.CopyFrom(model)
    # Shapes that the file states could be wrong; those of one environment are inferred.
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

    axes_of = {}
    for value in [*graph.value_info, *graph.output]:
        axes_of[value.name] = value.type.tensor_type.shape.dim
    for node in graph.node:
        for name in node.output:
            if name:  # an output that is not used has no name
                _check_size(name, axes_of.get(name))


def _check_size(name: str, axes: Any) -> None:
    if axes is None or not all(axis.HasField("dim_value") for axis in axes):
        raise ValueError(
            f"value {name!r} is of a size that depends on more than the number of environments"
        )
    if math.prod(axis.dim_value for axis in axes) > MAX_ENTRIES:
        raise ValueError(f"value {name!r} has more than {MAX_ENTRIES} entries per environment")


def session_after_trial(content: bytes, entries: int, actions: int, memory_size: int) -> Any:
    """Return the session of a file's content, after a trial on zeros and on random observations.

    Args:
        content: the file's bytes.
        entries: entries of an observation.
        actions: numbers of an action.
        memory_size: entries of the memory.

    Raises:
        ValueError: the trial gives no actions, or none that are reproducible.
    """
    session = session_of(content)
    generator = np.random.default_rng(0)
    zeros = np.zeros((2, 2, entries), np.float32)
    sampled = generator.uniform(-1.0, 1.0, (2, _NUM_ENVS, entries)).astype(np.float32)
    for sequence in (zeros, sampled):
        policy = OnnxPolicy(session, memory_size, num_envs=sequence.shape[1])
        for observations in sequence:  # the second time with a memory
            acted = act_checked(policy, observations, generator)
            check_actions(acted, (len(observations), actions))
    return session


def act_checked(policy: OnnxPolicy, observations: Floats, generator: np.random.Generator) -> Floats:
    """Return a policy's actions, and check them.

    Raises:
        ValueError: the actions are not reproducible, or depend on the other environments.
    """
    memory = policy.memory
    actions = policy.act(observations)
    repeated_actions, _ = policy.run(observations, memory)
    if repeated_actions.tobytes() != actions.tobytes():
        raise ValueError("gives other actions for the same observations")
    if len(observations) > 1:
        # Each environment must act in half of the batch as it acts in all of it.
        for part in np.array_split(generator.permutation(len(observations)), 2):
            part_actions, part_memory = policy.run(observations[part], memory[part])
            if not (
                _are_close(part_actions, actions[part])
                and _are_close(part_memory, policy.memory[part])
            ):
                raise ValueError(
                    "an environment's actions or memory depend on the other environments "
                    "in the batch"
                )
    return actions


def _are_close(values: Floats, expected: Floats) -> bool:
    return np.allclose(expected, values, rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True)
