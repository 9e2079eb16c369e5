"""Convert functions, models, modules and ONNX files to policies."""

import pkgutil
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from errno import ENOENT
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env.scoring.onnx_session import OnnxPolicy, session_of
from turning_env.scoring.policy import Actions, Observations, Policy, PolicyFactory


def as_factory(policy: Any) -> PolicyFactory:
    """Return a function that makes the policy for a number of environments.

    ``turning_env.score`` lists the accepted kinds: TypeError if it is none, ValueError if a file has other inputs or outputs.
    """
    if isinstance(policy, str) and re.fullmatch(r"[\w.]+:[\w.]+", policy):
        try:
            policy = pkgutil.resolve_name(policy)
        except (AttributeError, ModuleNotFoundError) as error:
            raise ValueError(f"cannot be imported from this folder or the installed packages: {error}") from error
    if isinstance(policy, str | Path):
        return _onnx(Path(policy))
    if isinstance(policy, type):
        policy = policy()
    if hasattr(policy, "act"):
        return lambda num_envs: policy if hasattr(policy, "reset") else _Function(policy.act)
    if hasattr(policy, "predict"):
        return lambda num_envs: _Predicts(policy)
    torch = sys.modules.get("torch")
    if torch is not None and isinstance(policy, torch.nn.Module):
        return lambda num_envs: _Function(_module(torch, policy))
    if callable(policy):
        return lambda num_envs: _Function(policy)
    raise TypeError(
        f"a {type(policy).__name__} is no policy: give a function of observations, an object with reset and act, a model of "
        "Stable-Baselines3, a module of PyTorch, or the path of an ONNX file"
    )


@dataclass
class _Function(Policy):
    """A function of observations."""

    function: Callable[[Observations], Any]

    def act(self, observations: Observations) -> Actions:
        return np.asarray(np.clip(np.asarray(self.function(observations), np.float32), -1.0, 1.0))


@dataclass
class _Predicts:
    """A model of Stable-Baselines3 or sb3-contrib, with or without memory."""

    model: Any
    _memory: Any = None
    _starts: Any = False

    def reset(self, mask: NDArray[np.bool_]) -> None:
        self._starts = mask | self._starts

    def act(self, observations: Observations) -> Actions:
        if (trained := self.model.observation_space.shape) != observations.shape[1:]:
            raise ValueError(
                f"the model was trained on observations of {trained[0]} entries, but these have {observations.shape[1]}: play "
                "the id or family of its training; export a model with a belief by train.export; or give a function of these"
            )
        actions, self._memory = self.model.predict(observations, self._memory, self._starts, deterministic=True)
        self._starts = np.zeros(len(observations), np.bool_)
        return np.asarray(actions, np.float32)


def _module(torch: Any, module: Any) -> Callable[[Observations], Any]:
    """Return a function of arrays that runs a module of PyTorch."""
    device = next((parameter.device for parameter in module.parameters()), "cpu")

    def run(observations: Observations) -> Any:
        with torch.no_grad():
            return module(torch.as_tensor(observations, device=device)).cpu().numpy()

    return run


def _onnx(path: Path) -> PolicyFactory:
    if not path.is_file():
        raise FileNotFoundError(ENOENT, "no such file", str(path))
    try:
        session = session_of(str(path))  # by its path, as the weights may lie in a file beside it
    except ValueError as error:
        hint = ": give the loaded model, or a file by python -m train.export in a clone" if path.suffix == ".zip" else ""
        raise ValueError(f"{path} {error}{hint}") from error
    inputs = {each.name: each.shape for each in session.get_inputs()}
    outputs = {each.name for each in session.get_outputs()}
    if (set(inputs), outputs) not in (({"observation"}, {"action"}), ({"observation", "memory"}, {"action", "next_memory"})):
        raise ValueError(
            f"{path} maps {', '.join(inputs)} to {', '.join(sorted(outputs))}, but must have the input observation and "
            "the output action; with a memory, also the input memory and the output next_memory"
        )

    memory_size = inputs["memory"][-1] if "memory" in inputs else 0
    return lambda num_envs: OnnxPolicy(session, memory_size, num_envs)
