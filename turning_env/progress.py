"""The progress of a long command on stderr: a bar in a terminal, otherwise a line at times.

It needs tqdm, which comes with a clone's programs (``make setup``) and the shop.
"""

import math
import sys
import time
from typing import Any

from tqdm import tqdm

LINE_EVERY = 30.0
"""Time between two lines [s]. Shorter commands print none."""
MIN_SHARE = 0.01
"""Share of the steps after which a line foretells the time left: the first steps may compile."""
_DONE = "{desc}: {percentage:.0f} %, {n_fmt} of {total_fmt} {unit}s"
_TIMES = "{elapsed} passed, {remaining} left"


class ProgressLines(tqdm):  # type: ignore[type-arg]
    """Progress as whole lines, for a file or a pipe; see ``progress``."""

    def __init__(self, *args: Any, **options: Any) -> None:
        self._next_line = time.monotonic() + LINE_EVERY
        # By default, tqdm learns how many steps to skip, which delays lines when steps slow down.
        options["miniters"] = 0
        options["bar_format"] = f"{_DONE}, {_TIMES}{{postfix}}"
        super().__init__(*args, **options)

    @property
    def format_dict(self) -> Any:
        """The numbers of a line, without a rate while few steps are done."""
        numbers = dict(super().format_dict)
        if self.total and self.n - self.initial < MIN_SHARE * self.total:
            numbers["rate"] = None
            numbers["initial"] = self.n
        return numbers

    def display(self, msg: str | None = None, pos: int | None = None) -> None:
        """Print a line if the last one is long ago."""
        now = time.monotonic()
        if now < self._next_line:
            return
        self._next_line = now + LINE_EVERY
        print(self, file=self.fp, flush=True)

    def clear(self, nolock: bool = False) -> None:
        """Clear nothing: lines stay."""

    def close(self) -> None:
        """End without a last line."""
        # As if nothing had been shown, so that tqdm ends no bar.
        self.delay = math.inf
        super().close()


class Counter:
    """Sets a bar to numbers that are counted from where it stands now."""

    def __init__(self, bar: "tqdm[Any]") -> None:
        self._bar = bar
        self._start = bar.n

    def __call__(self, count: int) -> None:
        """Show that ``count`` steps were done since this counter was made."""
        self._bar.update(self._start + count - self._bar.n)


def progress(*args: Any, **options: Any) -> "tqdm[Any]":
    """Return a progress bar with tqdm's arguments; without a terminal, it prints lines.

    A line has the steps done, the time left, and the postfix, such as the return of a training.
    """
    if sys.stderr.isatty():
        return tqdm(*args, **options)
    return ProgressLines(*args, **options)
