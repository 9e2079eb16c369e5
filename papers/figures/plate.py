"""A figure with all that is said of it: where it comes from, what it shows, and what of the paper's agrees."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from matplotlib.figure import Figure

from papers.reproduce.checks import Check


def nothing_printed() -> Iterable[Check]:
    """The checks of a figure that has no printed figures beside it."""
    return ()


@dataclass(frozen=True)
class Plate:
    """One figure."""

    name: str
    """Of its files, without suffix."""
    source: str
    """Paper and figure that it stands for."""
    caption: str
    draw: Callable[[], Figure]
    """Called within ``style.for_print``."""
    checks: Callable[[], Iterable[Check]] = nothing_printed
    """What of it the paper prints or states, beside the project's."""
    remark: str = ""
    """What cannot be compared, and why."""

    def agreement(self) -> list[str]:
        """What agrees with the paper and what does not, one line each."""
        checks = list(self.checks())
        lines = []
        if checks:
            agreeing = sum(check.verdict == "ok" for check in checks)
            lines.append(f"Agrees with the paper: {agreeing} of {len(checks)} figures and claims.")
        for check in checks:
            if check.verdict != "ok":
                values = "" if check.relation == "true" else f" paper {check.paper:.4g}, project {check.ours:.4g};"
                lines.append(f"{check.verdict.capitalize()}: {check.what}:{values} {check.not_reproduced}".rstrip(" ;") + ".")
        if self.remark:
            lines.append(self.remark)
        return lines
