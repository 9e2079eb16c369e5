"""Convert functions, models, modules and ONNX files to policies."""

import pkgutil
import re
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import NDArray

from baselines.policy_spec import PolicySpec
from leaderboard.agents.agent_file import Metadata
from leaderboard.agents.sandbox import LIMITS, AgentFileError, ProcessLimits, load
from leaderboard.inputs import Inputs
from leaderboard.sb3_observations import ADVICE, normalisation
from leaderboard.torch_module import ModulePolicy, is_module
from turning_env.policy import Actions, Observations, Policy, PolicyFactory

MAX_PARTS = 4  # parts of a tuple that an error lists


def as_factory(
    policy: Any, limits: ProcessLimits = LIMITS, space: Space[Any] | None = None
) -> PolicyFactory:
    """Return a function that makes the policy for a number of environments.

    Args:
        policy: one of the kinds that ``leaderboard.score`` lists, or the name ``module:object`` of
            one. An ONNX file plays in a process of its own; all else runs in this process.
        limits: limits of an ONNX file's process.
        space: that of the observations, if it is known: a model of Stable-Baselines3 that was
            trained on another is refused.

    Raises:
        TypeError: if the policy is of none of these kinds.
        ValueError: if there is no such object, or the name is that of a Python file.
        AgentFileError: a ValueError, which says why an ONNX file cannot play.
    """
    _refuse_python_file(policy)
    if isinstance(policy, str) and re.fullmatch(r"[\w.]+:[\w.]+", policy):
        policy = _imported(policy)
    if isinstance(policy, str | Path):
        return _onnx(Path(policy), limits)
    if isinstance(policy, PolicySpec):
        return policy.make
    if isinstance(policy, type):
        policy = _made(policy)
    if hasattr(policy, "act"):
        if hasattr(policy, "reset"):
            return lambda num_envs: _Object(policy)
        return lambda num_envs: _Function(policy.act)
    if hasattr(policy, "predict") and hasattr(policy, "observation_space"):
        return lambda num_envs: _Model(policy, space)
    if is_module(policy):
        return lambda num_envs: ModulePolicy(policy, num_envs)
    if callable(policy):
        return lambda num_envs: _Function(policy)
    raise TypeError(
        f"{_kind(policy)} is no policy: give a function of observations, an object with "
        "reset and act, a model of Stable-Baselines3, a module of PyTorch, or the path of an ONNX "
        "file"
    )


def place_in_module(error: BaseException, name: str | None) -> str:
    """Return where the module of the policy ``module:object`` raised an error.

    Such as " (my_policy.py, line 3)". It is empty if the error has not passed through this module.
    """
    module = (name or "").partition(":")[0]
    place = ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        if frame.f_globals.get("__name__") == module:
            place = f" ({Path(frame.f_code.co_filename).name}, line {line})"
    return place


def _refuse_python_file(policy: Any) -> None:
    """Raise ValueError if a policy is the name of a Python file, with or without an object."""
    if not isinstance(policy, str | Path):
        return
    file, _, name = str(policy).partition(":")
    if file.endswith(".py"):
        module = Path(file).stem
        raise ValueError(f"give module:object, such as {module}:{name or 'policy'}")


def _imported(name: str) -> Any:
    """Return the object with a name such as ``module:object``."""
    try:
        return pkgutil.resolve_name(name)
    except (AttributeError, ModuleNotFoundError) as error:
        raise ValueError(
            f"cannot be imported from this folder or the installed packages: {error}"
        ) from error


def _made(kind: type) -> Any:
    """Return an object of a class."""
    try:
        return kind()
    except TypeError as error:
        raise TypeError(
            f"give an object of {kind.__name__}: made without arguments, {error}"
        ) from error


@dataclass
class _Function(Policy):
    """A function of observations."""

    function: Callable[[Observations], Any]

    def act(self, observations: Observations) -> Actions:
        actions = self.function(observations)
        _check_actions(actions, len(observations))
        return np.asarray(np.clip(np.asarray(actions, np.float32), -1.0, 1.0))


@dataclass
class _Object:
    """An object with ``reset`` and ``act``, whose actions are checked."""

    policy: Any

    def reset(self, mask: NDArray[np.bool_]) -> None:
        self.policy.reset(mask)

    def act(self, observations: Observations) -> Actions:
        actions: Actions = self.policy.act(observations)
        _check_actions(actions, len(observations))
        return actions


def _check_actions(actions: Any, num_envs: int) -> None:
    """Raise ValueError if a policy returns no array of actions, with a row per environment.

    The environment checks the rest: how many numbers an action has, and that they are finite.
    """
    try:
        shape = np.shape(actions)
    except ValueError:  # the parts of a tuple have different shapes
        shape = ()
    if len(shape) == 2 and shape[0] == num_envs:
        return
    advice = ""
    if isinstance(actions, tuple):
        advice = (
            ": predict of Stable-Baselines3 returns actions and a state, so give the model itself, "
            "or lambda observations: model.predict(observations, deterministic=True)[0]"
        )
    raise ValueError(
        f"the policy returned {_kind(actions)}, but must return an array of actions in -1..1, of "
        f"shape ({num_envs}, numbers of an action){advice}"
    )


def _kind(value: Any) -> str:
    """Return what an object is."""
    if value is None:
        return "None"
    if isinstance(value, tuple):
        return f"a tuple ({', '.join(type(part).__name__ for part in value[:MAX_PARTS])})"
    shape = getattr(value, "shape", None)
    if shape is None:
        return f"an object of type {type(value).__name__}"
    return f"an array of shape {tuple(shape)}"


@dataclass
class _Model:
    """A model of Stable-Baselines3 or sb3-contrib, with or without memory.

    The statistics of ``VecNormalize``, if it was trained with them, normalise its observations.
    """

    model: Any
    space: Space[Any] | None  # of the observations that it will see
    _memory: Any = None
    _starts: Any = False
    _statistics: Any = None
    _is_checked: bool = False

    def _check(self, observations: Observations) -> None:
        """Raise ValueError if the model was trained on other observations than these."""
        trained = self.model.observation_space
        if not isinstance(trained, Box):
            raise ValueError(
                f"the model was trained on observations of the kind {type(trained).__name__}, "
                "but these are arrays: give a function, such as lambda observations: "
                "model.predict(wrapper.observation(observations), deterministic=True)[0]"
            )
        # A wrapper that changed the observations is a better reason than their shape.
        self._statistics = normalisation(self.model)
        if trained.shape != observations.shape[1:]:
            raise ValueError(
                f"the model was trained on observations of {trained.shape[0]} entries, "
                f"but these have {observations.shape[1]}: play the id or family of its training; "
                "export a model with a belief by train.export; or give a function of these"
            )
        actions = self.model.action_space
        if not isinstance(actions, Box) or not _same_bounds(actions, Box(-1.0, 1.0, actions.shape)):
            raise ValueError(
                f"the model was trained on the actions {actions}, as a wrapper such as "
                "RescaleAction gives, but these are in -1..1: give a function that changes "
                "actions likewise"
            )
        if self.space is not None and not _same_bounds(trained, self.space):
            raise ValueError(
                "the model was trained on observations of other bounds, as a wrapper such as "
                "NormalizeObservation, or another scenario, gives: "
                f"play the id or family of its training, or {ADVICE}"
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


def _same_bounds(space: Any, expected: Any) -> bool:
    """Return whether a space of the same shape has the same bounds."""
    if not isinstance(space, Box):
        return False
    same_low = np.allclose(space.low, expected.low)
    same_high = np.allclose(space.high, expected.high)
    return bool(same_low and same_high)


def _onnx(path: Path, limits: ProcessLimits) -> PolicyFactory:
    if path.is_dir():
        raise ValueError(
            "is a folder: give an ONNX file, such as python -m train.export writes of a training"
        )
    try:
        maker = load(path, limits)
    except FileNotFoundError as error:
        if not path.suffix:
            raise ValueError("no such file: give an ONNX file, or module:object") from error
        raise
    except AgentFileError as error:
        if path.suffix == ".zip":
            raise AgentFileError(
                f"{error}: give the loaded model, or a file by python -m train.export in a clone"
            ) from error
        raise
    _check_plays_alone(path, maker.properties)
    return maker


def _check_plays_alone(path: Path, properties: dict[str, str]) -> None:
    """Raise AgentFileError if a file states that wrappers belong around its network."""
    try:
        metadata = Metadata.of(properties)
    except ValueError:
        return  # a file that ``train.export`` has not written states nothing
    wrappers = Inputs.of(metadata.parameters).wrappers
    if wrappers:
        raise AgentFileError(
            f"{path}: states {' and '.join(wrappers)}, which score does not put around a network: "
            "python -m leaderboard run --agents does"
        )
