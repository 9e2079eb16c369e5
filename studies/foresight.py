"""Measure how far ahead a policy must look on a family's jobs, and what it must know of wear.

    python -m studies.foresight
    python -m studies.foresight --split unseen_materials --jobs 64

The loads are known and the bars nominal, so that only the use of edges is left: at every used life D, a policy chooses speed and
feed, or changes the edge. Dynamic programming over D finds the policy that is best by a discount per second and by a law of
wear. The table has what it loses by the true law, undiscounted, to the policy that is best over the whole job. Rewards are the
environment's: an edge is charged as it is used, and its change takes time.

Laws of wear: the truth; the catalogue's, scaled to the wear that a first edge shows at the catalogue's best set point; the
catalogue's. For the last two, an edge may be worn out before it is changed, and the machine stops, so a margin is added.
"""

import argparse
import math
import sys
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from turning_env import Family
from turning_env.console import described, exits
from turning_env.scenario.family import CHUNK
from turning_env.scenario.plan import MIDDLE, Loads
from turning_env.scoring.statistics import Bootstrap, Estimate

Array = NDArray[np.float64]
Places = NDArray[np.int64]

CELLS = 40
"""Cells of used life."""
WHOLE_JOB = 0.99999
"""Discount per second of the policy that the others are compared with: 28 hours."""
DISCOUNTS = (0.5, 0.9, 0.99, 0.997, 0.999, 0.9997)
MARGINS = (1.0, 1.1, 1.25, 1.5, 2.0)
"""Factors on a rate of wear that is not the truth; the best on average is taken."""
_HALVINGS = 40
_ROUNDING = 1e-6  # of a cell: lives add up to the ends of cells, but for rounding
_LONGEST = 100 * CELLS  # steps of a play


class Plan(NamedTuple):
    """The value of every used life by a discount and a law of wear; arrays of shape (jobs, set points) but for ``value``."""

    rate: Array
    """Rate of used life [1/s]."""
    paid: Array
    """Discounted time in a cell [s]."""
    remains: Array
    """Discount over a cell [-]."""
    value: Array
    """Value at the beginning of every cell, and of changing an edge at the end of its life [s]; shape (CELLS + 1, jobs)."""


class Edges:
    """The use of edges on some jobs. Arrays have shape (jobs,), (jobs, set points) or (CELLS, jobs, set points).

    Args:
        family: family of the jobs.
        split: name of the split.
        jobs: number of jobs, at most CHUNK.
    """

    def __init__(self, family: Family, split: str, jobs: int) -> None:
        draw = family.draw(split, 0)
        true = draw.true
        loads, nominal = Loads(true, CHUNK), Loads(true.nominal(), CHUNK)
        economics, chosen = true.economics, slice(jobs)

        def rates(of: Loads) -> Array:
            return of.life_rate[chosen].reshape(jobs, -1) / 60.0  # [1/s]

        def seconds(minutes: object) -> Array:
            return 60.0 * np.broadcast_to(np.asarray(minutes, np.float64), CHUNK)[chosen]

        self.true_rate, self.nominal_rate = rates(loads), rates(nominal)
        self._edge, self._change = seconds(economics.edge_cost), seconds(economics.edge_change_time)
        self._stop, self._time = seconds(economics.unplanned_stop), seconds(true.control.time_limit)
        metal = loads.removal / np.reshape(economics.reference_removal_rate, (-1, 1, 1))
        excess = [np.maximum(loads.excess((k + 0.5) / CELLS), 0.0) for k in range(CELLS)]
        value = [metal - 1.0 - economics.overload_price * each for each in excess]
        self._gain = np.stack([each[chosen].reshape(jobs, -1) for each in value])  # per second, without the edge
        self._jobs = np.arange(jobs)
        row, column = nominal.nearest(draw.plan.speed[:, MIDDLE], draw.plan.feed[:, MIDDLE])
        best = (row * nominal.feed.shape[2] + column)[chosen]
        shown = self.true_rate[self._jobs, best] / self.nominal_rate[self._jobs, best]
        self.shown_rate = self.nominal_rate * shown[:, None]

    def plan(self, discount: float, rate: Array) -> "Plan":
        """Return the best plan by a discount per second and by a rate of used life [1/s]."""
        decay = -math.log(discount)  # [1/s]
        remains = np.exp(-decay / CELLS / rate)
        paid = (1.0 - remains) / decay
        standing = np.exp(-decay * self._change)
        most = (np.abs(self._gain).max() + self._edge.max() * rate.max()) / decay
        low, high = np.full(len(self._jobs), -most), np.full(len(self._jobs), most)
        plan = Plan(rate, paid, remains, np.empty((CELLS + 1, len(self._jobs))))
        for _ in range(_HALVINGS):  # a fresh edge's value V solves V = f(V), and f grows by less than V
            fresh = 0.5 * (low + high)
            plan.value[CELLS] = standing * fresh - (1.0 - standing) / decay
            for k in reversed(range(CELLS)):
                cells = np.full(len(self._jobs), k)
                _, going_on = self._best(plan, cells, cells)
                plan.value[k] = np.maximum(going_on, self._discarded(plan, cells)) if k else going_on
            grows = plan.value[0] > fresh
            low, high = np.where(grows, fresh, low), np.where(grows, high, fresh)
        return plan

    def _best(self, plan: "Plan", believed: Places, true: Places) -> tuple[Places, Array]:
        """Return the place of the best set point, and the value of going on with it, in cells of used life."""
        rewards = self._gain[true, self._jobs] - self._edge[:, None] * plan.rate
        gains = plan.paid * rewards + plan.remains * plan.value[believed + 1, self._jobs][:, None]
        place = gains.argmax(axis=1)
        return place, gains[self._jobs, place]

    def _discarded(self, plan: "Plan", believed: Places) -> Array:
        """Return the value of changing the edge now."""
        return np.asarray(plan.value[CELLS] - self._edge * (1.0 - believed / CELLS))

    def returns(self, plan: "Plan") -> Array:
        """Return what a plan earns in every job [s], undiscounted. Loads are measured, so it knows their true limits."""
        earned, time, believed, true = np.zeros((4, len(self._jobs)))
        worn, cutting = np.zeros((2, len(self._jobs)), np.bool_)
        cutting[:] = True
        for _ in range(_LONGEST):
            cells = [np.minimum((life * CELLS + _ROUNDING).astype(np.int64), CELLS - 1) for life in (believed, true)]
            place, going_on = self._best(plan, *cells)
            keeps = (cells[0] == 0) | (going_on >= self._discarded(plan, cells[0]))
            cutting &= keeps & (believed < 1.0 - 1e-9) & ~worn
            if not cutting.any():
                break
            rates = plan.rate[self._jobs, place], self.true_rate[self._jobs, place]
            step = np.where(cutting, 0.5 / CELLS / np.maximum(*rates), 0.0)
            earned += self._gain[cells[1], self._jobs, place] * step
            time, believed, true = time + step, believed + rates[0] * step, true + rates[1] * step
            worn |= (true > 1.0 - 1e-9) & (believed < 1.0 - 1e-9)
        lost = self._change + np.where(worn, self._stop, 0.0)
        return np.asarray((earned - self._edge - lost) / (time + lost) * self._time)


def losses(edges: Edges) -> Iterator[tuple[str, Array]]:
    """Yield what is lost by looking less far ahead, and by knowing less of wear, in every job [s]."""

    def reached(discount: float, rate: Array) -> Array:
        return edges.returns(edges.plan(discount, rate))

    best = reached(WHOLE_JOB, edges.true_rate)
    for discount in DISCOUNTS:
        yield f"discount {discount:g}, {1.0 / (1.0 - discount):.0f} s", best - reached(discount, edges.true_rate)
    for name, rate in (("the first edge's wear", edges.shown_rate), ("the catalogue's wear", edges.nominal_rate)):
        yield name, best - max((reached(WHOLE_JOB, margin * rate) for margin in MARGINS), key=np.mean)


@exits(ValueError)
def main(arguments: list[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.foresight", **described(__doc__))
    parser.add_argument("--family", default="shop", help="family, or its TOML file (default: %(default)s)")
    parser.add_argument("--split", default="train", help="split (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=CHUNK, help="number of jobs (default: %(default)s)")
    parsed = parser.parse_args(arguments)
    if not 1 <= parsed.jobs <= CHUNK:
        parser.error(f"--jobs is {parsed.jobs}, but must be 1 to {CHUNK}")
    edges, bootstrap = Edges(Family.load(parsed.family), parsed.split, parsed.jobs), Bootstrap(parsed.jobs)
    lines = [f"{'looks ahead by, or knows':26}  {'loss [s]':>8}  {'95 %':>14}  {'median':>6}"]
    for name, loss in tqdm(losses(edges), total=len(DISCOUNTS) + 2, unit="row", disable=None, leave=False):
        mean = Estimate.of(float(loss.mean()), bootstrap.means(loss[np.newaxis], name))
        interval = f"{mean.low:.0f} to {mean.high:.0f}"
        lines.append(f"{name:26}  {mean.value:8.0f}  {interval:>14}  {np.median(loss):6.0f}")
    print("\n".join(lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
