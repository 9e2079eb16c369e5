"""The process that checks and runs a submitted network. It holds only that file, observations and actions.

It starts with an empty environment and, before it sees the file, limits itself: its memory and processor time, no writing, and no
opening of files or connections. It imports nothing of the project's environment, which it must not know. ``onnx_policy.py`` is
the parent, which starts ``main``; ``Connection`` is how the two talk.
"""

import contextlib
import json
import socket
import struct
import time

import numpy as np

ANSWER, ERROR = b"K", b"E"  # kinds of messages of the child: an answer, or why there is none
CONTENT, SIZES, RESET, ACT = b"C", b"L", b"R", b"A"  # kinds of messages of the parent; RESET is not answered

_HEAD = struct.Struct("<cQ")  # kind and length
_MAX_REQUEST = 2**31  # [bytes]
_FIRST_CHECKS = 2  # the first actions are checked ...
_CHECK_EVERY = 32  # ... and then one of so many at random, which no network can foresee


class Connection:
    """One end of a connection for messages: a kind and bytes. Neither side trusts the other to be quick.

    A message must be taken within ``send_timeout`` [s]; None: no limit.
    """

    def __init__(self, connection: socket.socket, send_timeout: float | None = None) -> None:
        self._connection, self._send_timeout = connection, send_timeout
        self.close = connection.close

    def send(self, kind: bytes, content: bytes = b"") -> None:
        """Send a message. Raise TimeoutError if the other side does not take it in time and OSError if the other side is gone."""
        self._connection.settimeout(self._send_timeout)
        self._connection.sendall(_HEAD.pack(kind, len(content)) + content)

    def receive(self, max_bytes: int, timeout: float | None = None) -> tuple[bytes, bytes]:
        """Return the kind and the content of the next message; ``timeout`` [s] covers the whole message, None: no limit.

        Raise TimeoutError, EOFError if the other side is gone, or OSError if the message is longer than ``max_bytes``.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        kind, length = _HEAD.unpack(self._receive(_HEAD.size, deadline))
        if length > max_bytes:
            raise OSError(f"a message of {length} bytes, where at most {max_bytes} are allowed")
        return kind, self._receive(length, deadline)

    def _receive(self, count: int, deadline: float | None) -> bytes:
        content = bytearray(count)
        view, received = memoryview(content), 0
        while received < count:
            self._connection.settimeout(None if deadline is None else max(deadline - time.monotonic(), 1e-3))
            more = self._connection.recv_into(view[received:])
            if not more:
                raise EOFError("the other side has closed the connection")
            received += more
        return bytes(content)


def main(memory: int, computing: int) -> None:
    """Serve the parent process over the socket on standard input; ``memory`` [MiB] and ``computing`` [s] are limits."""
    parent = Connection(socket.socket(fileno=0))
    try:
        # Import all that is needed while files can still be opened.
        from train.agents import network  # noqa: F401
        from turning_env.scoring import onnx_session

        onnx_session.runtime()
        limit(memory, computing)
        try:
            _serve(parent)
        except ValueError as error:
            parent.send(ERROR, onnx_session.first_line(error).encode())
    except EOFError:
        return
    except MemoryError:
        parent.send(ERROR, f"needs more than the {memory} MiB of memory that it may have".encode())
    except Exception as error:
        parent.send(ERROR, f"{type(error).__name__}: {error}"[:500].encode())


def limit(memory: int, computing: int) -> None:
    """Limit this process's memory [MiB] and processor time [s], and forbid it to open or write anything."""
    try:
        import resource
    except ImportError:  # on Windows the parent limits the time alone
        return
    np.random.default_rng().permutation(2)  # opens what it needs now
    limits = {
        resource.RLIMIT_AS: (memory * 2**20, memory * 2**20),
        resource.RLIMIT_CPU: (computing, computing + 5),  # the soft limit ends it with a signal that says why
        resource.RLIMIT_CORE: (0, 0),
        resource.RLIMIT_FSIZE: (0, 0),
        resource.RLIMIT_NOFILE: (3, 3),
    }
    for kind, values in limits.items():
        with contextlib.suppress(ValueError, OSError):  # macOS has no limit of memory
            resource.setrlimit(kind, values)


def _serve(parent: Connection) -> None:
    """Send the outline of a file, check and try its network, then answer observations with actions.

    ``SIZES`` makes a new policy of the same network.
    """
    from train.agents import network
    from turning_env.scoring.onnx_session import OnnxPolicy

    _, content = parent.receive(network.MAX_BYTES + 1)
    model, outline = network.read(content)
    parent.send(ANSWER, json.dumps(outline._asdict()).encode())
    network.check_sizes(model)
    del model
    inputs = outline.inputs
    session = network.tried(content, inputs["observation"], outline.outputs["action"], inputs.get("memory", 0))
    parent.send(ANSWER)
    generator, calls = np.random.default_rng(), 0
    while True:
        kind, content = parent.receive(_MAX_REQUEST)
        if kind == SIZES:
            num_envs, entries, memory_size = (int(number) for number in np.frombuffer(content, np.int64))
            policy, calls = OnnxPolicy(session, memory_size, num_envs), 0
            parent.send(ANSWER)
        elif kind == RESET:
            policy.reset(np.frombuffer(content, np.bool_))
        else:
            observations = np.frombuffer(content, np.float32).reshape(num_envs, entries)
            calls += 1
            checked = calls <= _FIRST_CHECKS or generator.integers(_CHECK_EVERY) == 0
            actions = network.act_checked(policy, observations, generator) if checked else policy.act(observations)
            parent.send(ANSWER, np.ascontiguousarray(actions, np.float32).tobytes())
