"""Networks as ONNX: write those of actors, PyTorch modules and Stable-Baselines3 models, and adopt ONNX files from elsewhere.

Load models of your own only: they are pickles, which can run code.
"""

import copy
import importlib
import logging
import pickle
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import compose, helper, inliner

from train.actor import Actor
from train.agents import agent_file
from train.agents.agent_file import Metadata, seen_space
from train.agents.network import tried
from train.recurrent_ppo import RecurrentActor
from train.run import Run, warn_of_pickle
from turning_env.batch.driver import action_space
from turning_env.scoring.onnx_session import first_line
from turning_env.scoring.sb3_observations import was_normalised

OPSET = 20


class _WithoutMemory(torch.nn.Module):
    """An actor without memory as a network of one input and one output."""

    def __init__(self, actor: Actor) -> None:
        super().__init__()
        self._actor = actor

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        action: torch.Tensor = self._actor(
            observation, observation.new_zeros((observation.shape[0], 0))
        )[0]
        return action


def to_onnx(actor: Actor, about: Metadata) -> bytes:
    """Return the content of an actor's ONNX file, the same bytes every time, or raise ValueError if there can be none."""
    # Two environments: a size of one would be taken for a constant.
    observations, memory = (
        torch.zeros(2, len(about.observation_space.low)),
        torch.zeros(2, actor.memory_size),
    )
    expected = (2, len(about.action_space.low)), tuple(memory.shape)
    try:
        found = tuple(tuple(each.shape) for each in actor.eval()(observations, memory))
    except Exception as error:  # modules raise many types
        raise ValueError(
            f"it cannot act on observations of shape {tuple(observations.shape)}: {first_line(error)}"
        ) from error
    if found != expected:
        raise ValueError(f"it gives actions and memory of shapes {found}, but must give {expected}")
    count = 2 if actor.memory_size else 1
    num_envs = torch.export.Dim("lanes", min=1)  # the name of the axis in the file
    try:
        with _quietly():
            program = torch.onnx.export(
                (actor if actor.memory_size else _WithoutMemory(actor)).eval(),
                (observations, memory)[:count],
                dynamo=True,
                input_names=["observation", "memory"][:count],
                output_names=["action", "next_memory"][:count],
                dynamic_shapes=({0: num_envs},) * count,
                opset_version=OPSET,
                verbose=False,
            )
    except Exception as error:  # the exporter raises many types
        raise ValueError(
            f"PyTorch cannot write {type(actor).__name__} as ONNX: {first_line(error)}"
        ) from error
    assert program is not None
    return with_properties(program.model_proto, about)


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


def adopted(path: Path, about: Metadata) -> bytes:
    """Return an agent's file made of any network in an ONNX file of your own, also with its weights in a side file.

    The first input is the observation and the first output the action, clipped to -1..1; a second input and output are the
    memory. The first axis of all becomes the number of environments. Metadata in the file is replaced. ValueError says what is
    missing.
    """
    try:
        model = inliner.inline_local_functions(onnx.load(path))
        model = compose.add_prefix(model, "adopted/")
    except Exception as error:  # a parser can raise anything on garbled bytes
        raise ValueError(f"is no ONNX file, or lacks its weights: {first_line(error)}") from error
    if any(entry.key == "format" for entry in model.metadata_props):
        raise ValueError("is an agent's file already")
    graph = model.graph
    weights = {tensor.name for tensor in graph.initializer}
    inputs, outputs = (
        [value for value in graph.input if value.name not in weights],
        list(graph.output),
    )
    if not len(inputs) == len(outputs) in (1, 2):
        found = f"{len(inputs)} inputs and {len(outputs)} outputs"
        raise ValueError(
            f"has {found}, but must have an observation and an action, and besides a memory each or none"
        )
    batch = next((axis.dim_value for axis in inputs[0].type.tensor_type.shape.dim), 0)  # 0: any
    memory = _size(inputs[1], None) if len(inputs) == 2 else None
    sizes = ((len(about.observation_space.low), len(about.action_space.low)), (memory, memory))
    del graph.input[:], graph.output[:], graph.value_info[:]
    node, value_info = helper.make_node, helper.make_tensor_value_info
    first, last = (
        [],
        [
            node("Constant", [], [name], value_float=value)
            for name, value in (("low", -1.0), ("high", 1.0))
        ],
    )
    for given, made, names, (in_size, out_size) in zip(
        inputs, outputs, _NAMES, sizes, strict=False
    ):
        graph.input.append(
            value_info(names[0], onnx.TensorProto.FLOAT, ["environments", _size(given, in_size)])
        )
        graph.output.append(
            value_info(names[1], onnx.TensorProto.FLOAT, ["environments", _size(made, out_size)])
        )
        first.append(node("Cast", [names[0]], [given.name], to=given.type.tensor_type.elem_type))
        as_float = "unclipped" if names[1] == "action" else names[1]
        last.append(node("Cast", [made.name], [as_float], to=onnx.TensorProto.FLOAT))
    nodes = [*first, *graph.node, *last, node("Clip", ["unclipped", "low", "high"], ["action"])]
    del graph.node[:]
    graph.node.extend(nodes)
    used = {each.domain or "ai.onnx" for each in nodes}
    opsets = [opset for opset in model.opset_import if (opset.domain or "ai.onnx") in used]
    del model.opset_import[:]
    model.opset_import.extend(opsets)
    content = with_properties(model, about)
    memory_size = agent_file.checked(content).memory_size
    try:
        tried(content, *sizes[0], memory_size)
    except ValueError as error:
        if not batch:
            raise
        fixed = f"was written for a batch of {batch} and cannot act on others: export it with a dynamic first axis"
        raise ValueError(f"{fixed} ({error})") from error
    return content


_NAMES = (("observation", "action"), ("memory", "next_memory"))


def _size(value: onnx.ValueInfoProto, expected: int | None) -> int:
    """Return the entries per environment of an input or an output, which may leave them open if they are known."""
    name, axes = value.name.removeprefix("adopted/"), value.type.tensor_type.shape.dim
    found = axes[-1].dim_value if len(axes) == 2 and axes[-1].HasField("dim_value") else None
    if (
        len(axes) not in (0, 2)
        or (found or expected) is None
        or found not in (None, expected or found)
    ):
        shape = [axis.dim_value or axis.dim_param or "?" for axis in axes]
        raise ValueError(
            f"{name!r} has shape {shape}, but must have (number of environments, {expected or 'entries'})"
        )
    return found or expected or 0


def with_properties(model: onnx.ModelProto, about: Metadata) -> bytes:
    """Return the content of a network's file, with its metadata in place of any other.

    Stack traces, file names of the exporting machine and shapes that follow from the rest are removed.
    """
    graph = model.graph
    for part in (model, graph, *graph.node, *graph.initializer, *graph.input, *graph.output):
        part.ClearField("doc_string")
        part.ClearField("metadata_props")
    del graph.value_info[:]
    helper.set_model_props(model, about.properties())
    return bytes(model.SerializeToString(deterministic=True))


_MODELS = {
    "sb3_contrib.common.recurrent.policies": ("sb3_contrib", "RecurrentPPO"),
    "clip_range": ("stable_baselines3", "PPO"),
    "gae_lambda": ("stable_baselines3", "A2C"),
    "policy_delay": ("stable_baselines3", "TD3"),
    "top_quantiles_to_drop_per_net": ("sb3_contrib", "TQC"),
    "target_entropy": ("stable_baselines3", "SAC"),
}
"""Classes of models by a text that their files hold; the first that fits is right."""


class ModuleActor(Actor):
    """A module from observations to actions, which are clipped to -1..1.

    A module with an attribute ``memory_size`` above 0 has the interface of ``Actor``: it also takes and returns a memory.
    """

    def __init__(self, module: torch.nn.Module) -> None:
        super().__init__()
        self.module = copy.deepcopy(module).cpu().float().eval()
        self.memory_size = getattr(module, "memory_size", 0)

    def forward(
        self, observation: torch.Tensor, memory: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        action, memory = (
            self.module(observation, memory)
            if self.memory_size
            else (self.module(observation), memory)
        )
        return action.clamp(-1.0, 1.0), memory


def _network(name: str, policy: Any) -> torch.nn.Module:
    """Return the network from observations to the most likely actions of a policy of Stable-Baselines3."""
    if name == "RecurrentPPO":
        return RecurrentActor(policy)
    if name in ("PPO", "A2C"):
        end = [torch.nn.Tanh()] if policy.squash_output else []
        return torch.nn.Sequential(
            policy.pi_features_extractor, policy.mlp_extractor.policy_net, policy.action_net, *end
        )
    actor = policy.actor
    layers = [actor.mu] if name == "TD3" else [actor.latent_pi, actor.mu, torch.nn.Tanh()]
    return torch.nn.Sequential(actor.features_extractor, *layers)


class NormalisedActor(Actor):
    """An actor that sees observations normalised by the statistics of Stable-Baselines3's ``VecNormalize``."""

    mean: torch.Tensor
    deviation: torch.Tensor

    def __init__(self, actor: Actor, statistics: Any) -> None:
        super().__init__()
        self.actor = actor
        self.memory_size = actor.memory_size
        self.clip = float(statistics.clip_obs)
        moments = statistics.obs_rms
        self.register_buffer("mean", torch.as_tensor(moments.mean, dtype=torch.float32))
        self.register_buffer(
            "deviation",
            torch.as_tensor(moments.var + statistics.epsilon, dtype=torch.float32).sqrt(),
        )

    def forward(
        self, observation: torch.Tensor, memory: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        normalised = ((observation - self.mean) / self.deviation).clamp(-self.clip, self.clip)
        action, memory = self.actor(normalised, memory)
        return action, memory


def read_statistics(path: Path) -> Any:
    """Read the statistics that ``VecNormalize.save`` has written, a pickle of one's own; ValueError if it holds none."""
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
            f"{path} holds a {type(statistics).__name__}, but must hold what VecNormalize.save has written"
        )
    return statistics


def sb3_actor(path: Path, run: Run, statistics: Path | None = None) -> tuple[Run, Actor]:
    """Return the training and the actor of a model of Stable-Baselines3 or sb3-contrib; ValueError if it cannot be exported.

    The run is one elsewhere on the environment, to which algorithm, steps and perhaps the belief are added. ``statistics`` is the
    file of ``VecNormalize``, without which a model that was trained with it is refused.
    """
    warn_of_pickle(path)
    try:
        with zipfile.ZipFile(path) as archive:
            data = archive.read("data").decode()
        package, name = next(model for mark, model in _MODELS.items() if f'"{mark}"' in data)
    except (KeyError, ValueError, StopIteration, zipfile.BadZipFile) as error:
        known = ", ".join(name for _, name in _MODELS.values())
        raise ValueError(
            f"is no model of Stable-Baselines3; those that can be exported are {known}"
        ) from error
    try:
        model: Any = getattr(importlib.import_module(package), name).load(path, device="cpu")
    except Exception as error:  # garbled bytes can raise anything
        raise ValueError(f"cannot be loaded as {name} of {package}: {error}") from error
    plain = run.parameters | {"total_timesteps": int(model.num_timesteps)}
    choices = (plain, plain | {"belief": True})
    spaces = [seen_space(run.env_id, run.scenario, each) for each in choices]
    if model.observation_space not in spaces:
        raise ValueError(
            f"was trained on observations of shape {model.observation_space.shape} or other bounds, but {run.env_id} has "
            f"{spaces[0].shape}, with a belief {spaces[1].shape}: state the --env and --scenario of its training"
        )
    parameters = choices[spaces.index(model.observation_space)]
    if model.action_space != (actions := action_space(run.scenario)):
        raise ValueError(
            f"was trained on the action space {model.action_space}, but that of {run.env_id} is {actions}"
        )
    network = _network(name, model.policy)
    actor: Actor = network if isinstance(network, Actor) else ModuleActor(network)
    if statistics is not None:
        actor = _normalised(
            actor, read_statistics(statistics), statistics, model.observation_space.shape
        )
    elif was_normalised(model):
        raise ValueError(
            "was trained with VecNormalize, whose statistics the file does not hold: save them in the training by "
            "model.get_vec_normalize_env().save('statistics.pkl'), and add --statistics statistics.pkl"
        )
    return replace(run, algorithm=name.lower(), parameters=parameters), actor.eval()


def _normalised(actor: Actor, statistics: Any, path: Path, shape: tuple[int, ...]) -> Actor:
    """Return an actor that normalises its observations, unless the statistics are of rewards alone."""
    if not statistics.norm_obs:
        return actor
    if np.shape(statistics.obs_rms.mean) != shape:
        found = np.shape(statistics.obs_rms.mean)
        raise ValueError(
            f"was trained on observations of shape {shape}, but the statistics in {path} are of shape {found}"
        )
    return NormalisedActor(actor, statistics)
