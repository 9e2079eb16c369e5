"""What commands that rank print, and the page that they write."""

import sys
from collections.abc import Sequence
from pathlib import Path

from leaderboard import table
from leaderboard.ranking import Leaderboard
from turning_env.console import printable
from turning_env.files import write_file

PAGE = "index.html"


def print_all(leaderboards: Sequence[Leaderboard]) -> None:
    """Print all numbers of leaderboards, and costs over splits if there are any."""
    for leaderboard in leaderboards:
        print(table.render(leaderboard) + "\n")
    across = table.across(leaderboards)
    if across is not None:
        print(table.render_across(across) + "\n")


def print_one_table(leaderboards: Sequence[Leaderboard]) -> None:
    """Print costs over splits if there are any, and otherwise the ranking of the first task."""
    across = table.across(leaderboards) if len(leaderboards) > 1 else None
    if across is not None:
        print(table.render_across(across) + "\n")
    else:
        print(table.ranking_table(leaderboards[0]) + "\n")


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
