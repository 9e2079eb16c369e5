"""Networks as ONNX: of actors, PyTorch modules, Stable-Baselines3 models, and ONNX files.

``to_onnx`` writes an actor, ``sb3_actor`` makes one of a saved model, and ``adopted`` adopts an
ONNX file from elsewhere. Load models of your own only: they are pickles, which can run code.
"""

import copy
import importlib
import logging
import pickle
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnx
import torch
from onnx import compose, helper, inliner

from leaderboard import torch_module
from leaderboard.agents import agent_file
from leaderboard.agents.agent_file import Metadata, acting_space, seen_space
from leaderboard.agents.network import session_after_trial
from leaderboard.agents.onnx_session import first_line
from leaderboard.sb3_observations import was_normalised
from train.actor import Actor
from train.recurrent_ppo import RecurrentActor
from train.run import Run, warn_of_pickle

OPSET = 20
_ADOPTED = "adopted/"  # prefix of the names in an adopted network


class _WithoutMemory(torch.nn.Module):
    """An actor without memory as a network of one input and one output."""

    def __init__(self, actor: Actor) -> None:
        super().__init__()
        self._actor = actor

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        no_memory = observation.new_zeros((observation.shape[0], 0))
        action: torch.Tensor = self._actor(observation, no_memory)[0]
        return action


def to_onnx(actor: Actor, metadata: Metadata) -> bytes:
    """Return the content of an actor's ONNX file, the same bytes every time.

    Raises:
        ValueError: the actor does not act as the metadata say, or PyTorch cannot write it.
    """
    # Two environments: a size of one would be taken for a constant.
    observations = torch.zeros(2, len(metadata.observation_space.low))
    memory = torch.zeros(2, actor.memory_size)
    _check_shapes(actor, observations, memory, actions=len(metadata.action_space.low))
    num_envs = torch.export.Dim("lanes", min=1)  # the name of the axis in the file
    # The exporter keeps no input of size 0, so an actor without memory has no such input.
    if actor.memory_size:
        network: torch.nn.Module = actor
        inputs = {"observation": observations, "memory": memory}
        outputs = ["action", "next_memory"]
    else:
        network = _WithoutMemory(actor)
        inputs = {"observation": observations}
        outputs = ["action"]
    try:
        with _quietly():
            program = torch.onnx.export(
                network.eval(),
                tuple(inputs.values()),
                dynamo=True,
                input_names=list(inputs),
                output_names=outputs,
                dynamic_shapes=tuple({0: num_envs} for _ in inputs),
                opset_version=OPSET,
                verbose=False,
            )
    except Exception as error:  # the exporter raises many types
        raise ValueError(
            f"PyTorch cannot write {type(actor).__name__} as ONNX: {first_line(error)}"
        ) from error
    assert program is not None
    return with_properties(program.model_proto, metadata)


def _check_shapes(
    actor: Actor, observations: torch.Tensor, memory: torch.Tensor, actions: int
) -> None:
    """Raise ValueError unless an actor returns actions and a memory of the right shapes."""
    try:
        results = actor.eval()(observations, memory)
        shapes = tuple(tuple(result.shape) for result in results)
    except Exception as error:  # modules raise many types
        raise ValueError(
            f"it cannot act on observations of shape {tuple(observations.shape)}: "
            f"{first_line(error)} (state the wrappers of its training, such as "
            '{"derived": True}, as settings)'
        ) from error
    expected = ((len(observations), actions), tuple(memory.shape))
    if shapes != expected:
        raise ValueError(
            f"it gives actions and memory of shapes {shapes}, but must give {expected}"
        )


@contextmanager
def _quietly() -> Iterator[None]:
    """Silence the exporter's warnings about its own deprecated calls and missing packages."""
    disabled = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(disabled)


class _Port(NamedTuple):
    """An input of an adopted network with the output that answers it."""

    input_name: str  # in an agent's file
    output_name: str
    input: onnx.ValueInfoProto  # of the adopted network
    output: onnx.ValueInfoProto
    input_size: int  # entries per environment
    output_size: int


def adopted(path: Path, metadata: Metadata) -> bytes:
    """Return an agent's file made of any network in an ONNX file of your own.

    The network may have its weights in a side file. The first input is the observation and the
    first output the action, clipped to -1..1; a second input and output are the memory. The first
    axis of all becomes the number of environments. Metadata in the file is replaced.

    Raises:
        ValueError: the file is no such network.
    """
    try:
        model = inliner.inline_local_functions(onnx.load(path))
        # So that no name in it is one of an agent's file.
        model = compose.add_prefix(model, _ADOPTED)
    except Exception as error:  # a parser can raise anything on garbled bytes
        raise ValueError(f"is no ONNX file, or lacks its weights: {first_line(error)}") from error
    if any(entry.key == "format" for entry in model.metadata_props):
        raise ValueError("is an agent's file already")

    ports = _ports(model.graph, metadata)
    batch = _batch_size(ports[0].input)
    _connect(model.graph, ports)
    _drop_unused_opsets(model)
    content = with_properties(model, metadata)
    memory_size = agent_file.checked(content).memory_size
    try:
        session_after_trial(
            content,
            entries=ports[0].input_size,
            actions=ports[0].output_size,
            memory_size=memory_size,
        )
    except ValueError as error:
        if not batch:
            raise
        raise ValueError(
            f"was written for a batch of {batch} and cannot act on others: "
            f"export it with a dynamic first axis ({error})"
        ) from error
    return content


def _ports(graph: onnx.GraphProto, metadata: Metadata) -> list[_Port]:
    """Return the ports of a network: of observation and action, and perhaps of a memory."""
    weights = {tensor.name for tensor in graph.initializer}
    inputs = [value for value in graph.input if value.name not in weights]
    outputs = list(graph.output)
    if len(inputs) != len(outputs) or len(inputs) not in (1, 2):
        raise ValueError(
            f"has {len(inputs)} inputs and {len(outputs)} outputs, "
            "but must have an observation and an action, and besides a memory each or none"
        )
    # The size of the memory is that of its input.
    memory_size = _size(inputs[1], None) if len(inputs) == 2 else None
    entries = len(metadata.observation_space.low)
    actions = len(metadata.action_space.low)
    ports = [
        _Port(
            input_name="observation",
            output_name="action",
            input=inputs[0],
            output=outputs[0],
            input_size=_size(inputs[0], entries),
            output_size=_size(outputs[0], actions),
        )
    ]
    if memory_size is not None:
        port = _Port(
            input_name="memory",
            output_name="next_memory",
            input=inputs[1],
            output=outputs[1],
            input_size=memory_size,
            output_size=_size(outputs[1], memory_size),
        )
        ports.append(port)
    return ports


def _batch_size(value: onnx.ValueInfoProto) -> int:
    """Return the number of environments for which an input was written; 0: any."""
    axes = value.type.tensor_type.shape.dim
    return int(axes[0].dim_value) if axes else 0


def _size(value: onnx.ValueInfoProto, expected: int | None) -> int:
    """Return the entries per environment of an input or an output.

    It may leave them open if they are known.
    """
    axes = value.type.tensor_type.shape.dim
    stated = None
    if len(axes) == 2 and axes[-1].HasField("dim_value"):
        stated = axes[-1].dim_value
    size = stated or expected
    agrees = stated is None or expected is None or stated == expected
    if len(axes) not in (0, 2) or size is None or not agrees:
        name = value.name.removeprefix(_ADOPTED)
        shape = [axis.dim_value or axis.dim_param or "?" for axis in axes]
        raise ValueError(
            f"{name!r} has shape {shape}, "
            f"but must have (number of environments, {expected or 'entries'})"
        )
    return size


def _connect(graph: onnx.GraphProto, ports: list[_Port]) -> None:
    """Give a network the inputs and outputs of an agent's file, with casts and a clip between."""
    del graph.input[:], graph.output[:], graph.value_info[:]
    float_type = onnx.TensorProto.FLOAT
    # The network may compute in another precision, such as float64 or float16.
    first_nodes = []
    last_nodes = [
        helper.make_node("Constant", [], ["low"], value_float=-1.0),
        helper.make_node("Constant", [], ["high"], value_float=1.0),
    ]
    for port in ports:
        graph.input.append(_value(port.input_name, port.input_size))
        graph.output.append(_value(port.output_name, port.output_size))
        input_type = port.input.type.tensor_type.elem_type
        cast = helper.make_node("Cast", [port.input_name], [port.input.name], to=input_type)
        first_nodes.append(cast)
        result = "unclipped" if port.output_name == "action" else port.output_name
        last_nodes.append(helper.make_node("Cast", [port.output.name], [result], to=float_type))
    last_nodes.append(helper.make_node("Clip", ["unclipped", "low", "high"], ["action"]))
    nodes = [*first_nodes, *graph.node, *last_nodes]
    del graph.node[:]
    graph.node.extend(nodes)


def _value(name: str, size: int) -> onnx.ValueInfoProto:
    """Return an input or output of an agent's file."""
    return helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["environments", size])


def _drop_unused_opsets(model: onnx.ModelProto) -> None:
    """Remove the operator sets that no node uses: an agent's file may have ONNX's own alone."""
    used = {node.domain or "ai.onnx" for node in model.graph.node}
    opsets = [opset for opset in model.opset_import if (opset.domain or "ai.onnx") in used]
    del model.opset_import[:]
    model.opset_import.extend(opsets)


def with_properties(model: onnx.ModelProto, metadata: Metadata) -> bytes:
    """Return the content of a network's file, with its metadata in place of any other.

    Stack traces, file names of the exporting machine and shapes that follow from the rest are
    removed.
    """
    graph = model.graph
    for part in (model, graph, *graph.node, *graph.initializer, *graph.input, *graph.output):
        part.ClearField("doc_string")
        part.ClearField("metadata_props")
    del graph.value_info[:]
    helper.set_model_props(model, metadata.properties())
    return bytes(model.SerializeToString(deterministic=True))


class ModuleActor(Actor):
    """A module from observations to actions, which are clipped to -1..1.

    A module with an attribute ``memory_size`` above 0 has the interface of ``Actor``: it also takes
    and returns a memory.
    """

    def __init__(self, module: torch.nn.Module) -> None:
        super().__init__()
        self.module = copy.deepcopy(module).cpu().float().eval()
        self.memory_size = torch_module.memory_size(module)

    def forward(
        self, observation: torch.Tensor, memory: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        output = torch_module.run(self.module, observation, memory)
        next_memory = memory if output.memory is None else output.memory
        return output.actions.clamp(-1.0, 1.0), next_memory


class NormalisedActor(Actor):
    """An actor on observations normalised by the statistics of ``VecNormalize``."""

    mean: torch.Tensor
    deviation: torch.Tensor

    def __init__(self, actor: Actor, statistics: Any) -> None:
        super().__init__()
        self.actor = actor
        self.memory_size = actor.memory_size
        self.clip = float(statistics.clip_obs)
        moments = statistics.obs_rms
        variance = torch.as_tensor(moments.var + statistics.epsilon, dtype=torch.float32)
        self.register_buffer("mean", torch.as_tensor(moments.mean, dtype=torch.float32))
        self.register_buffer("deviation", variance.sqrt())

    def forward(
        self, observation: torch.Tensor, memory: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        normalised = ((observation - self.mean) / self.deviation).clamp(-self.clip, self.clip)
        action, memory = self.actor(normalised, memory)
        return action, memory


@dataclass(frozen=True)
class _ModelClass:
    """A class of models of Stable-Baselines3."""

    mark: str  # a text that files of such models hold
    package: str
    name: str


_MODEL_CLASSES = (
    _ModelClass("sb3_contrib.common.recurrent.policies", "sb3_contrib", "RecurrentPPO"),
    _ModelClass("clip_range", "stable_baselines3", "PPO"),
    _ModelClass("gae_lambda", "stable_baselines3", "A2C"),
    _ModelClass("policy_delay", "stable_baselines3", "TD3"),
    _ModelClass("top_quantiles_to_drop_per_net", "sb3_contrib", "TQC"),
    _ModelClass("target_entropy", "stable_baselines3", "SAC"),
)
"""Classes of models that can be exported; the first whose mark a file holds is right."""


def sb3_actor(path: Path, run: Run, statistics: Path | None = None) -> tuple[Run, Actor]:
    """Return the training and the actor of a model of Stable-Baselines3 or sb3-contrib.

    Args:
        path: file of the model.
        run: a run elsewhere on the environment; algorithm, steps and perhaps the belief are added.
        statistics: file of ``VecNormalize``, without which a model that was trained with it is
            refused.

    Raises:
        ValueError: the model cannot be exported.
    """
    warn_of_pickle(path)
    model_class = _class_of_model(path)
    try:
        module = importlib.import_module(model_class.package)
        model: Any = getattr(module, model_class.name).load(path, device="cpu")
    except Exception as error:  # garbled bytes can raise anything
        raise ValueError(
            f"cannot be loaded as {model_class.name} of {model_class.package}: {error}"
        ) from error
    parameters = _parameters_of_model(model, run)
    actions = acting_space(run.scenario, parameters)
    if model.action_space != actions:
        raise ValueError(
            f"was trained on the action space {model.action_space}, "
            f"but that of {run.env_id} is {actions}"
        )

    network = _network(model_class.name, model.policy)
    actor: Actor = network if isinstance(network, Actor) else ModuleActor(network)
    if statistics is not None:
        actor = _normalised(actor, statistics, shape=model.observation_space.shape)
    elif was_normalised(model):
        raise ValueError(
            "was trained with VecNormalize, whose statistics the file does not hold: save them in "
            "the training by model.get_vec_normalize_env().save('statistics.pkl'), "
            "and add --statistics statistics.pkl"
        )
    trained_run = replace(run, algorithm=model_class.name.lower(), parameters=parameters)
    return trained_run, actor.eval()


def _class_of_model(path: Path) -> _ModelClass:
    """Return the class of a saved model, by a text that its file holds."""
    try:
        with zipfile.ZipFile(path) as archive:
            description = archive.read("data").decode()
    except (KeyError, ValueError, zipfile.BadZipFile) as error:
        raise ValueError(_no_model()) from error
    for model_class in _MODEL_CLASSES:
        if f'"{model_class.mark}"' in description:
            return model_class
    raise ValueError(_no_model())


def _no_model() -> str:
    names = ", ".join(model_class.name for model_class in _MODEL_CLASSES)
    return f"is no model of Stable-Baselines3; those that can be exported are {names}"


def _parameters_of_model(model: Any, run: Run) -> dict[str, Any]:
    """Return the parameters of a model's training on the environment of a run.

    Its observations tell whether it was shown a belief.
    """
    plain = run.parameters | {"total_timesteps": int(model.num_timesteps)}
    with_belief = plain | {"belief": True}
    plain_space = seen_space(run.env_id, run.scenario, plain)
    belief_space = seen_space(run.env_id, run.scenario, with_belief)
    if model.observation_space == plain_space:
        return plain
    if model.observation_space == belief_space:
        return with_belief
    raise ValueError(
        f"was trained on observations of shape {model.observation_space.shape} or other bounds, "
        f"but {run.env_id} has {plain_space.shape}, with a belief {belief_space.shape}: "
        "state the --env and --scenario of its training, and --set derived=true if it had "
        "VectorDerivedObservation; a model behind VecFrameStack or another wrapper that changes "
        "observations cannot be exported"
    )


def _network(name: str, policy: Any) -> torch.nn.Module:
    """Return the network from observations to the most likely actions of a policy."""
    if name == "RecurrentPPO":
        return RecurrentActor(policy)
    if name in ("PPO", "A2C"):
        layers = [policy.pi_features_extractor, policy.mlp_extractor.policy_net, policy.action_net]
        if policy.squash_output:
            layers.append(torch.nn.Tanh())
        return torch.nn.Sequential(*layers)
    # The actor of TD3 ends in its own tanh, those of SAC and TQC do not.
    actor = policy.actor
    if name == "TD3":
        return torch.nn.Sequential(actor.features_extractor, actor.mu)
    return torch.nn.Sequential(actor.features_extractor, actor.latent_pi, actor.mu, torch.nn.Tanh())


def read_statistics(path: Path) -> Any:
    """Read the statistics that ``VecNormalize.save`` has written, a pickle of your own.

    Raises:
        ValueError: the file holds no such statistics.
    """
    from stable_baselines3.common.vec_env import VecNormalize

    warn_of_pickle(path)
    try:
        statistics = pickle.loads(path.read_bytes())
    except OSError:
        raise
    except Exception as error:  # garbled bytes can raise anything
        raise ValueError(f"{path} cannot be read as statistics of VecNormalize: {error}") from error
    if not isinstance(statistics, VecNormalize):
        raise ValueError(
            f"{path} holds a {type(statistics).__name__}, "
            "but must hold what VecNormalize.save has written"
        )
    return statistics


def _normalised(actor: Actor, path: Path, shape: tuple[int, ...]) -> Actor:
    """Return an actor that normalises its observations, of a shape, by statistics in a file.

    Statistics of rewards alone change no observation.
    """
    statistics = read_statistics(path)
    if not statistics.norm_obs:
        return actor
    stated_shape = np.shape(statistics.obs_rms.mean)
    if stated_shape != shape:
        raise ValueError(
            f"was trained on observations of shape {shape}, "
            f"but the statistics in {path} are of shape {stated_shape}"
        )
    return NormalisedActor(actor, statistics)
