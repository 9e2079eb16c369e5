"""Load an agent's ONNX file, which may come from anywhere, and play it in a process of its own, without PyTorch.

from pathlib import Path
from train.agents import onnx_policy

agent = onnx_policy.load(Path("ppo-seed0.onnx"))
policy = agent.make(1)

This side sends observations, receives and checks actions, and limits how long it waits. It never looks into the file itself:
``sandbox_child.py`` says what the process that does may do.
"""

import os
import signal
import socket
import subprocess
import sys
import weakref
from contextlib import closing
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from train.agents import agent_file
from train.agents import sandbox_child as child
from train.agents.agent_file import AgentFile, trained_policy
from train.agents.network import MAX_BYTES, MAX_METADATA, Outline, check_actions
from turning_env.scoring.policy import Actions, Observations, PolicySpec

PROGRAM = """
import os, sys, types
for name in ("train", "turning_env"):  # their own __init__.py would import the environment
    package = sys.modules[name] = types.ModuleType(name)
    package.__path__ = [os.path.join(sys.argv[1], name)]
from train.agents.sandbox_child import main
main(int(sys.argv[2]), int(sys.argv[3]))
os._exit(0)  # skip the clean-up of libraries that can open nothing
"""
"""Program of the process."""
_MAX_OUTLINE = 6 * MAX_METADATA + 1_000_000  # bytes: JSON may need six for a character
_MAX_ERROR = 2_000  # bytes
_KEPT_VARIABLES = ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT")
_OUTLINE = TypeAdapter(Outline)


@dataclass(frozen=True)
class Limits:
    """Limits of a network's process."""

    answer: float = 60.0  # wall-clock time until an answer [s]: generous, as the machine may be busy
    start: float = 120.0  # wall-clock time until its process is ready [s]
    computing: int = 600  # total processor time of one play of all its episodes [s]
    memory: int = 3072  # memory [MiB], including ONNX Runtime's own


LIMITS = Limits()


class TooSlow(ValueError):
    """A network needs more time than it may have."""


class Sandbox:
    """A process that checks a file's content and plays it; ValueError says why it cannot. Its ``program`` is not trusted.

    It ends when this object is garbage-collected.
    """

    def __init__(self, content: bytes, limits: Limits = LIMITS, program: str = PROGRAM) -> None:
        self._limits = limits
        ours, its = socket.socketpair()
        arguments = [str(Path(__file__).parents[2]), str(limits.memory), str(limits.computing)]
        kept = {name: os.environ[name] for name in _KEPT_VARIABLES if name in os.environ}
        with its:
            self.process = subprocess.Popen(
                [sys.executable, "-I", "-c", program, *arguments],
                stdin=its.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=kept | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
                start_new_session=True,  # Ctrl-C is for the parent to handle
            )
        self._connection = child.Connection(ours, limits.start)
        self.close = weakref.finalize(self, _end, self.process, self._connection)
        try:
            self.send(child.CONTENT, content[: MAX_BYTES + 1])
            outline = _OUTLINE.validate_json(self.answer(_MAX_OUTLINE, starting=True), strict=True)
            self.file = agent_file.of_outline(content, outline)
            self.answer(0)
        except ValidationError as error:
            self.close()
            raise ValueError("tells nothing of itself that can be understood") from error
        except BaseException:
            self.close()
            raise

    def send(self, kind: bytes, content: bytes = b"") -> None:
        """Send a message. Raise ValueError if the process is gone, or does not listen."""
        try:
            self._connection.send(kind, content)
        except OSError as error:
            raise self._end_reason() from error

    def answer(self, max_bytes: int, starting: bool = False) -> bytes:
        """Return its answer, or raise ValueError if it is late, too long or an error; ``starting`` allows the time of a start."""
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
            status = self.process.wait(1.0)
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
    """The policy of a sandbox's agent, for ``num_envs`` environments. An earlier policy of the sandbox acts no more."""

    def __init__(self, sandbox: Sandbox, num_envs: int) -> None:
        about = sandbox.file.metadata
        self._observations = num_envs, len(about.observation_space.low)
        self._actions = num_envs, len(about.action_space.low)
        self.sandbox = sandbox
        sandbox.send(child.SIZES, np.array([*self._observations, sandbox.file.memory_size], np.int64).tobytes())
        sandbox.answer(0)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Clear the memory of the environments in the mask, shape (num_envs,)."""
        if mask.shape != self._observations[:1] or mask.dtype != np.bool_:
            raise ValueError(f"the mask must be bool of shape {self._observations[:1]}, got {mask.dtype} of {mask.shape}")
        self.sandbox.send(child.RESET, mask.tobytes())

    def act(self, observations: Observations) -> Actions:
        """Return actions, shape (num_envs, actions), for observations, shape (num_envs, entries); both float32, both checked."""
        if observations.shape != self._observations or observations.dtype != np.float32:
            wanted = f"float32 of shape {self._observations}, got {observations.dtype} of {observations.shape}"
            raise ValueError(f"the agent cannot act on these observations: they must be {wanted}")
        self.sandbox.send(child.ACT, observations.tobytes())
        size = 4 * self._actions[0] * self._actions[1]
        content = self.sandbox.answer(size)
        if len(content) != size:
            raise ValueError(f"gives {len(content)} bytes, which are not actions of shape {self._actions}")
        actions = np.frombuffer(content, np.float32).reshape(self._actions).copy()
        check_actions(actions, self._actions)
        return actions


@dataclass(frozen=True)
class _Maker:
    """A function that makes policies of a file, each in its own process; it travels to other processes as the file."""

    content: bytes
    limits: Limits

    def __call__(self, num_envs: int) -> GuardedPolicy:
        return GuardedPolicy(Sandbox(self.content, self.limits), num_envs)


def load(path: Path, limits: Limits = LIMITS) -> PolicySpec:
    """Load an agent from its file, which may come from anywhere: it is checked, can run no code, and each play has limits.

    Raise TooSlow if it gives no actions in time, and ValueError with the reason if the file is refused.
    """
    for name in ("onnx", "onnxruntime"):  # of the process that looks at the file and plays it
        if find_spec(name) is None:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    content = agent_file.read_content(path)
    try:
        file = _checked(content)
    except ValueError as error:
        kind = TooSlow if isinstance(error, TooSlow) else ValueError
        raise kind(f"{path}: {error}") from error
    return trained_policy(file.metadata, file.metadata.trained_steps, file.digest, _Maker(content, limits))


@lru_cache(64)
def _checked(content: bytes) -> AgentFile:
    """Check a file once, as it plays many scenarios."""
    with closing(Sandbox(content)) as sandbox:
        return sandbox.file
