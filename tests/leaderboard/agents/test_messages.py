"""A message arrives whole or not at all, and waiting has an end."""

import socket
from collections.abc import Iterator

import pytest

from leaderboard.agents.messages import ACT, ANSWER, Connection


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, Connection]]:
    """Return a socket, and the connection at its other end."""
    here, there = socket.socketpair()
    with here, there:
        yield here, Connection(there)


def test_messages_keep_their_bounds(ends: tuple[socket.socket, Connection]) -> None:
    here, there = ends
    Connection(here).send(ACT, b"first")
    Connection(here).send(ANSWER)
    assert there.receive(max_bytes=5) == (ACT, b"first")
    assert there.receive(max_bytes=5) == (ANSWER, b"")


def test_a_late_message_is_received_after_a_timeout(
    ends: tuple[socket.socket, Connection],
) -> None:
    here, there = ends
    # A head is a kind and a length of eight bytes. Each part is late.
    for part in (b"A\x05\0\0", b"\0\0\0\0\0", b"fir"):
        here.sendall(part)
        with pytest.raises(TimeoutError):
            there.receive(max_bytes=5, timeout=0.01)
    here.sendall(b"st")
    assert there.receive(max_bytes=5, timeout=1.0) == (ACT, b"first")


def test_a_message_that_is_too_long_is_refused_before_it_comes(
    ends: tuple[socket.socket, Connection],
) -> None:
    here, there = ends
    here.sendall(b"A" + (10**12).to_bytes(8, "little"))
    with pytest.raises(OSError, match="where at most 5 are allowed"):
        there.receive(max_bytes=5)


def test_sending_to_a_side_that_takes_nothing_has_an_end(
    ends: tuple[socket.socket, Connection],
) -> None:
    _, there = ends
    with pytest.raises(TimeoutError):
        there.send(ACT, bytes(10_000_000), timeout=0.01)


def test_a_side_that_is_gone_is_told_apart_from_a_late_one(
    ends: tuple[socket.socket, Connection],
) -> None:
    here, there = ends
    here.close()
    with pytest.raises(EOFError):
        there.receive(max_bytes=5)
