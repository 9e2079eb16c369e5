"""From quantities to pixels along one direction, and the part of a bar that is in view."""

from dataclasses import dataclass

from turning_env.scenario import Scenario

_NODES_IN_VIEW = 80
"""More correlation lengths of hardness than these could not be told apart: of such a bar only a page is shown."""


@dataclass(frozen=True)
class Ruler:
    """A linear scale: ``start`` lies at pixel ``first``, ``end`` at ``last``."""

    start: float
    end: float
    first: float
    last: float

    def __call__(self, value: float) -> float:
        """The pixel of a value."""
        return self.first + (value - self.start) / (self.end - self.start) * (self.last - self.first)

    def within(self, value: float) -> float:
        """The pixel of a value, or the end of the scale beyond which it lies."""
        return self(min(max(value, self.start), self.end))


def page_of(scenario: Scenario, along: float) -> tuple[float, float]:
    """From where to where [mm] a bar is shown while the tool is at a place along it: all, or a page of a fine-grained one."""
    workpiece = scenario.workpiece
    size = workpiece.bar_length
    if workpiece.hardness_along_spread > 0.0:
        size = min(size, _NODES_IN_VIEW * workpiece.hardness_correlation_length)
    page = max(min(int(along // size), int((workpiece.bar_length - 1e-9) // size)), 0)
    before = max(0.075 * size, workpiece.approach if size == workpiece.bar_length else 0.0)  # room for the tool
    return page * size - before, (page + 1) * size + 0.025 * size
