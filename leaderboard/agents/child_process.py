"""Start a process that plays a policy, and end it.

``sandbox.py`` confines such a process and plays a file in it; the control of a machine
(``shop/turning_control/policy_process.py``) plays a user's Python code in one.
"""

import socket
import subprocess
import sys
import weakref
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from leaderboard.agents.messages import Connection


class ChildProcess:
    """A Python process with a connection to this one on its standard input.

    It ends when this object is garbage-collected, or by ``close``.

    Args:
        arguments: Python's command-line arguments.
        options: those of ``subprocess.Popen``.
    """

    def __init__(self, arguments: Sequence[str], **options: Any) -> None:
        end_here, end_there = socket.socketpair()
        with end_there:
            self.process: subprocess.Popen[bytes] = subprocess.Popen(
                [sys.executable, *arguments], stdin=end_there.fileno(), **options
            )
        self.connection = Connection(end_here)
        self.close = weakref.finalize(self, _end, self.process, self.connection)

    def end(self, patience: float = 0.0) -> int:
        """End the process unless it ends by itself within ``patience`` [s]; return its status.

        The status is that of ``subprocess.Popen.returncode``: below 0, a signal ended it.
        """
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(patience)
        self.close()
        return self.process.returncode


def _end(process: "subprocess.Popen[bytes]", connection: Connection) -> None:
    connection.close()
    process.kill()
    process.wait()
