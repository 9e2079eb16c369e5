r"""Seeds known only to those who score: a policy that has learned the public seeds by heart cannot know these.

A file holds them, as text with one number per line (``#`` begins a remark) or as a JSON list. The results that are played on them
hold their digest and not the seeds. So that these cannot be found by trying, they should be drawn from all that there are:

    python -c "import secrets; print(*(secrets.randbits(64) for _ in range(256)), sep='\n')" > private_seeds.txt
"""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from leaderboard.result import ResultError, Task
from turning_env.batch.driver import MAX_SEED
from turning_env.files import digest_of
from turning_env.scoring.seeds import HELD_OUT_START

MAX_SEEDS = 1_000_000
MAX_BYTES = 32_000_000
PUBLIC = HELD_OUT_START + MAX_SEEDS
"""Lower seeds are public: policies may have been trained or tuned on them."""


def read_seeds(path: Path) -> list[int]:
    """Read a file of seeds.

    Raises:
        ResultError: it holds something other than different whole numbers of 0 to 2**64 - 1, at least one; names the first that
            is wrong.
        OSError: it cannot be read.
    """
    with path.open("rb") as stream:
        content = stream.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        raise ResultError(f"{path} is larger than {MAX_BYTES} bytes")
    # A JSON list is numbers between brackets and commas.
    words = re.sub(r"#.*|[\[\],]", " ", content.decode("utf-8", "replace")).split()
    for word in words:
        if not (word.isascii() and word.isdecimal() and len(word) <= 20 and int(word) <= MAX_SEED):
            told = repr(word if len(word) <= 60 else word[:60] + "...")
            raise ResultError(f"{path}: {told} is not a whole number of 0 to {MAX_SEED}")
    if not 1 <= len(words) <= MAX_SEEDS:
        raise ResultError(f"{path} holds {len(words)} seeds, but must hold 1 to {MAX_SEEDS}")
    (seed, times), *_ = Counter(map(int, words)).most_common(1)
    if times > 1:
        raise ResultError(f"{path} holds the seed {seed} twice")
    return [int(word) for word in words]


def private_task(task: Task, seeds: Sequence[int]) -> Task:
    """Return a task on private seeds, which names their places in their file and their digest."""
    return task.model_copy(update={"seeds": list(range(len(seeds))), "private": digest_of(list(seeds))})
