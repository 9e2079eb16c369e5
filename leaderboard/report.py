"""What commands that rank print, and the page that they write."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from leaderboard import table
from leaderboard.ranking import Leaderboard
from turning_env.console import printable
from turning_env.files import write_file

PAGE = "index.html"


def print_tables(
    leaderboards: Sequence[Leaderboard], text_of: Callable[[Leaderboard], str]
) -> None:
    """Print rankings, and costs over splits if there are any."""
    for leaderboard in leaderboards:
        print(text_of(leaderboard) + "\n")
    across = table.across(leaderboards)
    if across is not None:
        print(table.render_across(across) + "\n")


def notify_left_out(leaderboards: Sequence[Leaderboard]) -> None:
    """Name results on other tasks on stderr."""
    left_out = []
    for leaderboard in leaderboards:
        left_out += leaderboard.left_out
    if left_out:
        names = ", ".join(left_out)
        notice = f"left out, as scenario values, seeds or versions differ: {names}"
        print(printable(notice), file=sys.stderr)


def write_page(leaderboards: Sequence[Leaderboard], path: Path) -> None:
    """Write all rankings as one HTML file."""
    from leaderboard import page  # needed only here: imports Jinja2

    write_file(path, page.render(leaderboards))
