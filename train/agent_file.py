"""An agent as one file for any machine: a network in ONNX, and in it what the agent is and how it came about.

The network takes ``observation`` (float32, lanes x entries) and, where the agent has a memory, ``memory`` (float32,
lanes x memory_size); it gives ``action`` (lanes x actions, -1..1) and then also ``next_memory``. Before an episode's first
observation the memory is 0. All that belongs to the agent is inside: scaling, clipping, weights.

A file may come from anywhere, so it is refused unless it is small, plain arithmetic from inputs to outputs, and says all that
``Metadata`` names. Nothing in it can run code, read another file, loop, or ask for more memory than stated here.
"""

import hashlib
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self

import onnx
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError, model_validator

from turning_env import IDS, Scenario
from turning_env.lathes import action_space, observation_space

FORMAT: Literal["rough-turning/agent/1"] = "rough-turning/agent/1"
MOST_BYTES = 20_000_000
MOST_NODES = 2_000
MOST_ENTRIES = 1_000_000
"""Of any value on the way from input to output, per lane."""
MOST_MEMORY = 65_536
OPSETS = range(18, 25)
OPERATORS = frozenset(
    (
        *(
            "Abs",
            "Add",
            "And",
            "ArgMax",
            "Cast",
            "Clip",
            "Concat",
            "Constant",
            "Conv",
            "CumSum",
            "Div",
            "Einsum",
            "Elu",
            "Equal",
            "Erf",
        ),
        *("Exp", "Expand", "Flatten", "GRU", "Gather", "GatherElements", "Gelu", "Gemm", "Greater", "GreaterOrEqual"),
        *("HardSigmoid", "HardTanh"),
        *(
            "Identity",
            "LSTM",
            "LayerNormalization",
            "LeakyRelu",
            "Less",
            "LessOrEqual",
            "Log",
            "LogSoftmax",
            "MatMul",
            "Max",
            "Min",
            "Mish",
        ),
        *("Mul", "Neg", "Not", "Or", "Pow", "RNN", "Reciprocal", "ReduceMax", "ReduceMean", "ReduceMin", "ReduceSum", "Relu"),
        *("Reshape", "Selu", "Shape", "Sigmoid", "Sign", "Slice", "Softmax", "Softplus", "Softsign", "Split", "Sqrt"),
        *("Squeeze", "Sub", "Sum", "Swish", "Tanh", "Transpose", "Unsqueeze", "Where"),
    )
)
"""Those that a network may consist of: arithmetic whose result is as large as shape inference says beforehand."""


class Space(BaseModel):
    """A box, one value per entry."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    low: list[float]
    high: list[float]

    @classmethod
    def of(cls, box: Any) -> Self:
        """Of a Gymnasium ``Box`` of one axis."""
        return cls(low=box.low.tolist(), high=box.high.tolist())


class Metadata(BaseModel):
    """What a file says of its agent: one ONNX metadata property per field, text as it is, all else as JSON."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    format: Literal["rough-turning/agent/1"]
    algorithm: str = Field(pattern="^[a-z][a-z0-9_]{0,63}$")
    seed: int = Field(ge=0)
    """Of the training."""
    env_id: str
    scenario: Scenario
    """On which it was trained, whole."""
    scenario_digest: str
    observation_space: Space
    action_space: Space
    parameters: dict[str, JsonValue]
    """The algorithm's hyperparameters."""
    trained_intervals: int = Field(ge=0)
    command: str
    """What trained it."""
    versions: dict[str, str]
    """Of what made the file."""

    @model_validator(mode="after")
    def _is_consistent(self) -> Self:
        if self.env_id not in IDS:
            raise ValueError(f"env_id is {self.env_id!r}, but must be one of {', '.join(IDS)}")
        if self.scenario_digest != self.scenario.digest():
            raise ValueError("scenario_digest is not that of scenario")
        for name, box in (
            ("observation_space", observation_space(self.scenario)),
            ("action_space", action_space(self.scenario)),
        ):
            if getattr(self, name) != Space.of(box):
                raise ValueError(f"{name} is not that of scenario {self.scenario.name!r}")
        return self

    def properties(self) -> dict[str, str]:
        """As ONNX keeps it."""
        values = self.model_dump(mode="json")
        return {name: value if isinstance(value, str) else json.dumps(value) for name, value in values.items()}

    @classmethod
    def of(cls, properties: dict[str, str]) -> Self:
        """From what ONNX keeps.

        Raises:
            ValueError: something is missing, unknown or not allowed; names it.
        """
        values: dict[str, Any] = {}
        for name, text in properties.items():
            field = cls.model_fields.get(name)
            try:
                values[name] = _from_json(text) if field is not None and field.annotation in _JSON_FIELDS else text
            except (ValueError, RecursionError) as error:
                raise ValueError(f"metadata {name} is not JSON: {error}") from error
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            details = error.errors()[0]
            field_name = ".".join(str(part) for part in details["loc"])
            raise ValueError(
                f"metadata {field_name}: {details['msg']}".replace("metadata : Value error, ", "metadata ")
            ) from error


def _from_json(text: str) -> Any:
    value = json.loads(text)
    json.dumps(value, ensure_ascii=False).encode()  # halves of surrogate pairs can be read, but not written
    return value


_JSON_FIELDS = (int, Scenario, Space, dict[str, JsonValue], dict[str, str])


@dataclass(frozen=True)
class AgentFile:
    """A file that has passed every check."""

    content: bytes
    metadata: Metadata
    memory_size: int

    @property
    def digest(self) -> str:
        """SHA-256 of the file."""
        return hashlib.sha256(self.content).hexdigest()

    @property
    def label(self) -> str:
        """How the agent is called, and its file without the suffix."""
        return f"{self.metadata.algorithm}-seed{self.metadata.seed}"


def read(path: Path) -> AgentFile:
    """Read an agent's file.

    Raises:
        ValueError: it is not an agent's file, or one that is not trusted; says why.
        OSError: it cannot be read.
    """
    with path.open("rb") as stream:
        content = stream.read(MOST_BYTES + 1)
    try:
        return checked(content)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def checked(content: bytes) -> AgentFile:
    """The agent of a file's content.

    Raises:
        ValueError: see ``read``.
    """
    if len(content) > MOST_BYTES:
        raise ValueError(f"is larger than {MOST_BYTES} bytes")
    try:
        model = onnx.load_model_from_string(content)
    except Exception as error:  # whatever a parser throws at bytes of any kind
        raise ValueError(f"is no ONNX file: {error}") from error
    if not model.HasField("graph"):
        raise ValueError("is no ONNX file: it has no graph")
    _check_plain(model)
    properties = {entry.key: entry.value for entry in model.metadata_props}
    if len(properties) != len(model.metadata_props):
        raise ValueError("metadata names something twice")
    metadata = Metadata.of(properties)
    memory_size = _memory_size(model, metadata)
    _check_sizes(model)
    return AgentFile(content, metadata, memory_size)


def _check_plain(model: onnx.ModelProto) -> None:
    """See that the model is nothing but arithmetic on weights that it holds itself."""
    graph = model.graph
    opsets = [(opset.domain, opset.version) for opset in model.opset_import]
    if len(opsets) != 1 or opsets[0][0] not in ("", "ai.onnx") or opsets[0][1] not in OPSETS:
        raise ValueError(f"uses operator sets {opsets}, but must use ONNX's own, {OPSETS[0]} to {OPSETS[-1]}, alone")
    if model.functions or model.training_info or graph.sparse_initializer or graph.quantization_annotation:
        raise ValueError("holds functions, training or sparse or quantized weights, which agents have no need of")
    if len(graph.node) > MOST_NODES:
        raise ValueError(f"has {len(graph.node)} nodes, but may have {MOST_NODES}")
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
        if any(size < 0 for size in tensor.dims) or math.prod(tensor.dims) > MOST_BYTES:
            raise ValueError(f"holds weights {tensor.name!r} of impossible size")


def _memory_size(model: onnx.ModelProto, metadata: Metadata) -> int:
    """The memory's size, 0 for none, of inputs and outputs that are as they should be."""
    entries, actions = len(metadata.observation_space.low), len(metadata.action_space.low)
    inputs = {value.name: _row(value) for value in model.graph.input}
    outputs = {value.name: _row(value) for value in model.graph.output}
    memory = inputs.get("memory", 0)
    expected_inputs = {"observation": entries} | ({"memory": memory} if "memory" in inputs else {})
    expected_outputs = {"action": actions} | ({"next_memory": memory} if "memory" in inputs else {})
    for what, found, expected in (("inputs", inputs, expected_inputs), ("outputs", outputs, expected_outputs)):
        if found != expected:
            raise ValueError(f"has {what} {found}, but must have {expected} entries per lane for its scenario")
    if "memory" in inputs and not 1 <= memory <= MOST_MEMORY:
        raise ValueError(f"has a memory of {memory} entries, but may have 1 to {MOST_MEMORY}")
    return memory


def _row(value: onnx.ValueInfoProto) -> int:
    """Entries per lane of a float32 value of shape (any number of lanes, entries)."""
    tensor = value.type.tensor_type
    sizes = tensor.shape.dim
    if tensor.elem_type != onnx.TensorProto.FLOAT or len(sizes) != 2 or sizes[0].HasField("dim_value"):
        raise ValueError(f"{value.name!r} must be float32 of shape (any number of lanes, entries)")
    return int(sizes[1].dim_value)


def _check_sizes(model: onnx.ModelProto) -> None:
    """See that for one lane every value's size is known beforehand, and moderate."""
    lane = onnx.ModelProto()
    lane.CopyFrom(model)
    del lane.graph.value_info[:]
    for value in [*lane.graph.input, *lane.graph.output]:
        value.type.tensor_type.shape.dim[0].dim_value = 1
    try:
        onnx.checker.check_model(lane)
        graph = onnx.shape_inference.infer_shapes(lane, check_type=True, strict_mode=True, data_prop=True).graph
    except Exception as error:  # of several unrelated types
        raise ValueError(f"is not valid ONNX: {str(error).strip().splitlines()[0]}") from error
    sizes = {value.name: value.type.tensor_type.shape for value in [*graph.value_info, *graph.output]}
    for name in (name for node in graph.node for name in node.output if name):
        dimensions = sizes[name].dim if name in sizes else None
        if dimensions is None or not all(size.HasField("dim_value") for size in dimensions):
            raise ValueError(f"value {name!r} is of a size that depends on more than the number of lanes")
        if math.prod(size.dim_value for size in dimensions) > MOST_ENTRIES:
            raise ValueError(f"value {name!r} has more than {MOST_ENTRIES} entries per lane")
