"""Pictures of what policies do, for print: each shows one thing, on the same held-out bars for all."""

from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure
from tqdm import tqdm

from leaderboard.behaviour import Course
from leaderboard.gallery import bar_entry, bars, limits, operating_point, used_life
from leaderboard.gallery.drawing import MAX_POLICIES, Courses
from leaderboard.result import ResultError
from turning_env import Scenario
from turning_env.files import replace_file
from turning_env.score.policy import PolicySpec

PICTURES: dict[str, Callable[[Courses], Figure | None]] = {
    "operating_point.png": operating_point.draw,
    "bar_entry.png": bar_entry.draw,
    "limits.png": limits.draw,
    "used_life.png": used_life.draw,
    "bars.png": bars.draw,
}
"""File names, and what draws them: None where a picture does not apply to a scenario."""


def play(players: Sequence[PolicySpec], scenario: Scenario, draws: Sequence[int]) -> dict[str, list[Course]]:
    """Play every policy on the same draws, with a progress bar.

    Raises:
        ResultError: there are none or too many to tell apart, one is a reference, which acts on more than observations, or one
            cannot play.
    """
    contestants = [player for player in players if isinstance(player, PolicySpec)]
    if others := [player.label for player in players if not isinstance(player, PolicySpec)]:
        raise ResultError(f"{', '.join(others)} cannot be drawn: only what acts on observations can")
    if not contestants:
        raise ResultError("there is nothing to draw: name a policy or give an agent")
    if len(contestants) > MAX_POLICIES:
        raise ResultError(f"{len(contestants)} policies cannot be told apart in a picture: at most {MAX_POLICIES}")
    courses: dict[str, list[Course]] = {contestant.label: [] for contestant in contestants}
    with tqdm(total=len(contestants) * len(draws), unit="episode", disable=None) as bar:
        for contestant in contestants:
            for draw in draws:
                courses[contestant.label].append(Course.of(contestant, scenario, draw))
                bar.update()
    return courses


def write(courses: Courses, folder: Path) -> list[Path]:
    """Write every picture that applies into a folder, each whole or not at all; returns the paths.

    Raises:
        ResultError: a file cannot be written.
    """
    written = []
    with rc_context({"font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False}):
        for name, draw in PICTURES.items():
            figure = draw(courses)
            if figure is not None:
                _save(figure, folder / name)
                written.append(folder / name)
    return written


def _save(figure: Figure, path: Path) -> None:
    try:
        replace_file(path, lambda partial: figure.savefig(partial, dpi=200, format="png"))
    except OSError as error:
        raise ResultError(f"{path} cannot be written: {error.strerror}") from error
