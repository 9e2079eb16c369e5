"""Standard input and output as a protocol that nothing else in the process can disturb."""

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import TextIO


@contextlib.contextmanager
def standard_streams_taken() -> Iterator[tuple[TextIO, TextIO]]:
    """Take standard input and output for a protocol, and leave others none; begin before any policy is loaded.

    Descriptor 0 then is empty, and descriptor 1 goes where standard error goes. So what a policy, a library in C or a program
    that it starts writes to standard output stays out of the protocol. The streams are duplicates that programs do not inherit.
    Out of reach is a policy that looks for the duplicates among the descriptors of its process, to write to them or to close
    them. At the end, everything is as before.
    """
    sys.stdout.flush()
    requests = os.fdopen(os.dup(0), "r", encoding="utf-8")
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    try:
        yield requests, answers
    finally:
        sys.stdout.flush()
        os.dup2(requests.fileno(), 0)
        os.dup2(answers.fileno(), 1)
        requests.close()
        with contextlib.suppress(OSError):  # the other side may be gone
            answers.close()
