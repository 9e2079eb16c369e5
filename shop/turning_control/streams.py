"""Standard input and output as a protocol that nothing else in the process can disturb."""

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import TextIO

STDIN = 0
STDOUT = 1
STDERR = 2


@contextlib.contextmanager
def standard_streams_taken() -> Iterator[tuple[TextIO, TextIO]]:
    """Yield standard input and output for a protocol, and keep everything else away from them.

    Enter it before any policy is loaded. Standard input then is empty, and what is written to
    standard output goes to standard error. So the protocol stays free of what a policy, a library
    in C or a program that it starts prints. The yielded streams are duplicates, which programs do
    not inherit. At the end, everything is as before.

    A policy may still look for the duplicates among the descriptors of its process, and write to
    them or close them.
    """
    sys.stdout.flush()
    requests = os.fdopen(os.dup(STDIN), "r", encoding="utf-8")
    answers = os.fdopen(os.dup(STDOUT), "w", encoding="utf-8")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, STDIN)
    os.close(nothing)
    os.dup2(STDERR, STDOUT)
    try:
        yield requests, answers
    finally:
        sys.stdout.flush()
        os.dup2(requests.fileno(), STDIN)
        os.dup2(answers.fileno(), STDOUT)
        requests.close()
        with contextlib.suppress(OSError):  # the other side may be gone
            answers.close()
