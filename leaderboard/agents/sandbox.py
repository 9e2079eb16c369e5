"""Play a network from an ONNX file, which may come from anywhere, in a process of its own.

    from pathlib import Path
    from leaderboard.agents.sandbox import load

    policy = load(Path("my_agent.onnx"))(1)

This side sends observations, receives and checks actions, and limits how long it waits. It never
looks into the file itself: ``sandbox_child.py`` is the process that does, and ``confinement.py``
says what that process may still do. The others have a file each, too: ``child_process.py`` starts
a process, ``messages.py`` has what it and its parent say, ``onnx_session.py`` runs a network.

An agent for a leaderboard plays in the same sandbox, with more checks: ``network.py`` has those of
its arithmetic, ``agent_file.py`` those of its metadata, ``onnx_policy.py`` loads it.
"""

import os
import signal
import subprocess
import sys
from contextlib import closing
from dataclasses import dataclass, field
from errno import ENOENT
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from leaderboard.agents import confinement, messages
from leaderboard.agents.child_process import ChildProcess
from leaderboard.agents.messages import ANY, MAX_ACTIONS, MAX_ERROR, Outline
from leaderboard.agents.onnx_session import check_actions
from turning_env.extras import needed
from turning_env.files import read_regular
from turning_env.policy import Actions, Observations

MAX_BYTES = 200_000_000  # of a file: it is in the memory of its process several times
_MAX_OUTLINE = 7_000_000  # bytes
_PATIENCE = 1.0  # time in which a process that closes its connection should end by itself [s]
_KEPT_VARIABLES = ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "SYSTEMROOT")
_OUTLINE = TypeAdapter(Outline)

_PROGRAM = """
import os, sys, types
for name, folders in {folders!r}.items():  # their own __init__.py would import more
    package = sys.modules[name] = types.ModuleType(name)
    package.__path__ = folders
from {module} import main
main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] == "strict")
os._exit(0)  # skip the clean-up of libraries that can open nothing
"""


def program_of(module: str) -> str:
    """Return the program of a process that runs ``main(memory, computing, strict)`` of a module."""
    packages = {"leaderboard", module.partition(".")[0]}
    folders = {name: list(sys.modules[name].__path__) for name in sorted(packages)}
    return _PROGRAM.format(folders=folders, module=module)


@dataclass(frozen=True)
class ProcessLimits:
    """Limits of a network's process."""

    answer: float = 60.0  # wall time until an answer [s]: generous, as the machine may be busy
    start: float = 120.0  # wall time until its process is ready [s]
    computing: int = 600  # total processor time of one play of all its episodes [s]; 0: any
    memory: int = 3072  # memory [MiB], including ONNX Runtime's own


LIMITS = ProcessLimits()


class AgentFileError(ValueError):
    """A file that cannot play, with the reason: it is refused, or breaks a rule or a limit.

    Whatever the file holds, loading and playing it raise this error and no other.
    """


class AgentTimeoutError(AgentFileError):
    """A network needs more time than it may have."""


class Sandbox(ChildProcess):
    """A process that checks a file's content and plays it.

    What it sends is not trusted. It ends when this object is garbage-collected.

    Args:
        content: content of the file.
        limits: limits of the process.
        strict: whether the network must be plain arithmetic of moderate size, and act reproducibly:
            see ``network.py``. Else it may have any operators.
        program: Python source that the process runs; None: that of ``sandbox_child.py``.

    Attributes:
        outline: metadata and shapes of the file.
        entries: entries of an observation, or ANY.
        actions: numbers of an action, or ANY.
        memory_size: entries of the memory.

    Raises:
        AgentFileError: the file is refused, or the process breaks a limit.
    """

    def __init__(
        self,
        content: bytes,
        limits: ProcessLimits = LIMITS,
        *,
        strict: bool = False,
        program: str | None = None,
    ) -> None:
        self._limits = limits
        program = program or program_of("leaderboard.agents.sandbox_child")
        checks = "strict" if strict else "plain"
        arguments = ["-I", "-c", program, str(limits.memory), str(limits.computing), checks]
        kept = {name: os.environ[name] for name in _KEPT_VARIABLES if name in os.environ}
        super().__init__(
            arguments,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=kept | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
            start_new_session=True,  # Ctrl-C is for the parent to handle
        )
        try:
            self.send(messages.CONTENT, content)
            outline = self.answer(_MAX_OUTLINE, starting=True)
            self.outline = _OUTLINE.validate_json(outline, strict=True)
            self._take_sizes()
        except ValidationError as error:
            self.close()
            raise AgentFileError("describes itself in a form that cannot be read") from error
        except BaseException:
            self.close()
            raise

    def _take_sizes(self) -> None:
        """Take the sizes of the network from its outline.

        Raise AgentFileError if inputs and outputs are not those of a policy.
        """
        inputs = self.outline.inputs
        outputs = self.outline.outputs
        without_memory = {"observation"}, {"action"}
        with_memory = {"observation", "memory"}, {"action", "next_memory"}
        if (set(inputs), set(outputs)) not in (without_memory, with_memory):
            raise AgentFileError(
                f"maps {', '.join(sorted(inputs))} to {', '.join(sorted(outputs))}, "
                "but must have the input observation and the output action; "
                "with a memory, also the input memory and the output next_memory"
            )
        self.entries = inputs["observation"]
        self.actions = outputs["action"]
        self.memory_size = inputs.get("memory", 0)
        if self.memory_size == ANY:
            raise AgentFileError(
                "has a memory of any size, but must state the entries per environment"
            )
        if self.actions > MAX_ACTIONS:
            raise AgentFileError(
                f"has actions of {self.actions} numbers, but may have {MAX_ACTIONS}"
            )

    def send(self, kind: bytes, content: bytes = b"") -> None:
        """Send a message. Raise AgentFileError if the process is gone, or does not listen."""
        try:
            self.connection.send(kind, content, self._limits.start)
        except OSError as error:
            raise self._end_reason() from error

    def answer(self, max_bytes: int, starting: bool = False) -> bytes:
        """Return the next answer, or raise AgentFileError if it is late, too long or an error.

        ``starting`` allows the time of a start, in which the process also says how it is confined.
        """
        kind, content = self._receive(max_bytes, starting)
        if starting and kind == messages.MEASURES:
            _warn_of_missing(_missing(content))
            kind, content = self._receive(max_bytes, starting)
        if kind == messages.ANSWER and len(content) <= max_bytes:
            return content
        if kind == messages.ERROR:
            raise AgentFileError(messages.text_of(content))
        raise AgentFileError("sends an answer of the wrong kind or length")

    def _receive(self, max_bytes: int, starting: bool) -> tuple[bytes, bytes]:
        timeout = self._limits.start if starting else self._limits.answer
        try:
            return self.connection.receive(max(max_bytes, MAX_ERROR), timeout)
        except TimeoutError as error:
            self.close()
            raise AgentTimeoutError(f"gives no answer within {timeout:g} s") from error
        except (OSError, EOFError) as error:
            raise self._end_reason() from error

    def _end_reason(self) -> AgentFileError:
        """Return the error that says why the process no longer answers."""
        status = self.end(_PATIENCE)
        if status == -signal.SIGXCPU:
            return AgentTimeoutError(
                f"needs more than the {self._limits.computing} s of processor time that it may have"
            )
        return AgentFileError(
            f"its process has ended (status {status}), "
            f"perhaps for more than the {self._limits.memory} MiB of memory allowed"
        )


def _missing(measures: bytes) -> tuple[str, ...]:
    """Return the measures that a process has not taken, by what it says of itself."""
    taken = measures.decode("utf-8", "replace").split(",")
    return tuple(name for name in confinement.MEASURES if name not in taken)


@cache
def _warn_of_missing(missing: tuple[str, ...]) -> None:
    """Print a notice, once, that measures are missing."""
    if not missing:
        return
    active = [name for name in confinement.MEASURES if name not in missing]
    print(
        "notice: networks run with less protection on this system: "
        f"{', '.join(active) or 'nothing'} active, {', '.join(missing)} missing or in part "
        "(docs/soundness.md says what remains)",
        file=sys.stderr,
    )


class GuardedPolicy:
    """The policy of a sandbox's network, for ``num_envs`` environments.

    An earlier policy of the same sandbox must not act any more. The first policy of a ``strict``
    sandbox tries the network, and raises AgentFileError if that fails.
    """

    def __init__(self, sandbox: Sandbox, num_envs: int) -> None:
        self.sandbox = sandbox
        self._num_envs = num_envs
        sizes = np.array([num_envs, sandbox.memory_size], np.int64)
        sandbox.send(messages.SIZES, sizes.tobytes())
        sandbox.answer(0)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Clear the memory of the environments in the mask, shape (num_envs,).

        Raise ValueError if the mask is not bool or has another shape.
        """
        if mask.shape != (self._num_envs,) or mask.dtype != np.bool_:
            raise ValueError(
                f"the mask must be bool of shape ({self._num_envs},), "
                f"got {mask.dtype} of {mask.shape}"
            )
        self.sandbox.send(messages.RESET, mask.tobytes())

    def act(self, observations: Observations) -> Actions:
        """Return actions, shape (num_envs, actions), for observations, shape (num_envs, entries).

        Both are float32. Raise ValueError for other observations, AgentFileError for other actions.
        """
        self._check_observations(observations)
        self.sandbox.send(messages.ACT, observations.tobytes())
        bytes_per_action = 4 * self._num_envs
        max_actions = MAX_ACTIONS if self.sandbox.actions == ANY else self.sandbox.actions
        content = self.sandbox.answer(bytes_per_action * max_actions)
        size, rest = divmod(len(content), bytes_per_action)
        if rest or size == 0 or self.sandbox.actions not in (ANY, size):
            raise AgentFileError(
                f"gives {len(content)} bytes, "
                f"which are not actions of {self._num_envs} environments"
            )
        actions = np.frombuffer(content, np.float32).reshape(self._num_envs, size).copy()
        try:
            check_actions(actions, (self._num_envs, size))
        except ValueError as error:
            raise AgentFileError(str(error)) from error
        return actions

    def _check_observations(self, observations: Observations) -> None:
        entries = observations.shape[-1] if self.sandbox.entries == ANY else self.sandbox.entries
        if observations.shape != (self._num_envs, entries) or observations.dtype != np.float32:
            raise ValueError(
                "the agent cannot act on these observations: "
                f"they must be float32 of shape ({self._num_envs}, {entries}), "
                f"got {observations.dtype} of {observations.shape} "
                "(`leaderboard run` adds the belief or derived inputs that its file states)"
            )


@dataclass(frozen=True)
class PolicyMaker:
    """A function that makes policies of a file, each in a process of its own.

    It is pickled with the file's content.
    """

    content: bytes
    limits: ProcessLimits
    strict: bool = False
    properties: dict[str, str] = field(default_factory=dict)
    """Metadata of the file, which anybody may have written."""

    def __call__(self, num_envs: int) -> GuardedPolicy:
        return GuardedPolicy(Sandbox(self.content, self.limits, strict=self.strict), num_envs)


def load(path: Path, limits: ProcessLimits = LIMITS) -> PolicyMaker:
    """Check a network's file, and return a function that makes policies of it.

    The file may come from anywhere: it can run no code, and each play has limits. It must hold its
    weights, as its process can open no other file.

    Raises:
        FileNotFoundError: there is no such file.
        ModuleNotFoundError: onnxruntime is not installed.
        AgentTimeoutError: the network gives no answer in time; this is an AgentFileError.
        AgentFileError: the file is refused; the message says why.
    """
    if not path.exists():
        raise FileNotFoundError(ENOENT, "no such file", str(path))
    require("onnxruntime")
    try:
        content = read_regular(path, MAX_BYTES)
    except OSError as error:
        raise AgentFileError(f"{path}: {error.strerror}") from error
    try:
        with closing(Sandbox(content, limits)) as opened:
            properties = opened.outline.properties
    except AgentFileError as error:
        raise type(error)(f"{path}: {error}") from error
    return PolicyMaker(content, limits, properties=properties)


def require(*packages: str) -> None:
    """Raise ModuleNotFoundError if a package is missing that the process of a network needs.

    The message says how to install it.
    """
    with needed():
        for name in packages:
            if find_spec(name) is None:
                raise ModuleNotFoundError(f"No module named {name!r}", name=name)
