"""Convert functions, models, modules and ONNX files to policies."""

import pkgutil
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import NDArray

from turning_env.scoring.policy import Actions, Observations, Policy, PolicyFactory
from turning_env.scoring.sandbox import LIMITS, AgentFileError, Limits, load
from turning_env.scoring.sb3_observations import ADVICE, normalisation


def as_factory(
    policy: Any, limits: Limits = LIMITS, space: Space[Any] | None = None
) -> PolicyFactory:
    """Return a function that makes the policy for a number of environments.

    ``turning_env.score`` lists the accepted kinds: TypeError if it is none. An ONNX file plays in a process of its own within
    ``limits``; AgentFileError, a ValueError, says why it cannot. All else runs in this process. ``space`` is that of the
    observations, if it is known: a model of Stable-Baselines3 that was trained on another is refused.
    """
    if isinstance(policy, str) and re.fullmatch(r"[\w.]+:[\w.]+", policy):
        try:
            policy = pkgutil.resolve_name(policy)
        except (AttributeError, ModuleNotFoundError) as error:
            raise ValueError(
                f"cannot be imported from this folder or the installed packages: {error}"
            ) from error
    if isinstance(policy, str | Path):
        return _onnx(Path(policy), limits)
    if isinstance(policy, type):
        policy = policy()
    if hasattr(policy, "act"):
        return lambda num_envs: policy if hasattr(policy, "reset") else _Function(policy.act)
    if hasattr(policy, "predict"):
        return lambda num_envs: _Predicts(policy, space)
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
    """A model of Stable-Baselines3 or sb3-contrib, with or without memory, and with the statistics of ``VecNormalize``."""

    model: Any
    space: Space[Any] | None  # of the observations that it will see
    _memory: Any = None
    _starts: Any = False
    _statistics: Any = None
    _is_checked: bool = False

    def _check(self, observations: Observations) -> None:
        """Raise ValueError if the model was trained on other observations than these."""
        trained = self.model.observation_space
        if trained.shape != observations.shape[1:]:
            raise ValueError(
                f"the model was trained on observations of {trained.shape[0]} entries, but these have {observations.shape[1]}: "
                "play the id or family of its training; export a model with a belief by train.export; or give a function of these"
            )
        self._statistics = normalisation(self.model)
        if self.space is not None and not _same_bounds(trained, self.space):
            raise ValueError(
                "the model was trained on observations of other bounds, as a wrapper such as NormalizeObservation, or another "
                f"scenario, gives: play the id or family of its training, or {ADVICE}"
            )
        self._is_checked = True

    def reset(self, mask: NDArray[np.bool_]) -> None:
        self._starts = mask | self._starts

    def act(self, observations: Observations) -> Actions:
        if not self._is_checked:
            self._check(observations)
        if self._statistics is not None:
            observations = self._statistics.normalize_obs(observations)
        actions, self._memory = self.model.predict(
            observations, self._memory, self._starts, deterministic=True
        )
        self._starts = np.zeros(len(observations), np.bool_)
        return np.asarray(actions, np.float32)


def _same_bounds(one: Any, other: Any) -> bool:
    """Return whether a space of the same shape has the same bounds."""
    return isinstance(one, Box) and bool(
        np.allclose(one.low, other.low) and np.allclose(one.high, other.high)
    )


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
            raise AgentFileError(
                f"{error}: give the loaded model, or a file by python -m train.export in a clone"
            ) from error
        raise
