"""A policy file or a user's module in a process of its own, so that it can neither stop nor write past the control's process.

``in_own_process`` makes the policy; the rest of this file runs in its process. The two exchange lines of JSON: a request with a
number, and an answer with the same number. A policy that does not answer in time, fails or has ended raises an error in ``act``,
which the shield answers with the safe feed.

An ONNX file plays in one more process, which can read and write no file (``turning_env/scoring/sandbox.py``). A module is code of
the user's own: its process may do what the user may who started the control.
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

from turning_env.scoring.adapt import as_factory
from turning_env.scoring.policy import Actions, Observations, Policy, PolicyFactory
from turning_env.scoring.sandbox import Limits

LOADING = 120.0  # time in which a policy must load and answer for the first time [s]
HUNG = 10.0  # time without an answer after which a policy's process is ended [s]
FILE_LIMITS = Limits(
    answer=HUNG, start=LOADING, computing=0
)  # of an ONNX file; any processor time, as a control runs for weeks
PROGRAM = "import sys; from turning_control.policy_process import main; main(sys.argv[1], int(sys.argv[2]))"
MAX_ANSWER = 2**20  # length of an answer above which it is refused [bytes]


class PolicyEndedError(RuntimeError):
    """The policy's process has ended, or was ended because it hung."""


def in_own_process(name: str, deadline: float) -> PolicyFactory:
    """Return a function that starts the process of ``module:object`` or an ONNX file for a number of environments.

    The function raises ValueError if the policy cannot be loaded, and FileNotFoundError if there is no such file.

    Args:
        name: ``module:object``, or the path of an ONNX file.
        deadline: time in which ``act`` must be answered [s]. The first answer has as much time as loading.
    """

    def make(num_envs: int) -> PolicyProcess:
        if name.endswith(".onnx") and not Path(name).is_file():
            raise FileNotFoundError(ENOENT, "no such file", name)
        return PolicyProcess(name, num_envs, deadline)

    return make


class PolicyProcess(Policy):
    """The policy as its parent sees it."""

    def __init__(self, name: str, num_envs: int, deadline: float) -> None:
        self._name = name
        self._deadline = deadline
        self._number = 0  # of the last request
        self._asked: float | None = None  # when the request that is not answered yet was sent
        self._received = b""
        command = [sys.executable, "-c", PROGRAM, name, str(num_envs)]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
        )
        self._end = weakref.finalize(self, _end, self._process)
        for pipe in (self._process.stdin, self._process.stdout):
            os.set_blocking(pipe.fileno(), False)  # type: ignore[union-attr]
        self._has_answered = False
        try:
            loaded = self._receive(time.monotonic() + LOADING)
        except (TimeoutError, RuntimeError) as error:
            self._end()
            raise ValueError(f"{name} cannot be loaded: {error}") from error
        if "failed" in loaded:
            self._end()
            raise ValueError(str(loaded["failed"]))

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Clear the memory of environments before the next observations; if the policy fails in it, ``act`` says so."""
        with contextlib.suppress(PolicyEndedError, TimeoutError):
            self._wait_until_free(time.monotonic() + self._deadline)
            self._send({"reset": np.asarray(mask).tolist()}, time.monotonic() + self._deadline)

    def act(self, observations: Observations) -> Actions:
        """Return the policy's actions. TimeoutError if it is late, PolicyEndedError if it is gone, RuntimeError if it fails."""
        begun = time.monotonic()
        deadline = begun + (self._deadline if self._has_answered else LOADING)
        self._wait_until_free(deadline)
        self._send({"observations": observations.tolist()}, deadline)
        self._asked = begun
        answer = self._wait_until_free(deadline)
        self._has_answered = True
        if "failed" in answer:
            raise RuntimeError(str(answer["failed"])[:500])
        return np.asarray(answer.get("actions"))  # the shield checks its type and shape

    def _wait_until_free(self, deadline: float) -> dict[str, Any]:
        """Return the answer to the last request, or nothing if it has come before; an older answer is passed over."""
        answer: dict[str, Any] = {}
        while self._asked is not None:
            answer = self._receive(deadline)
            if answer.get("number") == self._number:
                self._asked = None
        return answer

    def _send(self, values: dict[str, Any], deadline: float) -> None:
        self._number += 1
        line = json.dumps({"number": self._number, **values}).encode() + b"\n"
        pipe = self._process.stdin
        assert pipe is not None
        while line:
            self._wait(pipe, selectors.EVENT_WRITE, deadline)
            try:
                line = line[os.write(pipe.fileno(), line) :]
            except OSError as error:
                raise self._ended() from error

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
        return PolicyEndedError(
            f"the process of {self._name} has ended, status {self._process.returncode}"
        )


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        with contextlib.suppress(OSError):
            pipe.close()  # type: ignore[union-attr]


def main(name: str, num_envs: int) -> None:
    """Load a policy, and answer requests until there are no more."""
    _end_with_parent()
    with standard_streams_taken() as (requests, answers):
        _serve(name, num_envs, requests, answers)


def _serve(name: str, num_envs: int, requests: TextIO, answers: TextIO) -> None:
    try:
        policy = as_factory(name, FILE_LIMITS)(num_envs)
    except Exception as error:  # a policy may fail in any way
        _say(answers, {"failed": _text(error)})
        return
    _say(answers, {"ready": True})
    failed = ""  # in a reset, which is not answered
    for line in requests:
        request = json.loads(line)
        try:
            if "reset" in request:
                failed = ""
                policy.reset(np.array(request["reset"], np.bool_))
                continue
            if failed:
                raise RuntimeError(failed)
            actions = np.asarray(policy.act(np.array(request["observations"], np.float32)))
            _say(answers, {"number": request["number"], "actions": actions.tolist()})
        except Exception as error:
            if "reset" in request:
                failed = _text(error)
                continue
            _say(answers, {"number": request["number"], "failed": _text(error)})


def _say(answers: TextIO, values: dict[str, Any]) -> None:
    answers.write(json.dumps(values) + "\n")
    answers.flush()


def _text(error: Exception) -> str:
    text = str(error) if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
    return text[:500]


def _end_with_parent() -> None:
    """Let the kernel end this process when its parent ends, even if a policy hangs (Linux)."""
    if sys.platform == "linux":
        parent_death_signal = 1  # PR_SET_PDEATHSIG of prctl(2)
        ctypes.CDLL(None).prctl(parent_death_signal, signal.SIGKILL)


def loads_code_or_a_file(name: str) -> bool:
    """Return whether a policy's name is ``module:object`` or an ONNX file, rather than one of this project's rules."""
    return name.endswith(".onnx") or ":" in name
