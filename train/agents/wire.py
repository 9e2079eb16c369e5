"""Messages between two processes: a letter that says what it is, and bytes. Neither side trusts the other to be quick."""

import socket
import struct
import time

_HEAD = struct.Struct("<cQ")

ANSWER, ERROR = b"K", b"E"
"""What the child says: what was asked for, or why not."""
CONTENT, GO_ON, LANES, RESET, ACT = b"C", b"G", b"L", b"R", b"A"
"""What the child is asked; ``RESET`` is not answered."""


class Wire:
    """One end of a connection.

    Args:
        connection: a socket that is connected.
        patience: how long it may take until a message is taken [s]; None: for ever.
    """

    def __init__(self, connection: socket.socket, patience: float | None = None) -> None:
        self._connection, self._patience = connection, patience

    def send(self, kind: bytes, content: bytes = b"") -> None:
        """Send a message.

        Raises:
            TimeoutError: the other side does not take it in time.
            OSError: it is gone.
        """
        self._connection.settimeout(self._patience)
        self._connection.sendall(_HEAD.pack(kind, len(content)) + content)

    def receive(self, most: int, patience: float | None = None) -> tuple[bytes, bytes]:
        """Wait for a message of at most so many bytes, so long [s]; None: for ever.

        Raises:
            TimeoutError: none has come in time, the whole of it.
            EOFError: the other side is gone.
            OSError: likewise, or what it says is too long.
        """
        until = None if patience is None else time.monotonic() + patience
        self._connection.settimeout(None)
        kind, length = _HEAD.unpack(self._bytes(_HEAD.size, until))
        if length > most:
            raise OSError(f"a message of {length} bytes, where at most {most} are allowed")
        return kind, self._bytes(length, until)

    def close(self) -> None:
        """Hang up."""
        self._connection.close()

    def _bytes(self, count: int, until: float | None) -> bytes:
        found = bytearray(count)
        view, got = memoryview(found), 0
        while got < count:
            if until is not None:
                self._connection.settimeout(max(until - time.monotonic(), 1e-3))
            more = self._connection.recv_into(view[got:])
            if not more:
                raise EOFError("the other side has hung up")
            got += more
        return bytes(found)
