"""Keeps strangers' networks in processes of their own: see ``onnx_child.py`` for what such a process may do.

This side sends observations and takes actions, which it checks, and waits for no answer longer than it says. It never looks into
the file itself.
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
from train.agents import wire as onnx_wire
from train.agents.agent_file import AgentFile
from train.agents.graph import MAX_BYTES, MAX_METADATA, Outline
from train.agents.sandbox_child import CHECK, PLAY
from train.agents.session import check_actions
from train.agents.wire import Wire
from turning_env.score.policy import Actions, Observations

_PROGRAM = """
import os, sys
sys.path.insert(0, sys.argv[1])
from train.agents.sandbox_child import main
main(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))
os._exit(0)  # nothing is to be tidied up, by libraries that can open nothing
"""
_MAX_OUTLINE = 6 * MAX_METADATA + 1_000_000  # bytes: JSON may need six for a character
_MAX_SAID = 2_000
_KEPT_VARIABLES = ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT")
_OUTLINE = TypeAdapter(Outline)


@dataclass(frozen=True)
class Limits:
    """What a network may use."""

    answer: float = 60.0
    """Time until an answer [s], by the clock: generous, as the machine may be busy otherwise."""
    start: float = 120.0
    """Time until its process is ready, likewise."""
    computing: int = 3600
    """Processor time altogether [s]."""
    memory: int = 3072
    """Memory [MiB], ONNX Runtime's own included."""


LIMITS = Limits()


class Child:
    """A process for one file. It is ended when this object is no longer used.

    Args:
        purpose: ``onnx_child.CHECK`` or ``onnx_child.PLAY``.
        limits: what it may use.
    """

    def __init__(self, purpose: str, limits: Limits) -> None:
        self._limits = limits
        ours, its = socket.socketpair()
        root = str(Path(__file__).parents[2])
        arguments = [root, purpose, str(limits.memory), str(limits.computing)]
        kept = {name: os.environ[name] for name in _KEPT_VARIABLES if name in os.environ}
        with its:
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-c", _PROGRAM, *arguments],
                stdin=its.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=kept | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                start_new_session=True,  # an interruption is for the process that waits to handle
            )
        self._wire = Wire(ours, limits.start)
        self.close = weakref.finalize(self, _end, self._process, self._wire)

    def send(self, kind: bytes, content: bytes = b"") -> None:
        """Tell it something.

        Raises:
            ValueError: it is gone, or does not listen.
        """
        try:
            self._wire.send(kind, content)
        except OSError as error:
            raise ValueError(self._what_happened()) from error

    def answer(self, most: int, starting: bool = False) -> bytes:
        """What it says, at most so many bytes; it may take longer where it is still ``starting``.

        Raises:
            ValueError: it says why it cannot, nothing in time, or is gone.
        """
        patience = self._limits.start if starting else self._limits.answer
        try:
            kind, content = self._wire.receive(max(most, _MAX_SAID), patience)
        except TimeoutError as error:
            self.close()
            raise ValueError(f"gives no answer within {patience:g} s") from error
        except (OSError, EOFError) as error:
            raise ValueError(self._what_happened()) from error
        if kind == onnx_wire.ANSWER and len(content) <= most:
            return content
        said = "".join(each if each.isprintable() else "?" for each in content[:_MAX_SAID].decode("utf-8", "replace"))
        raise ValueError(said if kind == onnx_wire.ERROR else "gives an answer to nothing that was asked")

    def _what_happened(self) -> str:
        try:
            status = self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            status = 0
        self.close()
        if status == -signal.SIGXCPU:
            return f"needs more than the {self._limits.computing} s of processor time that it may have"
        return f"its process has ended (status {status}), perhaps for more than the {self._limits.memory} MiB of memory allowed"


def _end(process: "subprocess.Popen[bytes]", wire: Wire) -> None:
    wire.close()
    process.kill()
    process.wait()


class GuardedPolicy:
    """An agent's file that controls ``lanes`` lanes from a process of its own.

    Raises:
        ValueError: the network cannot be run within the limits.
    """

    def __init__(self, file: AgentFile, num_envs: int, limits: Limits = LIMITS) -> None:
        spaces = file.metadata.observation_space, file.metadata.action_space
        self._given, self._wanted = ((num_envs, len(space.low)) for space in spaces)
        self._child = Child(PLAY, limits)
        self._child.send(onnx_wire.CONTENT, file.content)
        self._child.send(onnx_wire.LANES, np.array([*self._given, file.memory_size], np.int64).tobytes())
        self._child.answer(0, starting=True)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget these lanes."""
        if mask.shape != self._given[:1] or mask.dtype != np.bool_:
            raise ValueError(f"lanes to forget must be bool of shape {self._given[:1]}, got {mask.dtype} of {mask.shape}")
        self._child.send(onnx_wire.RESET, mask.tobytes())

    def act(self, observations: Observations) -> Actions:
        """Actions for observations, both float32 and of one row per lane.

        Raises:
            ValueError: the observations are not of the shape or type that the agent takes; what it gives are not actions, or not
                always the same; it uses more than it may, or its process is gone.
        """
        if observations.shape != self._given or observations.dtype != np.float32:
            wanted = f"float32 of shape {self._given}, got {observations.dtype} of {observations.shape}"
            raise ValueError(f"the agent cannot act on these observations: they must be {wanted}")
        self._child.send(onnx_wire.ACT, observations.tobytes())
        size = 4 * self._wanted[0] * self._wanted[1]
        told = self._child.answer(size)
        if len(told) != size:
            raise ValueError(f"gives {len(told)} bytes, which are not actions of shape {self._wanted}")
        actions = np.frombuffer(told, np.float32).reshape(self._wanted).copy()
        check_actions(actions, self._wanted)
        return actions


def examined(content: bytes, limits: Limits = LIMITS) -> AgentFile:
    """The agent of a file's content, looked at and tried in a process of its own.

    Raises:
        ValueError: it is not an agent's file, or one that is not trusted; says why.
    """
    child = Child(CHECK, limits)
    try:
        child.send(onnx_wire.CONTENT, content[: MAX_BYTES + 1])
        try:
            outline = _OUTLINE.validate_json(child.answer(_MAX_OUTLINE, starting=True), strict=True)
        except ValidationError as error:
            raise ValueError("tells nothing of itself that can be understood") from error
        file = agent_file.of_outline(content, outline)
        child.send(onnx_wire.GO_ON)
        child.answer(0)
    finally:
        child.close()
    return file
