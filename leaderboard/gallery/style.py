"""What the pictures of the gallery share: sizes, how a policy and a limit look, and the lines that say what is seen."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties

from leaderboard.behaviour import Episode
from turning_env import Scenario
from turning_env.workshop.plot_style import BLUE, GREY, ORANGE, VERMILLION

Played = Mapping[str, Sequence[Episode]]
"""The episodes of each policy, by its label: of all policies with the same seeds."""

WIDTH, PANEL = 7.2, 2.8
"""Width of a page's text, and the least that a panel's title needs [inch]."""
LIMIT: dict[str, Any] = {"color": VERMILLION, "linewidth": 0.9}
"""How a line at a limit looks."""
# Okabe and Ito's colours, and line styles for those who see none. Vermillion is for limits.
_COLOURS = (BLUE, ORANGE, "#009E73", "#CC79A7", "#56B4E9", "#000000")
_STYLES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)))
MAX_POLICIES = len(_COLOURS)
"""More cannot be told apart."""


def with_looks(played: Played) -> list[tuple[str, str, Any]]:
    """Return each policy's label, colour and line style: the same in every picture."""
    return list(zip(played, _COLOURS, _STYLES, strict=False))


def scenario_of(played: Played) -> Scenario:
    """Return the scenario that all play."""
    return next(iter(played.values()))[0].scenario


def all_cut(played: Played) -> bool:
    """Return whether every policy is seen in metal."""
    return all(any(episode.cutting.any() for episode in episodes) for episodes in played.values())


def seeds_of(played: Played) -> str:
    """Return with how many seeds each policy is seen, in words."""
    number = len(next(iter(played.values())))
    return f"{number} seeds" if number > 1 else "1 seed"


def headline(figure: Figure, what: str, how: str) -> None:
    """Write above a picture what it shows, and below it, or as its legend's title, how to read it."""
    figure.suptitle(what, x=0.01, ha="left", fontweight="bold")
    if not figure.legends:
        figure.supxlabel(how, x=0.01, ha="left", fontsize="small", color=GREY)
    else:  # both would lie at the bottom
        figure.legends[0].set_title(how, FontProperties(size="small"))
        figure.legends[0].get_title().set_color(GREY)
