"""Pictures of what policies do, for print: each shows one thing, with the same held-out seeds for all policies.

Numbers of what they do belong in ``leaderboard.behaviour``.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure
from tqdm import tqdm

from leaderboard.behaviour import Episode
from leaderboard.gallery import bars, edges
from leaderboard.gallery.style import MAX_POLICIES, Played
from leaderboard.result import ResultError
from turning_env import Scenario
from turning_env.files import replace_file
from turning_env.score.policy import PolicySpec

PICTURES: dict[str, Callable[[Played], Figure | None]] = {
    "operating_point.png": edges.draw_operating_points,
    "bar_entry.png": bars.draw_entries,
    "limits.png": bars.draw_loads,
    "used_life.png": edges.draw_used_life,
    "bars.png": bars.draw_bars,
}
"""File names, and what draws them; it returns None where a picture does not apply to a scenario."""


def play(specs: Sequence[PolicySpec], scenario: Scenario, seeds: Sequence[int]) -> dict[str, list[Episode]]:
    """Play every policy with the same seeds, showing progress; returns the episodes by the policy's label.

    Raises:
        ResultError: there are no policies or too many to tell apart, one is an oracle, which knows more than observations, or
            one cannot play.
    """
    if oracles := [spec.label for spec in specs if spec.kind == "oracle"]:
        raise ResultError(f"{', '.join(oracles)} cannot be drawn: only what acts on observations can")
    if not specs:
        raise ResultError("there is nothing to draw: name a policy or give an agent")
    if len(specs) > MAX_POLICIES:
        raise ResultError(f"{len(specs)} policies cannot be told apart in a picture: at most {MAX_POLICIES}")
    played: dict[str, list[Episode]] = {spec.label: [] for spec in specs}
    with tqdm(total=len(specs) * len(seeds), unit="episode", disable=None) as bar:
        for spec in specs:
            for seed in seeds:
                played[spec.label].append(Episode.of(spec, scenario, seed))
                bar.update()
    return played


def write(played: Played, folder: Path) -> list[Path]:
    """Write every picture that applies into a folder, each whole or not at all; returns the paths.

    Raises:
        ResultError: a file cannot be written.
    """
    written = []
    with rc_context({"font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False}):
        for name, draw in PICTURES.items():
            if figure := draw(played):
                save(figure, folder / name)
                written.append(folder / name)
    return written


def save(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG, whole or not at all.

    Raises:
        ResultError: it cannot be written.
    """
    try:
        replace_file(path, lambda partial: figure.savefig(partial, dpi=200, format="png"))
    except OSError as error:
        raise ResultError(f"{path} cannot be written: {error.strerror}") from error
