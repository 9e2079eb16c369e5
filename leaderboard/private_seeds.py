r"""Seeds known only to those who score: a policy that has learned the public seeds by heart cannot know these.

A file holds them, as text with one number per line (``#`` begins a remark) or as a JSON list. The results that are played on them
hold their digest and not the seeds. So that these cannot be found by trying, they should be drawn from all that there are:

    python -c "import secrets; print(*(secrets.randbits(64) for _ in range(256)), sep='\n')" > private_seeds.txt
"""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from leaderboard.result import ResultError, Task, digest_of
from turning_env.batch.driver import MAX_SEED
from turning_env.score.seeds import HELD_OUT_START

MAX_SEEDS = 1_000_000
MAX_BYTES = 32_000_000
PUBLIC = HELD_OUT_START + MAX_SEEDS
"""Lower seeds are public: policies may have been trained or tuned on them."""


def read_seeds(path: Path) -> list[int]:
    """Read a file of seeds.

    Raises:
        ResultError: it cannot be read, or holds something other than different whole numbers of 0 to 2**64 - 1, at least one;
            names the first that is wrong.
    """
    try:
        with path.open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
        if len(content) > MAX_BYTES:
            raise ValueError(f"it is larger than {MAX_BYTES} bytes")
        seeds = [_seed(entry) for entry in _entries(content.decode("utf-8"))]
    except OSError as error:
        raise ResultError(f"the seeds of {path} cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise ResultError(f"the seeds of {path} cannot be used: {error}") from error
    if not 1 <= len(seeds) <= MAX_SEEDS:
        raise ResultError(f"{path} holds {len(seeds)} seeds, but must hold 1 to {MAX_SEEDS}")
    (seed, times), *_ = Counter(seeds).most_common(1)
    if times > 1:
        raise ResultError(f"{path} holds the seed {seed} twice")
    return seeds


def private_task(task: Task, seeds: Sequence[int]) -> Task:
    """Return a task on private seeds, which names their places in their file and their digest."""
    return task.model_copy(update={"seeds": list(range(len(seeds))), "private": digest_of(list(seeds))})


def _entries(text: str) -> Sequence[Any]:
    """Return the numbers of a file, not yet checked."""
    if not text.lstrip().startswith(("[", "{")):
        return " ".join(line.partition("#")[0] for line in text.splitlines()).split()
    entries = json.loads(text)
    if not isinstance(entries, list):
        raise ValueError("JSON must be a list of seeds")
    return entries


def _seed(entry: Any) -> int:
    number = int(entry) if isinstance(entry, str) and entry.isascii() and entry.isdecimal() and len(entry) <= 20 else entry
    if type(number) is not int or not 0 <= number <= MAX_SEED:
        told = repr(entry)
        raise ValueError(f"{told if len(told) <= 60 else told[:60] + '...'} is not a whole number of 0 to {MAX_SEED}")
    return number
