"""Messages between a policy's process and the process that started it, over a socket.

A message is a kind and bytes. Both sides import this file, which imports nothing of the package.

The parent may send ``RESET`` and ``ACT`` as soon as the policy's process is ready. ``ACT`` is
answered with ``ANSWER`` or ``ERROR``; ``RESET`` is not answered, so that it costs no time.
"""

import socket
import struct
import time
from collections.abc import Mapping
from typing import NamedTuple

# Kinds of messages of the parent.
CONTENT = b"C"  # of the file
SIZES = b"L"  # number of environments and entries of the memory of a new policy, both int64
RESET = b"R"  # bool, one per environment; not answered
ACT = b"A"  # observations, float32, one row per environment

# Kinds of messages of the policy's process.
ANSWER = b"K"  # to ACT: actions, float32, one row per environment
ERROR = b"E"  # why there is no answer
MEASURES = b"M"  # how the process is confined

MAX_REQUEST = 2**31  # largest message of a parent [bytes]
MAX_METADATA = 1_000_000  # largest number of characters of a file's metadata
MAX_ERROR = 2_000  # largest text of an error [bytes]
MAX_ACTIONS = 16  # numbers of an action; no task has more
ANY = -1  # number of entries where a network takes any

_HEAD = struct.Struct("<cQ")  # kind and length
_CHUNK = 2**20  # bytes that are received at once
_MIN_TIMEOUT = 1e-3  # [s]; 0 would mean not to wait for bytes that are there already


class Outline(NamedTuple):
    """Metadata and shapes of a file, as its process describes it."""

    properties: dict[str, str]
    inputs: dict[str, int]  # entries per environment of each input, or ANY
    outputs: dict[str, int]


def is_short(properties: Mapping[str, str]) -> bool:
    """Return whether a file's metadata have at most ``MAX_METADATA`` characters."""
    characters = sum(len(key) + len(value) for key, value in properties.items())
    return characters <= MAX_METADATA


class Connection:
    """One end of a connection for messages. Neither side trusts the other to be quick."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._received = bytearray()  # the start of a message of which the rest has not come yet
        self.close = connection.close

    def send(self, kind: bytes, content: bytes = b"", timeout: float | None = None) -> None:
        """Send a message, which must be taken within ``timeout`` [s]; None: no limit.

        Raise TimeoutError if the other side does not take it in time, OSError if it is gone. No
        other message can follow one that was not taken.
        """
        self._set_timeout(timeout if timeout is None else max(timeout, _MIN_TIMEOUT))
        self._connection.sendall(_HEAD.pack(kind, len(content)) + content)

    def receive(self, max_bytes: int, timeout: float | None = None) -> tuple[bytes, bytes]:
        """Return the kind and the content of the next message.

        ``timeout`` [s] covers the whole message; None: no limit. Raise TimeoutError, after which
        the message can still be received; EOFError if the other side is gone; or OSError if the
        message is longer than ``max_bytes``.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        self._fill(_HEAD.size, deadline)
        kind, length = _HEAD.unpack_from(self._received)
        if length > max_bytes:
            raise OSError(f"a message of {length} bytes, where at most {max_bytes} are allowed")
        self._fill(_HEAD.size + length, deadline)
        del self._received[: _HEAD.size]
        content = bytes(self._received)
        self._received.clear()
        return kind, content

    def _fill(self, count: int, deadline: float | None) -> None:
        """Receive until ``count`` bytes of the message are there."""
        while len(self._received) < count:
            timeout = None
            if deadline is not None:
                timeout = max(deadline - time.monotonic(), _MIN_TIMEOUT)
            self._set_timeout(timeout)
            chunk = self._connection.recv(min(count - len(self._received), _CHUNK))
            if not chunk:
                raise EOFError("the other side has closed the connection")
            self._received += chunk

    def _set_timeout(self, seconds: float | None) -> None:
        # Setting a timeout asks the operating system, even if it is set already, and a confined
        # process may not.
        if self._connection.gettimeout() != seconds:
            self._connection.settimeout(seconds)


def text_of(error: bytes) -> str:
    """Return the text of an error message, which may be a stranger's: nothing else is printed."""
    text = error[:MAX_ERROR].decode("utf-8", "replace")
    return "".join(character if character.isprintable() else "?" for character in text)
