"""The process that runs a stranger's network. It holds that file, observations and actions alone.

It starts with an empty environment and confines itself (``confinement.py``) before it sees the
file. It imports nothing of the environment that is played, which it must not know. ``sandbox.py``
is the parent, which starts ``main``; the two talk through a ``Connection``.
``leaderboard/agents/agent_child.py`` runs the files that enter leaderboards, with more checks.
"""

import json
import socket
import struct
import time
from typing import Any, NamedTuple, Protocol

import numpy as np

from leaderboard.agents import confinement, onnx_session
from leaderboard.agents.onnx_session import Floats, OnnxPolicy

# Kinds of messages of the child.
ANSWER = b"K"
ERROR = b"E"  # why there is no answer
MEASURES = b"M"  # how the process is confined

# Kinds of messages of the parent.
CONTENT = b"C"  # of the file
SIZES = b"L"  # number of environments and entries of the memory of a new policy
RESET = b"R"  # not answered
ACT = b"A"

ANY = -1  # number of entries where a network takes any
_HEAD = struct.Struct("<cQ")  # kind and length
_MAX_REQUEST = 2**31  # [bytes]
_ALL_INSIDE = (
    "all must be inside the file: export it with torch.onnx.export(..., external_data=False)"
)


class Outline(NamedTuple):
    """Metadata and shapes of a file."""

    properties: dict[str, str]
    inputs: dict[str, int]  # entries per environment of each input, or ANY
    outputs: dict[str, int]


class Network(Protocol):
    """A network from a file, in the process that runs it: how it is checked and how it acts."""

    def read(self, content: bytes) -> Outline:
        """Take a file's content and return its outline, or raise ValueError if it is refused."""

    def session(self) -> Any:
        """Return ONNX Runtime's session of the file, or raise ValueError if the file is refused."""

    def act(self, policy: OnnxPolicy, observations: Floats, call: int) -> Floats:
        """Return a policy's actions, or raise ValueError if they are refused.

        ``call`` counts the calls of the policy from 0 on.
        """


class PlainNetwork:
    """Any network with the inputs and outputs of a policy."""

    def read(self, content: bytes) -> Outline:
        """Return the outline, or raise ValueError if ONNX Runtime cannot run the file."""
        try:
            self._session = onnx_session.session_of(content)
        except ValueError as error:
            if "external" in str(error).lower():
                raise ValueError(f"keeps its weights in another file, but {_ALL_INSIDE}") from error
            raise
        onnx_session.check_inputs(self._session)
        return Outline(
            properties={},
            inputs={node.name: _entries(node.shape) for node in self._session.get_inputs()},
            outputs={node.name: _entries(node.shape) for node in self._session.get_outputs()},
        )

    def session(self) -> Any:
        """Return the session."""
        return self._session

    def act(self, policy: OnnxPolicy, observations: Floats, call: int) -> Floats:
        """Return the actions as they are, which are checked by the parent."""
        return policy.act(observations)


def _entries(shape: Any) -> int:
    size = shape[-1] if shape else ANY
    return size if isinstance(size, int) else ANY


class Connection:
    """One end of a connection for messages: a kind and bytes.

    Neither side trusts the other to be quick. A message must be taken within ``send_timeout`` [s];
    None: no limit.
    """

    def __init__(self, connection: socket.socket, send_timeout: float | None = None) -> None:
        self._connection = connection
        self._send_timeout = send_timeout
        self.close = connection.close

    def send(self, kind: bytes, content: bytes = b"") -> None:
        """Send a message.

        Raise TimeoutError if the other side does not take it in time, OSError if it is gone.
        """
        self._set_timeout(self._send_timeout)
        self._connection.sendall(_HEAD.pack(kind, len(content)) + content)

    def receive(self, max_bytes: int, timeout: float | None = None) -> tuple[bytes, bytes]:
        """Return the kind and the content of the next message.

        ``timeout`` [s] covers the whole message; None: no limit. Raise TimeoutError, EOFError if
        the other side is gone, or OSError if the message is longer than ``max_bytes``.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        kind, length = _HEAD.unpack(self._receive(_HEAD.size, deadline))
        if length > max_bytes:
            raise OSError(f"a message of {length} bytes, where at most {max_bytes} are allowed")
        return kind, self._receive(length, deadline)

    def _receive(self, count: int, deadline: float | None) -> bytes:
        content = bytearray(count)
        view = memoryview(content)
        received = 0
        while received < count:
            timeout = None
            if deadline is not None:
                timeout = max(deadline - time.monotonic(), 1e-3)
            self._set_timeout(timeout)
            new_bytes = self._connection.recv_into(view[received:])
            if not new_bytes:
                raise EOFError("the other side has closed the connection")
            received += new_bytes
        return bytes(content)

    def _set_timeout(self, seconds: float | None) -> None:
        # Setting a timeout asks the operating system, even if it is set already, and a confined
        # process may not.
        if self._connection.gettimeout() != seconds:
            self._connection.settimeout(seconds)


def main(memory: int, computing: int) -> None:
    """Run any network with the inputs and outputs of a policy; see ``run``."""
    run(PlainNetwork(), memory, computing)


def run(network: Network, memory: int, computing: int) -> None:
    """Serve the parent process over the socket on standard input.

    ``memory`` [MiB] and ``computing`` [s of processor time] are limits.
    """
    parent = Connection(socket.socket(fileno=0))
    try:
        _open_what_is_needed()
        measures = confinement.limit(memory, computing)
        parent.send(MEASURES, ",".join(measures).encode())
        _serve(parent, network)
    except EOFError:
        return
    except MemoryError:
        parent.send(ERROR, f"needs more than the {memory} MiB of memory that it may have".encode())
    except ValueError as error:
        parent.send(ERROR, onnx_session.first_line(error).encode())
    except Exception as error:
        parent.send(ERROR, f"{type(error).__name__}: {error}"[:500].encode())


def _open_what_is_needed() -> None:
    """Load libraries, and have them open what they need, while files can still be opened."""
    onnx_session.runtime()
    np.random.default_rng().permutation(2)


def _serve(parent: Connection, network: Network) -> None:
    """Send the outline of a file, check and try its network, then answer observations with actions.

    ``SIZES`` makes a new policy of the same network.
    """
    _, content = parent.receive(_MAX_REQUEST)
    outline = network.read(content)
    parent.send(ANSWER, json.dumps(outline._asdict()).encode())
    del content
    session = network.session()
    parent.send(ANSWER)
    while True:
        kind, content = parent.receive(_MAX_REQUEST)
        if kind == SIZES:
            num_envs, memory_size = np.frombuffer(content, np.int64).tolist()
            policy = OnnxPolicy(session, memory_size, num_envs)
            calls = 0
            parent.send(ANSWER)
        elif kind == RESET:
            policy.reset(np.frombuffer(content, np.bool_))
        else:
            observations = np.frombuffer(content, np.float32).reshape(num_envs, -1)
            actions = network.act(policy, observations, calls)
            calls += 1
            parent.send(ANSWER, _as_bytes(actions, num_envs))


def _as_bytes(actions: Floats, num_envs: int) -> bytes:
    if actions.ndim != 2 or len(actions) != num_envs or actions.dtype != np.float32:
        raise ValueError(
            f"gives actions that are {actions.dtype} of shape {actions.shape}, "
            f"but must be float32 of shape ({num_envs}, actions): {onnx_session.EXPORT}"
        )
    return np.ascontiguousarray(actions).tobytes()
