"""Modules of PyTorch as policies, with or without a memory.

A module takes observations (n, entries) and returns actions (n, actions). If it has an attribute
``memory_size`` above 0, it also takes a memory (n, memory_size), which is 0 before an episode's
first observation, and returns a tuple of the actions and the next memory. A module plays in
evaluation mode.
``train.export.export_torch`` writes the same modules as files.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turning_env.policy import Actions, Observations, Policy


class Output(NamedTuple):
    """The output of a module: tensors with a row for each environment."""

    actions: Any
    memory: Any  # None of a module without memory


def is_module(policy: Any) -> bool:
    """Return whether an object is a module of PyTorch."""
    # A module exists only if PyTorch has been imported, which takes long.
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(policy, torch.nn.Module)


def memory_size(module: Any) -> int:
    """Return the numbers per environment in a module's memory; 0 without a memory."""
    return int(getattr(module, "memory_size", 0))


def run(module: Any, observations: Any, memory: Any) -> Output:
    """Run a module on tensors; ``memory`` is ignored if the module has none.

    Raise ValueError if the module returns something else than the module's description says.
    """
    if memory_size(module):
        output = module(observations, memory)
        if not isinstance(output, tuple | list) or len(output) != 2:
            raise ValueError(
                f"{_name(module)} has a memory_size, but returns {_kind(output)}: "
                "it must return actions and the next memory"
            )
        actions, next_memory = output
    else:
        actions = module(observations)
        next_memory = None
    # ``ModulePolicy`` clips the actions, so any value that can be clipped will do.
    if not hasattr(actions, "clamp"):
        raise ValueError(
            f"{_name(module)} returns {_kind(actions)}, but must return a tensor of actions: wrap "
            "it in a module that does; if it has a memory, give it the attribute memory_size: the "
            "numbers per environment"
        )
    return Output(actions, next_memory)


def _check_memory(module: Any, next_memory: Any, memory: Any) -> None:
    """Raise ValueError if the next memory does not have the shape of the present one."""
    shape = getattr(next_memory, "shape", None)
    if shape == memory.shape:
        return
    returned = _kind(next_memory) if shape is None else f"one of shape {tuple(shape)}"
    raise ValueError(
        f"{_name(module)} must return a next memory of shape {tuple(memory.shape)}, as its "
        f"memory_size is {memory_size(module)}, but returns {returned}"
    )


@contextmanager
def evaluating(module: Any) -> Iterator[None]:
    """Put a module into evaluation mode, as its export does, and back at the end.

    In training mode, dropout would act at random, and batch normalisation would learn from the
    observations that score the module.
    """
    in_training = [part for part in module.modules() if part.training]
    module.eval()
    try:
        yield
    finally:
        for part in in_training:
            part.training = True


def _name(module: Any) -> str:
    return f"the module {type(module).__name__}"


def _kind(value: Any) -> str:
    if isinstance(value, tuple | list):
        return f"a {type(value).__name__} of {len(value)}"
    return f"a {type(value).__name__}"


class ModulePolicy(Policy):
    """A module in evaluation mode as a policy; actions are clipped to -1..1."""

    def __init__(self, module: Any, num_envs: int) -> None:
        self._torch: Any = sys.modules["torch"]
        self._module = module
        # Inputs go where the module's weights are, in their precision.
        weight = next(module.parameters(), None)
        self._tensor_kind: dict[str, Any] = {"device": "cpu", "dtype": self._torch.float32}
        if weight is not None:
            self._tensor_kind = {"device": weight.device, "dtype": weight.dtype}
        self._memory = self._torch.zeros((num_envs, memory_size(module)), **self._tensor_kind)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Clear the memory of the environments in the mask, shape (num_envs,)."""
        chosen = self._torch.as_tensor(mask, device=self._tensor_kind["device"])
        self._memory = self._memory.masked_fill(chosen[:, None], 0.0)

    def act(self, observations: Observations) -> Actions:
        """Return actions in -1..1, shape (num_envs, actions)."""
        with self._torch.no_grad(), evaluating(self._module):
            inputs = self._torch.as_tensor(observations, **self._tensor_kind)
            output = run(self._module, inputs, self._memory)
        if output.memory is not None:
            _check_memory(self._module, output.memory, self._memory)
            self._memory = output.memory
        return np.asarray(output.actions.clamp(-1.0, 1.0).cpu().numpy(), np.float32)
