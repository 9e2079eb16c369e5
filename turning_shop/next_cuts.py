"""Choose the cuts to measure next: those that tell most about the law that is known least (D-optimal)."""

import itertools
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from turning_env.scenario import Scenario
from turning_shop.fit import Fit
from turning_shop.measurements import COLUMNS
from turning_shop.prediction import LEVEL

Values = NDArray[np.float64]

COUNT = 5
"""Number of cuts."""
LEVELS = 5
"""Number of values of each factor among which cuts are chosen."""
UNKNOWN = 1.0
"""Standard deviation of an exponent that could not be estimated [-]."""
KNOWN = 0.01
"""Relative error within which a law counts as known [-]: no cuts are chosen for it."""


class NextCuts(NamedTuple):
    """Cuts that narrow the widest interval."""

    response: str
    """The law whose interval is widest on this machine."""
    at: dict[str, float]
    """Where it is widest, by factors."""
    before: float
    """The law's interval there: half-width of the logarithm [-]."""
    after: float
    """The same when the cuts have been measured, if rows scatter as before."""
    cuts: list[dict[str, float]]
    """Factors of each cut."""

    def summary(self) -> Iterator[str]:
        """Yield lines of text."""
        where = ", ".join(f"{name} {value:.3g}" for name, value in self.at.items())
        yield (
            f"least known is {self.response}, at {where}: within {_error(self.before)}, "
            f"and within {_error(self.after)} when these cuts have been measured too:"
        )
        units = [f"{name} [{COLUMNS[name].unit}]" for name in self.cuts[0]]
        yield "  " + "  ".join(units)
        for cut in self.cuts:
            yield "  " + "  ".join(f"{value:>{len(unit)}.3g}" for unit, value in zip(units, cut.values(), strict=True))


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
    best: NextCuts | None = None
    for response, fitted in fits.items():
        wanted = dict(ranges)
        if response == "wear":
            wanted["time"] = (float(fitted.factors["time"].min()), float(fitted.factors["time"].max()))
        names = [name for name in fitted.factors if name in wanted]
        found = _choose(fitted, names, wanted)
        if found and np.expm1(found.before) > KNOWN and (best is None or found.before > best.before):
            best = found
    return best


def _choose(fitted: Fit, names: list[str], ranges: Mapping[str, tuple[float, float]]) -> NextCuts | None:
    # Values as they are printed, so that cuts that differ also differ on paper.
    levels = [np.unique([float(f"{value:.3g}") for value in np.geomspace(*ranges[name], LEVELS)]) for name in names]
    grid = np.array(list(itertools.product(*levels)))
    logs = np.column_stack([np.log(fitted.measured)] + [np.log(fitted.factors[name]) for name in names])[:, 1:]
    candidates = np.column_stack([np.ones(len(grid)), np.log(grid) - logs.mean(axis=0)])
    rows = np.column_stack([np.ones(len(logs)), logs - logs.mean(axis=0)])
    variance = fitted.reading_scatter**2
    if variance == 0.0:
        return None
    prior = np.diag([0.0] + [variance / UNKNOWN**2] * len(names))
    information = rows.T @ rows + prior
    quantile = float(stats.t.ppf(0.5 + 0.5 * LEVEL, fitted.degrees))
    before = _half_widths(information, candidates, variance, quantile)
    widest, chosen = int(before.argmax()), list[int]()
    for _ in range(min(COUNT, len(grid))):
        # The determinant grows by the factor 1 + x' M^-1 x.
        gain = _half_widths(information, candidates, 1.0, 1.0)
        gain[chosen] = -1.0  # no cut twice
        index = int(gain.argmax())
        chosen.append(index)
        information = information + np.outer(candidates[index], candidates[index])
    after = _half_widths(information, candidates, variance, quantile)
    at, *cuts = (dict(zip(names, grid[index].tolist(), strict=True)) for index in (widest, *chosen))
    return NextCuts(fitted.response, at, float(before[widest]), float(after[widest]), cuts)


def _half_widths(information: Values, at: Values, variance: float, quantile: float) -> Values:
    """Return half-widths of the intervals of the law's logarithm."""
    return np.asarray(quantile * np.sqrt(variance * np.einsum("ni,ij,nj->n", at, np.linalg.pinv(information), at)))


def _error(half_width: float) -> str:
    """Return the half-width of a logarithm's interval in words; below ``KNOWN`` the law's form decides, not the scatter."""
    factor = np.exp(half_width)
    return f"a factor of {factor:.3g}" if factor - 1.0 > KNOWN else f"{100.0 * KNOWN:g} %"
