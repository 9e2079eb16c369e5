"""A policy file or a user's module in a process of its own.

There it can neither stop the control's process nor write past it. ``in_own_process`` makes the
policy; ``main`` and what follows it run in the policy's process. The two exchange lines of JSON: a
request with a number, and an answer with the same number. A policy that does not answer in time,
fails or has ended raises an error in ``act``, which the shield answers with the safe feed.

An ONNX file plays in one more process, which can read and write no file
(``leaderboard/agents/sandbox.py``). A module is the user's own code: its process may do what the
user who started the control may do.
"""

import contextlib
import ctypes
import json
import os
import selectors
import signal
import subprocess
import sys
import time
import weakref
from errno import ENOENT
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray
from turning_control.streams import standard_streams_taken

from leaderboard.adapt import as_factory
from leaderboard.agents.sandbox import Limits
from turning_env.policy import Actions, Observations, Policy, PolicyFactory

LOADING = 120.0  # time in which a policy must load and answer for the first time [s]
HUNG = 10.0  # time without an answer after which a policy's process is ended [s]
# Limits of an ONNX file. Its processor time is free, because a control runs for weeks.
FILE_LIMITS = Limits(answer=HUNG, start=LOADING, computing=0)
PROGRAM = """
import sys
from turning_control.policy_process import main
main(sys.argv[1], int(sys.argv[2]))
"""
MAX_ANSWER = 2**20  # bytes that are read at once; twice as many without a line break are refused
MAX_ERROR = 500  # length of an error's text [characters]


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

    def make(num_envs: int) -> PolicyProcess:
        if name.endswith(".onnx") and not Path(name).is_file():
            raise FileNotFoundError(ENOENT, "no such file", name)
        return PolicyProcess(name, num_envs, deadline)

    return make


def loads_code_or_a_file(name: str) -> bool:
    """Return whether a policy's name is ``module:object`` or an ONNX file.

    All other names are those of this project's rules.
    """
    return name.endswith(".onnx") or ":" in name


class PolicyProcess(Policy):
    """The policy as its parent sees it."""

    def __init__(self, name: str, num_envs: int, deadline: float) -> None:
        self._name = name
        self._deadline = deadline
        self._number = 0  # of the last request
        self._asked: float | None = None  # when the request that is not answered yet was sent
        self._received = b""
        self._has_answered = False
        command = [sys.executable, "-c", PROGRAM, name, str(num_envs)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
        )
        self._end = weakref.finalize(self, _end, self._process)
        # A process that hangs must not block this one, so every read and write has a deadline.
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            os.set_blocking(pipe.fileno(), False)
        self._load()

    def _load(self) -> None:
        """Wait until the policy is loaded; ValueError if it cannot be."""
        try:
            loaded = self._receive(time.monotonic() + LOADING)
        except (TimeoutError, RuntimeError) as error:
            self._end()
            raise ValueError(f"{self._name} cannot be loaded: {error}") from error
        if "failed" in loaded:
            self._end()
            raise ValueError(str(loaded["failed"]))

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Clear the memory of environments before the next observations.

        If the policy fails to do so, the next ``act`` raises the error.
        """
        request = {"reset": np.asarray(mask).tolist()}
        with contextlib.suppress(PolicyEndedError, TimeoutError):
            self._wait_until_free(time.monotonic() + self._deadline)
            self._send(request, time.monotonic() + self._deadline)

    def act(self, observations: Observations) -> Actions:
        """Return the policy's actions.

        Raises:
            TimeoutError: The answer is late.
            PolicyEndedError: The process has ended.
            RuntimeError: The policy fails.
        """
        start = time.monotonic()
        deadline = start + (self._deadline if self._has_answered else LOADING)
        self._wait_until_free(deadline)
        self._send({"observations": observations.tolist()}, deadline)
        self._asked = start
        answer = self._wait_until_free(deadline)
        self._has_answered = True
        if "failed" in answer:
            raise RuntimeError(str(answer["failed"])[:MAX_ERROR])
        return np.asarray(answer.get("actions"))  # the shield checks its type and shape

    def _wait_until_free(self, deadline: float) -> dict[str, Any]:
        """Return the answer to the last request, or nothing if it has come before.

        Answers to older requests, which came too late, are skipped.
        """
        answer: dict[str, Any] = {}
        while self._asked is not None:
            answer = self._receive(deadline)
            if answer.get("number") == self._number:
                self._asked = None
        return answer

    def _send(self, values: dict[str, Any], deadline: float) -> None:
        """Send a request with the next number."""
        self._number += 1
        line = json.dumps({"number": self._number, **values}).encode() + b"\n"
        pipe = self._process.stdin
        assert pipe is not None
        while line:
            self._wait(pipe, selectors.EVENT_WRITE, deadline)
            try:
                written = os.write(pipe.fileno(), line)
            except OSError as error:
                raise self._ended() from error
            line = line[written:]

    def _receive(self, deadline: float) -> dict[str, Any]:
        """Return the next line that the process writes."""
        pipe = self._process.stdout
        assert pipe is not None
        while b"\n" not in self._received:
            self._wait(pipe, selectors.EVENT_READ, deadline)
            chunk = os.read(pipe.fileno(), MAX_ANSWER)
            self._received += chunk
            if not chunk or len(self._received) > 2 * MAX_ANSWER:
                raise self._ended()
        line, _, self._received = self._received.partition(b"\n")
        try:
            answer = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise RuntimeError("the policy's process does not keep to its protocol") from error
        return answer if isinstance(answer, dict) else {}

    def _wait(self, pipe: Any, event: int, deadline: float) -> None:
        """Wait until a pipe can be read or written; TimeoutError after the deadline."""
        if not self._end.alive:
            raise PolicyEndedError(f"the process of {self._name} has ended")
        with selectors.DefaultSelector() as selector:
            selector.register(pipe, event)
            if selector.select(max(deadline - time.monotonic(), 0.0)):
                return
        patience = HUNG if self._has_answered else LOADING
        if self._asked is not None and time.monotonic() - self._asked > patience:
            raise self._ended()
        raise TimeoutError(f"no answer of {self._name} in time")

    def _ended(self) -> PolicyEndedError:
        """End the process, and return the error that says so."""
        self._end()
        status = self._process.returncode
        return PolicyEndedError(f"the process of {self._name} has ended, status {status}")


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        assert pipe is not None
        with contextlib.suppress(OSError):
            pipe.close()


def main(name: str, num_envs: int) -> None:
    """Load a policy, and answer requests until there are no more."""
    _end_with_parent()
    with standard_streams_taken() as (requests, answers):
        try:
            policy = as_factory(name, FILE_LIMITS)(num_envs)
        except Exception as error:  # a policy may fail in any way
            _write_line(answers, json.dumps({"failed": _text(error)}))
            return
        _write_line(answers, json.dumps({"ready": True}))
        _serve(policy, requests, answers)


def _serve(policy: Policy, requests: TextIO, answers: TextIO) -> None:
    reset_error = ""  # a reset is not answered, so the next answer tells its error
    for line in requests:
        request = json.loads(line)
        if "reset" in request:
            reset_error = _reset(policy, request["reset"])
        elif reset_error:
            failed = {"number": request["number"], "failed": reset_error}
            _write_line(answers, json.dumps(failed))
        else:
            _write_line(answers, _answer(policy, request["number"], request["observations"]))


def _reset(policy: Policy, mask: list[bool]) -> str:
    """Reset environments; return the policy's error, or an empty text."""
    try:
        policy.reset(np.array(mask, np.bool_))
    except Exception as error:
        return _text(error)
    return ""


def _answer(policy: Policy, number: int, observations: list[list[float]]) -> str:
    """Return a line of JSON with the policy's actions or its error."""
    try:
        actions = np.asarray(policy.act(np.array(observations, np.float32)))
        # Objects that JSON cannot write are the policy's error, too.
        return json.dumps({"number": number, "actions": actions.tolist()})
    except Exception as error:
        return json.dumps({"number": number, "failed": _text(error)})


def _write_line(answers: TextIO, line: str) -> None:
    answers.write(line + "\n")
    answers.flush()


def _text(error: Exception) -> str:
    text = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
    return text[:MAX_ERROR]


def _end_with_parent() -> None:
    """Let the kernel end this process when its parent ends, even if a policy hangs (Linux)."""
    if sys.platform == "linux":
        parent_death_signal = 1  # PR_SET_PDEATHSIG of prctl(2)
        ctypes.CDLL(None).prctl(parent_death_signal, signal.SIGKILL)
