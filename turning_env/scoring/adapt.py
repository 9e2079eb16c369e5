"""Convert functions, models, modules and ONNX files to policies."""

import pkgutil
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env.scoring.policy import Actions, Observations, Policy, PolicyFactory
from turning_env.scoring.sandbox import LIMITS, AgentFileError, Limits, load


def as_factory(policy: Any, limits: Limits = LIMITS) -> PolicyFactory:
    """Return a function that makes the policy for a number of environments.

    ``turning_env.score`` lists the accepted kinds: TypeError if it is none. An ONNX file plays in a process of its own within
    ``limits``; AgentFileError, a ValueError, says why it cannot. All else runs in this process.
    """
    if isinstance(policy, str) and re.fullmatch(r"[\w.]+:[\w.]+", policy):
        try:
            policy = pkgutil.resolve_name(policy)
        except (AttributeError, ModuleNotFoundError) as error:
            raise ValueError(f"cannot be imported from this folder or the installed packages: {error}") from error
    if isinstance(policy, str | Path):
        return _onnx(Path(policy), limits)
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


def _onnx(path: Path, limits: Limits) -> PolicyFactory:
    try:
        return load(path, limits)
    except AgentFileError as error:
        if path.suffix == ".zip":
            raise AgentFileError(f"{error}: give the loaded model, or a file by python -m train.export in a clone") from error
        raise
