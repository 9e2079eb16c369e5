"""Choose the cuts to measure next: those that tell most about the law that is known least (D-optimal)."""

import itertools
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from scipy import stats

from turning_env.scenario import Scenario
from turning_shop import Values, aligned
from turning_shop.fit import Fit
from turning_shop.measurements import COLUMNS
from turning_shop.prediction import LEVEL

COUNT = 5
"""Number of cuts."""
LEVELS = 5
"""Number of values of each factor among which cuts are chosen."""
UNKNOWN = 1.0
"""Standard deviation of an exponent that could not be estimated [-]."""
KNOWN = 0.01
"""Relative error within which a law counts as known [-]: no cuts are chosen for it."""


class NextCuts(NamedTuple):
    """Cuts that narrow the widest interval.

    Attributes:
        response: The law whose interval is widest on this machine.
        at: Factors at which the interval is widest.
        before: The law's interval there: half-width of the logarithm [-].
        after: The same when the cuts have been measured, if rows scatter as before.
        cuts: Factors of each cut.
    """

    response: str
    at: dict[str, float]
    before: float
    after: float
    cuts: list[dict[str, float]]

    def summary(self) -> Iterator[str]:
        """Yield lines of text."""
        where = ", ".join(f"{name} {value:.3g}" for name, value in self.at.items())
        # Below KNOWN the law's form decides, not the scatter.
        within = [f"a factor of {np.exp(half):.3g}" if np.expm1(half) > KNOWN else f"{100 * KNOWN:g} %" for half in self[2:4]]
        promise = f"within {within[0]}, and within {within[1]} when these cuts have been measured too:"
        yield f"least known is {self.response}, at {where}: {promise}"
        heads = [f"{name} [{COLUMNS[name].unit}]" for name in self.at]
        yield from aligned([["", *heads], *(["", *(f"{value:.3g}" for value in cut.values())] for cut in self.cuts)])


def next_cuts(fits: Mapping[str, Fit], base: Scenario) -> NextCuts | None:
    """Return the cuts that tell most about the law whose interval is widest over the machine's range; None if all are known."""
    machine, work, criterion = base.machine, base.workpiece, base.tool.wear_criterion
    depths = tuple(filter(None, work.depth_profile)) or (work.depth_of_cut,)
    swing = 2.0 * np.hypot(work.depth_bar_spread, work.depth_along_spread)
    ranges = {
        "cutting_speed": (machine.cutting_speed_min, machine.cutting_speed_max),
        "feed": (machine.feed_min, machine.feed_max),
        "depth_of_cut": (max(min(depths) - swing, 0.3 * min(depths)), max(depths) + swing),
        "wear": (0.2 * criterion, criterion),
    }
    if wear := fits.get("wear"):
        ranges["time"] = float(wear.factors["time"].min()), float(wear.factors["time"].max())
    found = [_choose(fitted, ranges) for fitted in fits.values() if fitted.reading_scatter > 0.0]
    widest = max(found, key=lambda each: each.before, default=None)
    return widest if widest and np.expm1(widest.before) > KNOWN else None


def _choose(fitted: Fit, ranges: Mapping[str, tuple[float, float]]) -> NextCuts:
    names = [name for name in fitted.factors if name in ranges]
    # Values as they are printed, so that cuts that differ also differ on paper.
    levels = [np.unique([float(f"{value:.3g}") for value in np.geomspace(*ranges[name], LEVELS)]) for name in names]
    grid = np.array(list(itertools.product(*levels)))
    logs = np.log(np.column_stack([fitted.factors[name] for name in names]))
    candidates, rows = (np.column_stack([np.ones(len(x)), x - logs.mean(axis=0)]) for x in (np.log(grid), logs))
    variance = fitted.reading_scatter**2
    information = rows.T @ rows + np.diag([0.0] + [variance / UNKNOWN**2] * len(names))
    quantile = float(stats.t.ppf(0.5 + 0.5 * LEVEL, fitted.degrees)) * fitted.reading_scatter

    def half_widths() -> Values:
        """Return half-widths of the intervals of the law's logarithm at the candidates."""
        return np.asarray(quantile * np.sqrt(((candidates @ np.linalg.pinv(information)) * candidates).sum(axis=1)))

    before = half_widths()
    widest, chosen = int(before.argmax()), list[int]()
    for _ in range(min(COUNT, len(grid))):
        gain = half_widths()  # the information's determinant grows by the factor 1 + x' M^-1 x
        gain[chosen] = -1.0  # no cut twice
        chosen.append(int(gain.argmax()))
        information = information + np.outer(candidates[chosen[-1]], candidates[chosen[-1]])
    at, *cuts = (dict(zip(names, grid[index].tolist(), strict=True)) for index in (widest, *chosen))
    return NextCuts(fitted.response, at, float(before[widest]), float(half_widths()[widest]), cuts)
