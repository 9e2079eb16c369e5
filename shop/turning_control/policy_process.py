"""A policy file or a user's module in a process of its own, beside a machine in real time.

There it can neither stop the control's process nor write past it. ``in_own_process`` starts the
process; a policy that does not answer in time, fails or has ended raises an error in ``act``, which
the shield answers with the safe feed.

An ONNX file plays in the sandbox in which it is scored (``leaderboard/agents/sandbox.py``): the
same process, messages and confinement. Two things are different here, on purpose:

* **Real time.** In a score, a late answer is an error that ends the play. Here the next step comes
  whatever happens: the process goes on, the late answer is skipped, and only a process that has
  hung for long is ended.
* **A module** is the user's own Python code, which no list of system calls can confine: its process
  (``main``) may do what the user who started the control may do. It has the same messages, and
  keeps its connection away from what the code prints and reads.

The shield checks type, shape and numbers of the actions, of both kinds alike.
"""

import ctypes
import os
import signal
import socket
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from leaderboard.adapt import as_factory
from leaderboard.agents import messages, sandbox
from leaderboard.agents.child_process import ChildProcess
from leaderboard.agents.messages import ACT, ANSWER, ERROR, RESET, Connection
from leaderboard.agents.sandbox import ProcessLimits
from turning_env.policy import Actions, Observations, Policy, PolicyFactory

LOADING = 120.0  # time in which a policy must load and answer for the first time [s]
HUNG = 10.0  # time without an answer after which a policy's process is ended [s]
# Limits of an ONNX file. Its processor time is free, because a control runs for weeks.
FILE_LIMITS = ProcessLimits(answer=HUNG, start=LOADING, computing=0)
PROGRAM = """
import sys
from turning_control.policy_process import main
main(sys.argv[1], int(sys.argv[2]))
"""
MAX_ANSWER = 2**20  # largest message of a policy's process [bytes]
MAX_ERROR = 500  # length of an error's text [characters]
STDIN = 0
STDERR = 2


class PolicyEndedError(RuntimeError):
    """The policy's process has ended, or was ended because it hung."""


def in_own_process(name: str, deadline: float) -> PolicyFactory:
    """Return a function that starts a policy's process for a number of environments.

    The function raises ValueError if the policy cannot be loaded, and FileNotFoundError if there is
    no such file.

    Args:
        name: ``module:object``, or the path of an ONNX file.
        deadline: time in which ``act`` must be answered [s]. The first answer has as much time as
            loading.
    """

    def make(num_envs: int) -> RealTimePolicy:
        process: ChildProcess
        if name.endswith(".onnx"):
            process = sandbox.load(Path(name), FILE_LIMITS)(num_envs).sandbox
        else:
            process = _module_process(name, num_envs)
        return RealTimePolicy(process, name, num_envs, deadline=deadline)

    return make


def loads_code_or_a_file(name: str) -> bool:
    """Return whether a policy's name is ``module:object`` or an ONNX file.

    All other names are those of this project's rules.
    """
    return name.endswith(".onnx") or ":" in name


def _module_process(name: str, num_envs: int) -> ChildProcess:
    """Start the process of a module's policy, and wait until it is loaded.

    Raise ValueError if it cannot be loaded.
    """
    # What the policy prints goes where this process writes its errors.
    child = ChildProcess(["-c", PROGRAM, name, str(num_envs)], stdout=STDERR)
    try:
        kind, content = child.connection.receive(MAX_ANSWER, LOADING)
    except (OSError, EOFError) as error:
        child.close()
        raise ValueError(f"{name} cannot be loaded: {error}") from error
    if kind == ERROR:
        child.close()
        raise ValueError(_text_of(content))
    return child


class RealTimePolicy(Policy):
    """The policy of a process that must answer within a deadline, for ``num_envs`` environments.

    Args:
        process: the process, which has loaded the policy.
        name: the policy's name, for messages.
        num_envs: number of environments.
        deadline: time in which ``act`` must be answered [s].
    """

    def __init__(self, process: ChildProcess, name: str, num_envs: int, deadline: float) -> None:
        self._process = process
        self._name = name
        self._deadline = deadline
        self._must_reset = np.zeros(num_envs, np.bool_)
        self._asked_at: float | None = None  # time of the request that is not answered yet [s]
        self._has_answered = False

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Clear the memory of environments before the next observations.

        If the policy fails to do so, the next ``act`` raises the error.
        """
        self._must_reset |= mask

    def act(self, observations: Observations) -> Actions:
        """Return the policy's actions.

        Raises:
            TimeoutError: The answer is late.
            PolicyEndedError: The process has ended.
            RuntimeError: The policy fails.
        """
        start = time.monotonic()
        deadline = start + (self._deadline if self._has_answered else LOADING)
        if self._asked_at is not None:
            self._receive(deadline)  # the late answer to older observations
        if self._must_reset.any():
            self._send(RESET, self._must_reset.tobytes(), deadline)
            self._must_reset[:] = False
        self._send(ACT, np.asarray(observations, np.float32).tobytes(), deadline)
        self._asked_at = start
        kind, content = self._receive(deadline)
        if kind == ERROR:
            raise RuntimeError(_text_of(content))
        try:
            return np.frombuffer(content, np.float32).reshape(len(observations), -1).copy()
        except ValueError as error:
            raise RuntimeError(f"{self._name} gives no actions: {error}") from error

    def _send(self, kind: bytes, content: bytes, deadline: float) -> None:
        """Send a message. After one that was not taken in time no other can follow."""
        try:
            self._process.connection.send(kind, content, deadline - time.monotonic())
        except OSError as error:
            raise self._ended() from error

    def _receive(self, deadline: float) -> tuple[bytes, bytes]:
        """Return the answer to the last request."""
        try:
            answer = self._process.connection.receive(MAX_ANSWER, deadline - time.monotonic())
        except TimeoutError as error:
            patience = HUNG if self._has_answered else LOADING
            if self._asked_at is not None and time.monotonic() - self._asked_at > patience:
                raise self._ended() from error
            raise TimeoutError(f"no answer of {self._name} in time") from error
        except (OSError, EOFError) as error:
            raise self._ended() from error
        self._asked_at = None
        self._has_answered = True
        return answer

    def _ended(self) -> PolicyEndedError:
        """End the process, and return the error that says so."""
        status = self._process.end()
        return PolicyEndedError(f"the process of {self._name} has ended, status {status}")


def _text_of(error: bytes) -> str:
    return messages.text_of(error)[:MAX_ERROR]


def main(name: str, num_envs: int) -> None:
    """Load a module's policy, and answer its parent until that is gone."""
    _end_with_parent()
    parent = _connection_from_standard_input()
    try:
        policy = as_factory(name, FILE_LIMITS)(num_envs)
    except Exception as error:  # a policy may fail in any way
        parent.send(ERROR, _as_bytes(error))
        return
    try:
        parent.send(ANSWER)
        _serve(policy, num_envs, parent=parent)
    except (OSError, EOFError):
        return  # the parent is gone


def _connection_from_standard_input() -> Connection:
    """Return the connection to the parent, and leave nothing on standard input.

    The policy, or a program that it starts, may read standard input. The connection is a duplicate,
    which programs do not inherit.
    """
    connection = socket.socket(fileno=os.dup(STDIN))
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, STDIN)
    os.close(nothing)
    return Connection(connection)


def _serve(policy: Policy, num_envs: int, parent: Connection) -> None:
    """Answer observations with actions, or with the error of a policy that may act again later."""
    reset_error = b""  # a reset is not answered, so the next answers tell its error
    while True:
        kind, content = parent.receive(messages.MAX_REQUEST)
        if kind == RESET:
            reset_error = _reset(policy, np.frombuffer(content, np.bool_).copy())
        elif reset_error:
            parent.send(ERROR, reset_error)
        else:
            observations = np.frombuffer(content, np.float32).reshape(num_envs, -1).copy()
            answer, content = _answer(policy, observations)
            parent.send(answer, content)


def _reset(policy: Policy, mask: NDArray[np.bool_]) -> bytes:
    """Reset environments; return the policy's error, or nothing."""
    try:
        policy.reset(mask)
    except Exception as error:
        return _as_bytes(error)
    return b""


def _answer(policy: Policy, observations: Observations) -> tuple[bytes, bytes]:
    """Return the kind and the content of a message with the policy's actions or its error."""
    try:
        actions = np.asarray(policy.act(observations))
        is_number = actions.dtype.kind in "fiu"
        if actions.ndim != 2 or len(actions) != len(observations) or not is_number:
            raise ValueError(
                f"gives actions of type {actions.dtype} and shape {actions.shape}, "
                f"not numbers of shape ({len(observations)}, numbers of an action)"
            )
        with np.errstate(over="ignore"):  # the shield refuses infinite actions
            return ANSWER, actions.astype(np.float32).tobytes()
    except Exception as error:
        return ERROR, _as_bytes(error)


def _as_bytes(error: Exception) -> bytes:
    """Return the text of a policy's error as a message."""
    text = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
    return text[:MAX_ERROR].encode("utf-8", "replace")


def _end_with_parent() -> None:
    """Let the kernel end this process when its parent ends, even if a policy hangs (Linux)."""
    if sys.platform == "linux":
        parent_death_signal = 1  # PR_SET_PDEATHSIG of prctl(2)
        ctypes.CDLL(None).prctl(parent_death_signal, signal.SIGKILL)
