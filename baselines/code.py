"""Which code a rule's results depend on."""

import hashlib
from functools import cache
from pathlib import Path

import baselines
import turning_env
from turning_env.numerics.compilation import source_digest


@cache  # what has been imported goes on playing, even if its file is changed meanwhile
def code_digest() -> str:
    """SHA-256 of the Python sources that decide what a rule does on a task."""
    digests = [source_digest(Path(package.__path__[0])) for package in (turning_env, baselines)]
    return hashlib.sha256("".join(digests).encode()).hexdigest()
