"""A process of a network that attacks, as it could after a fault in ONNX Runtime.

See ``test_sandbox.py``.
"""

import ctypes
import json
import os
import resource
import signal
import socket
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from leaderboard.agents import sandbox_child
from leaderboard.agents.messages import Outline
from leaderboard.agents.onnx_session import Floats, OnnxPolicy

HERE = Path()
"""Folder of the attempts."""
LIBC = ctypes.CDLL(None, use_errno=True)
PTRACE_SEIZE = 0x4206  # does not stop who is traced


def native(name: str, *arguments: Any) -> int:
    """Call a function of the C library, past Python. Raise OSError if it fails."""
    result: int = getattr(LIBC, name)(*arguments)
    if result < 0:
        error = ctypes.get_errno()
        raise OSError(error, os.strerror(error))
    return result


def open_after_close() -> None:
    """Free a descriptor, which the next file could take."""
    os.close(1)
    os.open(HERE / "created", os.O_CREAT | os.O_WRONLY)


def write_to_a_free_descriptor() -> None:
    os.write(7, b"to whom it may concern")


def run_a_thread() -> None:
    thread = threading.Thread(target=int)
    thread.start()
    thread.join()


def read_the_parent() -> None:
    """Read eight bytes of the parent's memory."""
    target = ctypes.create_string_buffer(8)
    local = (ctypes.c_void_p * 2)(ctypes.addressof(target), 8)
    native("process_vm_readv", os.getppid(), local, 1, local, 1, 0)


def ask_for_memory() -> None:
    try:
        bytearray(2**33)
    except MemoryError as error:
        raise OSError("no memory") from error


def raise_limits() -> None:
    resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))


ATTEMPTS: dict[str, Callable[[], Any]] = {
    "open after close": open_after_close,
    "open to write": lambda: os.open(HERE / "created", os.O_CREAT | os.O_WRONLY),
    "open to read": lambda: os.open(HERE / "sibling", os.O_RDONLY),
    "truncate": lambda: os.truncate(HERE / "sibling", 0),
    "unlink": lambda: os.unlink(HERE / "sibling"),
    "rename": lambda: os.rename(HERE / "sibling", HERE / "created"),
    "link": lambda: os.link(HERE / "sibling", HERE / "created"),
    "symlink": lambda: os.symlink(HERE / "sibling", HERE / "created"),
    "mkdir": lambda: os.mkdir(HERE / "created"),
    "rmdir": lambda: os.rmdir(HERE / "folder"),
    "mkfifo": lambda: os.mkfifo(HERE / "created"),
    "chmod": lambda: os.chmod(HERE / "sibling", 0),
    "chown": lambda: os.chown(HERE / "sibling", 0, 0),
    "utime": lambda: os.utime(HERE / "sibling", (0, 0)),
    "setxattr": lambda: os.setxattr(HERE / "sibling", "user.mark", b"x"),
    "stat": lambda: os.stat(HERE / "sibling"),
    "list": lambda: os.listdir(HERE),
    "chdir": lambda: os.chdir("/"),
    "memfd": lambda: os.memfd_create("file"),
    "pipe": os.pipe,
    "dup": lambda: os.dup(0),
    "fork": os.fork,
    "native fork": lambda: native("fork"),
    "spawn": lambda: os.posix_spawn(sys.executable, [sys.executable, "-c", ""], {}),
    "execve": lambda: os.execve(sys.executable, [sys.executable, "-c", ""], {}),
    "thread": run_a_thread,
    "socket": socket.socket,
    "socketpair": socket.socketpair,
    "signal the parent": lambda: os.kill(os.getppid(), 0),
    "kill the parent's group": lambda: os.killpg(os.getpgid(os.getppid()), signal.SIGCONT),
    "trace the parent": lambda: native("ptrace", PTRACE_SEIZE, os.getppid(), None, None),
    "read the parent": read_the_parent,
    "watch the parent": lambda: os.pidfd_open(os.getppid()),
    "unshare": lambda: native("unshare", 0x10000000),
    "raise limits": raise_limits,
    "memory": ask_for_memory,
    "write to another descriptor": write_to_a_free_descriptor,
    "io_uring": lambda: native("syscall", 425, 1, ctypes.create_string_buffer(120)),
    "openat2": lambda: native(
        "syscall", 437, -100, b"/etc/passwd", ctypes.create_string_buffer(24), 24
    ),
}
"""Each raises OSError if it is held back."""


class Attacker:
    """A network whose file names the folder in which it tries everything.

    Its outline has the outcome of each attempt.
    """

    def read(self, content: bytes) -> Outline:
        global HERE
        HERE = Path(content.decode())
        outcomes = {}
        for name, attempt in ATTEMPTS.items():
            try:
                outcomes[name] = f"done: {attempt()!r}"
            except (OSError, ValueError, RuntimeError) as error:
                outcomes[name] = f"held back: {error!r}"
        return Outline({"outcomes": json.dumps(outcomes)}, {"observation": 11}, {"action": 2})

    def session(self) -> Any:
        return None

    def act(self, policy: OnnxPolicy, observations: Floats, call: int) -> Floats:
        raise NotImplementedError


def main(memory: int, computing: int, strict: bool) -> None:
    """Serve the parent process."""
    sandbox_child.run(Attacker(), memory, computing)
