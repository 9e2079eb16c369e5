"""Runs strangers' networks in processes of their own; ``sandbox_child.py`` says what such a process may do.

This side sends observations, receives and checks actions, and limits how long it waits. It never looks into the file itself.
"""

import os
import signal
import socket
import subprocess
import sys
import weakref
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from train.agents import agent_file
from train.agents import sandbox_child as child
from train.agents.agent_file import AgentFile
from train.agents.graph import MAX_BYTES, MAX_METADATA, Outline
from train.agents.trial import check_actions
from turning_env.scoring.policy import Actions, Observations

_IMPORTS = """
import os, sys, types
for name in ("train", "turning_env"):  # their own __init__.py would import the environment
    package = sys.modules[name] = types.ModuleType(name)
    package.__path__ = [os.path.join(sys.argv[1], name)]
from train.agents.sandbox_child import main
"""
_PROGRAM = f"""{_IMPORTS}
main(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
os._exit(0)  # skip the clean-up of libraries that can open nothing
"""
_MAX_OUTLINE = 6 * MAX_METADATA + 1_000_000  # bytes: JSON may need six for a character
_MAX_ERROR = 2_000  # bytes
_KEPT_VARIABLES = ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT")
_OUTLINE = TypeAdapter(Outline)


@dataclass(frozen=True)
class Limits:
    """What a network may use."""

    answer: float = 60.0
    """Wall-clock time until an answer [s]: generous, as the machine may be busy."""
    start: float = 120.0
    """Wall-clock time until its process is ready [s]."""
    computing: int = 600
    """Total processor time of one play of all its episodes [s]."""
    memory: int = 3072
    """Memory [MiB], including ONNX Runtime's own."""


LIMITS = Limits()


class TooSlow(ValueError):
    """A network needs more time than it may have."""


class Child:
    """A process for one file. It ends when this object is garbage-collected.

    Args:
        purpose: ``sandbox_child.CHECK`` or ``sandbox_child.PLAY``.
        limits: what it may use.
    """

    def __init__(self, purpose: str, limits: Limits) -> None:
        self._limits = limits
        ours, its = socket.socketpair()
        arguments = [str(Path(__file__).parents[2]), purpose, str(limits.memory), str(limits.computing)]
        kept = {name: os.environ[name] for name in _KEPT_VARIABLES if name in os.environ}
        with its:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-c", _PROGRAM, *arguments],
                stdin=its.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=kept | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                start_new_session=True,  # Ctrl-C is for the parent to handle
            )
        self._connection = child.Connection(ours, limits.start)
        self.close = weakref.finalize(self, _end, self._process, self._connection)

    def send(self, kind: bytes, content: bytes = b"") -> None:
        """Send a message.

        Raises:
            ValueError: the process is gone, or does not listen.
        """
        try:
            self._connection.send(kind, content)
        except OSError as error:
            raise self._end_reason() from error

    def answer(self, max_bytes: int, starting: bool = False) -> bytes:
        """Return its answer; ``starting`` allows the time of a start.

        Raises:
            ValueError: it answers with an error, with more than ``max_bytes`` or not in time, or is gone.
        """
        timeout = self._limits.start if starting else self._limits.answer
        try:
            kind, content = self._connection.receive(max(max_bytes, _MAX_ERROR), timeout)
        except TimeoutError as error:
            self.close()
            raise TooSlow(f"gives no answer within {timeout:g} s") from error
        except (OSError, EOFError) as error:
            raise self._end_reason() from error
        if kind == child.ANSWER and len(content) <= max_bytes:
            return content
        text = "".join(each if each.isprintable() else "?" for each in content[:_MAX_ERROR].decode("utf-8", "replace"))
        raise ValueError(text if kind == child.ERROR else "gives an answer to nothing that was asked")

    def _end_reason(self) -> ValueError:
        try:
            status = self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            status = 0
        self.close()
        if status == -signal.SIGXCPU:
            return TooSlow(f"needs more than the {self._limits.computing} s of processor time that it may have")
        why = f"perhaps for more than the {self._limits.memory} MiB of memory allowed"
        return ValueError(f"its process has ended (status {status}), {why}")


def _end(process: "subprocess.Popen[bytes]", connection: child.Connection) -> None:
    connection.close()
    process.kill()
    process.wait()


class GuardedPolicy:
    """The policy of an agent's file, for ``num_envs`` environments, run in a process of its own.

    Args:
        file: the agent.
        num_envs: number of environments.
        process: of this file, in which no other policy acts any more; None: a new one.
        limits: of a new process.

    Raises:
        ValueError: the network cannot be run within the limits.
    """

    def __init__(self, file: AgentFile, num_envs: int, limits: Limits = LIMITS, process: Child | None = None) -> None:
        spaces = file.metadata.observation_space, file.metadata.action_space
        self._observations, self._actions = ((num_envs, len(space.low)) for space in spaces)
        self.process = process or Child(child.PLAY, limits)
        if process is None:
            self.process.send(child.CONTENT, file.content)
        self.process.send(child.SIZES, np.array([*self._observations, file.memory_size], np.int64).tobytes())
        self.process.answer(0, starting=True)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the environments of the mask, shape (num_envs,)."""
        if mask.shape != self._observations[:1] or mask.dtype != np.bool_:
            raise ValueError(f"the mask must be bool of shape {self._observations[:1]}, got {mask.dtype} of {mask.shape}")
        self.process.send(child.RESET, mask.tobytes())

    def act(self, observations: Observations) -> Actions:
        """Return actions, shape (num_envs, actions), for observations, shape (num_envs, entries); both float32.

        Raises:
            ValueError: the observations have another shape or type; the answer is not actions, or not reproducible; the process
                exceeds its limits, or is gone.
        """
        if observations.shape != self._observations or observations.dtype != np.float32:
            wanted = f"float32 of shape {self._observations}, got {observations.dtype} of {observations.shape}"
            raise ValueError(f"the agent cannot act on these observations: they must be {wanted}")
        self.process.send(child.ACT, observations.tobytes())
        size = 4 * self._actions[0] * self._actions[1]
        content = self.process.answer(size)
        if len(content) != size:
            raise ValueError(f"gives {len(content)} bytes, which are not actions of shape {self._actions}")
        actions = np.frombuffer(content, np.float32).reshape(self._actions).copy()
        check_actions(actions, self._actions)
        return actions


def examined(content: bytes, limits: Limits = LIMITS) -> tuple[AgentFile, Child]:
    """Return the agent of a file's content, checked and tried in a process of its own, and that process.

    Raises:
        ValueError: it is not an agent's file, or one that is not trusted; says why.
    """
    process = Child(child.CHECK, limits)
    try:
        process.send(child.CONTENT, content[: MAX_BYTES + 1])
        try:
            outline = _OUTLINE.validate_json(process.answer(_MAX_OUTLINE, starting=True), strict=True)
        except ValidationError as error:
            raise ValueError("tells nothing of itself that can be understood") from error
        file = agent_file.of_outline(content, outline)
        process.send(child.GO_ON)
        process.answer(0)
    except BaseException:
        process.close()
        raise
    return file, process
