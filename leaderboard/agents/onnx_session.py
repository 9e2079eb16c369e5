"""Run the network of an ONNX file, so that its actions are reproducible to the last bit.

It runs on one thread and in a fixed order. A process that runs strangers' networks
(``sandbox_child.py``) imports this file without the rest of the package.
"""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

EXPORT = "export it with a dynamic batch axis and float32"
"""Advice on a network whose inputs or outputs have another type, or a fixed batch."""


class OnnxPolicy:
    """The policy of an ONNX file for ``num_envs`` environments."""

    def __init__(self, session: Any, memory_size: int, num_envs: int) -> None:
        self._session = session
        self.memory = np.zeros((num_envs, memory_size), np.float32)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Clear the memory of the environments in the mask, shape (num_envs,)."""
        self.memory = np.where(mask[:, None], np.float32(0.0), self.memory)

    def act(self, observations: Floats) -> Floats:
        """Return actions, shape (num_envs, actions), for observations, shape (num_envs, entries).

        Both are float32. Raise ValueError if the network cannot act.
        """
        actions, self.memory = self.run(observations, self.memory)
        return actions

    def run(self, observations: Floats, memory: Floats) -> tuple[Floats, Floats]:
        """Return the actions and the next memory; leave the policy's own memory as it is.

        Raise ValueError if the network cannot act, or returns other numbers of rows.
        """
        inputs = {"observation": observations}
        if memory.shape[1]:
            inputs["memory"] = memory
        try:
            results = self._session.run(None, inputs)
        except Exception as error:  # ONNX Runtime's errors have no common type
            reason = first_line(error)
            if "allocate" in reason:
                raise ValueError(f"needs more memory than it may have: {reason}") from error
            shape = observations.shape
            raise ValueError(f"cannot act on observations of shape {shape}: {reason}") from error
        names = [output.name for output in self._session.get_outputs()]
        outputs = dict(zip(names, results, strict=True))
        actions: Floats = outputs["action"]
        next_memory: Floats = outputs.get("next_memory", memory)
        num_envs = len(observations)
        if len(actions) != num_envs or len(next_memory) != num_envs:
            raise ValueError(
                f"gives {len(actions)} actions and {len(next_memory)} memories "
                f"for {num_envs} environments"
            )
        return actions, next_memory


def runtime() -> Any:
    """Import ONNX Runtime without telemetry, which is on by default from version 1.31."""
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime  # type: ignore[import-untyped]

    return onnxruntime


def session_of(source: bytes | str) -> Any:
    """Return ONNX Runtime's session of a file's content or path; ValueError if it cannot be run."""
    onnxruntime = runtime()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = 4  # errors are raised
    try:
        return onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's errors have no common type
        raise ValueError(f"cannot be run: {first_line(error)}") from error


def check_inputs(session: Any) -> None:
    """Raise ValueError unless every input is float32, for any number of environments."""
    for node in session.get_inputs():
        # An input whose number of axes is not known has none here.
        axes = list(node.shape or ())
        is_fixed = bool(axes) and isinstance(axes[0], int)
        if node.type != "tensor(float)" or len(axes) not in (0, 2) or is_fixed:
            raise ValueError(
                f"takes {node.name!r} as {node.type} of shape {axes}, but must take float32 of "
                f"shape (any number of environments, entries): {EXPORT}"
            )


def check_actions(actions: Floats, shape: tuple[int, int]) -> None:
    """Raise ValueError unless actions have the shape and lie in -1 to 1."""
    # The comparison is written so that NaN fails it.
    if actions.shape == shape and actions.dtype == np.float32 and (np.abs(actions) <= 1.0).all():
        return
    wrong = actions
    if actions.shape == shape:
        wrong = actions[~(np.abs(actions) <= 1.0).all(axis=1)]
    raise ValueError(
        f"acts {wrong[:1].tolist()}, "
        f"which are not {shape[0]} actions of {shape[1]} numbers in -1 to 1"
    )


def first_line(error: BaseException) -> str:
    """Return an error's first line, with unprintable characters replaced."""
    lines = str(error).strip().splitlines()
    line = lines[0] if lines else type(error).__name__
    return "".join(character if character.isprintable() else "?" for character in line[:500])
