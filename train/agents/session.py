"""Run an agent's network, with neither PyTorch nor Stable-Baselines3. Only ``sandbox_child.py`` runs strangers' networks."""

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

TOLERANCE = 1e-4
"""Largest difference of an environment's action when other environments are in the batch: sums may be taken in another order."""
_NUM_ENVS = 8  # with which a network is tried


class OnnxPolicy:
    """The policy of an agent's file, for ``num_envs`` environments, on one thread and in a fixed order: reproducible."""

    def __init__(self, session: Any, memory_size: int, num_envs: int) -> None:
        self._session = session
        self._memory = np.zeros((num_envs, memory_size), np.float32)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the environments of the mask, shape (num_envs,)."""
        if self._memory.shape[1]:
            self._memory = np.where(mask[:, None], np.float32(0.0), self._memory)

    def act(self, observations: Floats) -> Floats:
        """Return actions, shape (num_envs, actions), for observations, shape (num_envs, entries); both float32.

        Raises:
            ValueError: the observations have another shape or type.
        """
        actions, self._memory = self._run(observations, self._memory)
        return actions

    def act_checked(self, observations: Floats, generator: np.random.Generator) -> Floats:
        """Act, and check that actions are reproducible and independent of the other environments in the batch.

        Raises:
            ValueError: they are not, or as for ``act``.
        """
        before = self._memory
        actions = self.act(observations)
        again, _ = self._run(observations, before)
        if again.tobytes() != actions.tobytes():
            raise ValueError("gives other actions for the same observations")
        if len(observations) > 1:
            for part in np.array_split(generator.permutation(len(observations)), 2):
                alone = self._run(observations[part], before[part])
                for mine, its in zip((actions, self._memory), alone, strict=True):
                    if not np.allclose(mine[part], its, rtol=TOLERANCE, atol=TOLERANCE, equal_nan=True):
                        raise ValueError("an environment's actions or memory depend on the other environments in the batch")
        return actions

    def _run(self, observations: Floats, memory: Floats) -> tuple[Floats, Floats]:
        """Return actions and the next memory."""
        fed = {"observation": observations}
        if memory.shape[1]:
            fed["memory"] = memory
        try:
            results = self._session.run(None, fed)
        except Exception as error:  # ONNX Runtime's have no common type
            raise ValueError(f"the agent cannot act on these observations: {first_line(error)}") from error
        found = dict(zip((output.name for output in self._session.get_outputs()), results, strict=True))
        action: Floats = found["action"]
        remembered: Floats = found.get("next_memory", memory)
        if len(action) != len(observations) or len(remembered) != len(observations):
            raise ValueError(f"gives {len(action)} actions and {len(remembered)} memories for {len(observations)} environments")
        return action, remembered


def runtime() -> Any:
    """Import ONNX Runtime without telemetry, which is on by default from version 1.31."""
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime  # type: ignore[import-untyped]

    return onnxruntime


def session_of(content: bytes) -> Any:
    """Return ONNX Runtime's session of a file's content.

    Raises:
        ValueError: ONNX Runtime cannot run it.
    """
    onnxruntime = runtime()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = 4  # errors are raised
    try:
        return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's have no common type
        raise ValueError(f"cannot be run: {first_line(error)}") from error


def tried(content: bytes, entries: int, actions: int, memory_size: int) -> Any:
    """Return the session of a file's content after a trial on zeros and on observations of order one.

    Raises:
        ValueError: ONNX Runtime cannot run it, its outputs are not actions, or they are not reproducible.
    """
    session, generator = session_of(content), np.random.default_rng(0)
    sampled = generator.uniform(-1.0, 1.0, (2, _NUM_ENVS, entries)).astype(np.float32)
    for given in (np.zeros((2, 2, entries), np.float32), sampled):
        policy = OnnxPolicy(session, memory_size, given.shape[1])
        for observations in given:  # the second time with a memory
            check_actions(policy.act_checked(observations, generator), (len(observations), actions))
    return session


def check_actions(actions: Floats, shape: tuple[int, int]) -> None:
    """Check that actions have the shape and lie in -1 to 1.

    Raises:
        ValueError: they are not.
    """
    if actions.shape != shape or actions.dtype != np.float32 or not (np.abs(actions) <= 1.0).all():
        wrong = actions[~(np.abs(actions) <= 1.0).all(axis=1)] if actions.shape == shape else actions
        many = f"{shape[0]} actions" if shape[0] != 2 else "two actions"
        raise ValueError(f"acts {wrong[:1].tolist()}, which are not {many} of {shape[1]} numbers in -1 to 1")


def first_line(error: BaseException) -> str:
    """Return an error's first line, with unprintable characters replaced."""
    line = (str(error).strip().splitlines() or [type(error).__name__])[0]
    return "".join(character if character.isprintable() else "?" for character in line[:500])
