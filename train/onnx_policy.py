"""Plays an agent's ONNX file, with neither PyTorch nor Stable-Baselines3.

from pathlib import Path
from train import onnx_policy

agent = onnx_policy.load(Path("ppo-seed0.onnx"))
policy = agent.make(1)
"""

from pathlib import Path

import numpy as np
import onnxruntime  # type: ignore[import-untyped]
from numpy.typing import NDArray

from baselines.policy import Actions, Observations
from train import agent_file
from train.agent_file import AgentFile
from train.trained_agent import TrainedAgent


class OnnxPolicy:
    """An agent's file that controls ``lanes`` lanes, on one thread and in one order, so that it always acts alike."""

    def __init__(self, session: onnxruntime.InferenceSession, memory_size: int, lanes: int) -> None:
        self._session = session
        self._memory = np.zeros((lanes, memory_size), np.float32)

    def reset(self, lanes: NDArray[np.bool_]) -> None:
        """Forget these lanes."""
        if self._memory.shape[1]:
            self._memory = np.where(lanes[:, None], np.float32(0.0), self._memory)

    def act(self, observations: Observations) -> Actions:
        """Actions for observations, both float32 and of one row per lane.

        Raises:
            ValueError: the observations are not of the shape or the type that the agent takes.
        """
        fed = {"observation": observations}
        if self._memory.shape[1]:
            fed["memory"] = self._memory
        try:
            results = self._session.run(None, fed)
        except Exception as error:  # ONNX Runtime's are of no common type
            raise ValueError(f"the agent cannot act on these observations: {_first_line(error)}") from error
        found = dict(zip((output.name for output in self._session.get_outputs()), results, strict=True))
        if "next_memory" in found:
            self._memory = found["next_memory"]
        action: NDArray[np.float32] = found["action"]
        return action


class _Maker:
    """Makes policies of a file. To another process it travels as the file, as ONNX Runtime's sessions cannot."""

    def __init__(self, file: AgentFile) -> None:
        self._file = file
        self._session = session_of(file)

    def __call__(self, lanes: int) -> OnnxPolicy:
        return OnnxPolicy(self._session, self._file.memory_size, lanes)

    def __reduce__(self) -> tuple[type["_Maker"], tuple[AgentFile]]:
        return _Maker, (self._file,)


def load(path: Path) -> TrainedAgent:
    """Load an agent from its file, which may come from anywhere: it is checked, and can run no code.

    Raises:
        ValueError: it is not an agent's file, or one that is not trusted; says why.
        OSError: it cannot be read.
    """
    file = agent_file.read(path)
    try:
        make = _Maker(file)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    metadata = file.metadata
    return TrainedAgent(
        name=metadata.algorithm,
        seed=metadata.seed,
        env_id=metadata.env_id,
        scenario=metadata.scenario,
        command=metadata.command,
        parameters=metadata.parameters,
        trained_intervals=metadata.trained_intervals,
        digest=file.digest,
        make=make,
    )


def session_of(file: AgentFile) -> onnxruntime.InferenceSession:
    """ONNX Runtime's session of a file, having acted once.

    Raises:
        ValueError: ONNX Runtime cannot run it, or what it gives are not actions.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = 4  # what is wrong is raised
    try:
        session = onnxruntime.InferenceSession(file.content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime's are of no common type
        raise ValueError(f"cannot be run: {_first_line(error)}") from error
    space = file.metadata.action_space
    policy = OnnxPolicy(session, file.memory_size, 2)
    for _ in range(2):  # the second time with what it remembers
        actions = policy.act(np.zeros((2, len(file.metadata.observation_space.low)), np.float32))
        if actions.shape != (2, len(space.low)) or not np.all((space.low <= actions) & (actions <= space.high)):
            raise ValueError(f"acts {actions.tolist()}, which are not two actions in {space.low} to {space.high}")
    return session


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
