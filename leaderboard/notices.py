"""Notices on stderr, each printed once.

A command reads the same files and loads the same agents several times, and would repeat itself.
"""

import sys

from turning_env.console import printable

_printed: set[str] = set()


def notify_once(text: str) -> None:
    """Print a notice on stderr unless this process has printed it before. It may quote a file."""
    if text in _printed:
        return
    _printed.add(text)
    print(printable(text), file=sys.stderr)
