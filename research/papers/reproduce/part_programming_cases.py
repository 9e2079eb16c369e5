"""The five typical cases of Sharmazanashvili (2008): limits, formulas along two limits, and control against programming.

    python -m research.papers.reproduce.part_programming_cases

prints the cost of a blank under each kind of control. It takes a few minutes.

The presets `batch_p20`, `batch_k20`, `batch_p30`, `batch_p01` and `batch_m20` hold the slides' limits and costs, with
coefficients of handbooks. Three kinds of control turn the same blanks in each:

* fixed-rule planning: speed and feed of each pass by a rule for the measured blank, on the path that the drawing asks for;
* adaptive real-time control: the same path, speed and feed by the rule every five seconds, from measured force and power;
* adaptive part programming: a new path for the measured blank, speed and feed of each pass by the rule.

Every kind has the margin to the limits, of ``MARGINS``, with which it costs least, as all must allow for hardness.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from tqdm import tqdm

from baselines.models.process import ALIKE, Limit, Process
from baselines.part_planning import RuledParts
from baselines.two_limits import ECONOMIC_OPTIMUM, AdaptiveRule
from research.papers import changed
from research.papers.reproduce.checks import Check, at_most, claim, table
from turning_env import PowerLaw, Scenario
from turning_env.console import described, exits
from turning_env.scoring.play import play
from turning_env.scoring.policy import PolicyFactory
from turning_env.scoring.seeds import tuning_seeds

CASES = {
    "batch_p20": (3000.0, 400.0),
    "batch_k20": (3000.0, 700.0),
    "batch_p30": (3000.0, 700.0),
    "batch_p01": (3000.0, 700.0),
    "batch_m20": (2500.0, 700.0),
}
"""Presets with the slides' [P_z] and [P_y] [N] (there "30 n" and so on, taken as 100 N each)."""
ROUGHNESS, CHANGE_TIME, EDGE_COST = (
    0.002,
    2.0,
    6.7,
)  # the slides' [R_z] [mm], tau_I [min] and Q_I [cents]
MACHINE_COST = 10.0  # Q_T [cents/min] (assumption)
KILOGRAM = 9.80665  # newtons in a kilogram of force

EXACT = 1e-9
DEPTHS = np.geomspace(0.2, 10.0, 200)  # depths of cut at which formulas are compared [mm]
MARGINS = (0.6, 0.8, 1.0)
NUM_BLANKS = 40  # blanks that are turned in each case
SMOOTHING = 0.3  # weight of the newest measurement in real-time control [-]


def depth_limits(process: Process) -> dict[str, Limit]:
    """Return the limits without cutting speed, H of the slides' formula."""
    feed = Limit(PowerLaw(coefficient=1.0, feed=1.0), process.feed_range[1])
    found = {
        "P_z": process.thrust_force,
        "P_y": process.further["radial_force"],
        "M": process.torque,
    }
    return found | {"S": feed, "R_z": process.further["roughness"]}


def speed_limits(process: Process, first: Limit) -> dict[str, Limit]:
    """Return the limits with cutting speed, Phi of the slides' formula; the economic life is that along ``first``."""
    speed = Limit(PowerLaw(coefficient=1.0, cutting_speed=1.0), process.cutting_speed_range[1])
    return {"V": speed, "N": process.power, "T": process.life_limit(first)}


@dataclass(frozen=True)
class Along:
    """The cost of metal [min/cm3] along two limits over the depth of cut t [mm]: q = a t^eta + gamma / C_T b t^lambda."""

    a: float
    b: float
    eta: float
    lambda_: float
    price: float  # gamma / C_T

    def __call__(self, depth: Any) -> Any:
        """Return q at depths of cut [mm]."""
        return self.a * depth**self.eta + self.price * self.b * depth**self.lambda_

    @property
    def cheapest_depth(self) -> float | None:
        """Return the depth [mm] with dq/dt = 0; None if the cost rises or falls with depth all along."""
        if self.eta * self.lambda_ > -ALIKE:
            return None
        return float(
            (-self.a * self.eta / (self.price * self.b * self.lambda_))
            ** (1.0 / (self.lambda_ - self.eta))
        )


def printed(process: Process, first: Limit, second: Limit) -> Along:
    """Return a, b, eta and lambda by the slides' formula, with the fractions that the copy garbles restored (alpha_H = 0)."""
    h, phi = first.law, second.law
    log_h, log_phi = (
        float(limit.line(1.0, 1.0, process.mean_wear).room) for limit in (first, second)
    )
    mu, nu, rho = process.life_exponents
    ratio = phi.feed / phi.cutting_speed
    depth_h, depth_phi = h.depth_of_cut / h.feed, phi.depth_of_cut / phi.cutting_speed
    life = Limit(process.wear, process.wear_criterion).line(1.0, 1.0, 1.0).room / process.wear.time
    return Along(
        a=float(np.exp(log_h / h.feed * (ratio - 1.0) - log_phi / phi.cutting_speed)),
        b=float(
            np.exp(
                log_phi / phi.cutting_speed * (mu - 1.0)
                - log_h / h.feed * (ratio * mu - ratio - nu + 1.0)
            )
        ),
        eta=depth_phi + depth_h - 1.0 - depth_h * ratio,
        lambda_=(depth_h * ratio - depth_phi) * (mu - 1.0) - depth_h * (nu - 1.0) + rho - 1.0,
        price=process.edge_price / float(np.exp(life)),
    )


def formula_checks() -> Iterator[Check]:
    """Yield the checks of the slides' formulas in the first case."""
    scenario = Scenario.load("batch_p20")
    process = Process.of(scenario)
    for one, first in depth_limits(process).items():
        for other, second in speed_limits(process, first).items():
            lines = (limit.line(DEPTHS, 1.0, process.mean_wear) for limit in (first, second))
            cost = np.exp(process.log_cost(*next(lines).crossing(next(lines)), DEPTHS, 1.0))
            formula = printed(process, first, second)
            off = float(np.max(np.abs(formula(DEPTHS) / cost - 1.0)))
            yield at_most(
                f"[{one} {other}]: q by a, b, eta and lambda, relative difference", EXACT, off
            )
            around = np.array([0.99, 1.0, 1.01])
            if depth := formula.cheapest_depth:
                yield claim(
                    f"[{one} {other}]: dq/dt = 0 where q is least",
                    int(np.argmin(formula(depth * around))) == 1,
                )
    feed, depth, log = 0.12, 2.5, np.log
    mu, nu, rho = process.life_exponents
    c_t = float(np.exp(process.log_life(log(1.0), log(1.0), 1.0, 1.0)))
    fastest = (c_t / (process.edge_price * (mu - 1.0) * feed**nu * depth**rho)) ** (1.0 / mu)
    costs = process.log_cost(log(fastest * np.array([0.99, 1.0, 1.01])), log(feed), depth, 1.0)
    yield claim("V*: dq/dV = 0 where q is least", int(np.argmin(costs)) == 1)
    first = Limit(PowerLaw(coefficient=1.0, feed=1.0), feed)
    lines = (limit.line(depth, 1.0, 1.0) for limit in (first, process.life_limit(first)))
    yield Check(
        "V*: [m/min], that of [ST]",
        fastest,
        float(np.exp(next(lines).crossing(next(lines))[0])),
        1e-6,
    )
    most = (c_t / (process.edge_price * (nu - 1.0) * 100.0**mu * depth**rho)) ** (1.0 / nu)
    costs = process.log_cost(log(100.0), log(most * np.array([0.99, 1.0, 1.01])), depth, 1.0)
    yield claim("S*: dq/dS = 0 where q is least", int(np.argmin(costs)) == 1)
    speeds = log(np.geomspace(20.0, 2000.0, 20001))
    best = int(np.argmin(process.log_cost(speeds, log(feed), depth, 1.0)))
    life = float(np.exp(process.log_life(speeds[best], log(feed), depth, 1.0)))
    yield Check(
        "T_0: life of least cost along a feed [min]", process.economic_life(first), life, 0.01
    )
    force = float(scenario.material.thrust_force(1.0, feed, depth))
    power = float(scenario.material.power(180.0, feed, depth))
    yield Check("N: V P_z / 6120 [kW]", 180.0 * force / KILOGRAM / 6120.0, power, 1e-3 * power)
    torque = float(scenario.limits.torque(1.0, feed, depth))
    yield Check(
        "M: 0.5e-3 D P_z [N m]", 0.5e-3 * scenario.workpiece.diameter * force, torque, 1e-3 * torque
    )


def case_checks() -> Iterator[Check]:
    """Yield the checks of the presets' limits and costs."""
    for name, (main, radial) in CASES.items():
        scenario = Scenario.load(name)
        economics, most = scenario.economics, scenario.limits
        yield Check(f"case {name}: [P_z] [N]", main, most.thrust_force)
        yield Check(f"case {name}: [P_y] [N]", radial, most.radial_force.most)
        yield Check(f"case {name}: [R_z] [mm]", ROUGHNESS, most.roughness.most)
        yield Check(f"case {name}: tau_I [min]", CHANGE_TIME, economics.edge_change_time)
        yield Check(
            f"case {name}: Q_I [cents] at 10 cents/min",
            EDGE_COST,
            MACHINE_COST * economics.edge_cost,
            1e-9,
        )


def charged(make: PolicyFactory, scenario: Scenario) -> float:
    """Return the time and the charges for edges, overload and breakage [min] per blank."""
    batches = NUM_BLANKS // scenario.workpiece.bars
    episodes = play(make, scenario, tuning_seeds(batches))
    spent = sum(
        float(episodes[f"reward_{term}"].sum()) for term in ("time", "edge", "overload", "breakage")
    )
    return -spent / 60.0 / (batches * scenario.workpiece.bars)


def planned(name: str, corrected: bool) -> tuple[float, float]:
    """Return the least cost of a blank [min] with speed and feed planned for each pass, and its margin."""
    scenario = Scenario.load(name)

    def cost(margin: float) -> float:
        return charged(
            lambda num: RuledParts(scenario, ECONOMIC_OPTIMUM, corrected, margin, margin), scenario
        )

    return min((cost(margin), margin) for margin in MARGINS)


def controlled(name: str) -> tuple[float, float]:
    """Return the least cost of a blank [min] under real-time control on the path as drawn, and its margin.

    Every pass is a row of bars of its own, with its own edges. The first also removes the blanks' metal beyond the drawing.
    """
    scenario = Scenario.load(name)
    drawn, control = (
        scenario.workpiece.depth_of_cut,
        {"action": "set_point", "interval": 5.0, "sub_steps": 10},
    )

    def cost(margin: float, passes: int) -> float:
        bars = {"bars": 2, "depth_of_cut": drawn / passes}
        costs = []
        for spreads in ({}, {"depth_bar_spread": 0.0, "depth_along_spread": 0.0})[:passes]:
            task = changed(
                name, control=control, sensors={"probe": False}, workpiece=bars | spreads
            )
            costs.append(
                charged(
                    partial(
                        AdaptiveRule,
                        task,
                        rule=ECONOMIC_OPTIMUM,
                        margin=margin,
                        smoothing=SMOOTHING,
                    ),
                    task,
                )
            )
        return costs[0] + (passes - 1) * costs[-1] + passes * scenario.machine.return_time

    return min((cost(margin, passes), margin) for margin in MARGINS for passes in (1, 2, 3))


@exits()
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the cost of a blank [min] and the margin [-] by kind of control in each case; return the exit status."""
    argparse.ArgumentParser(
        prog="python -m research.papers.reproduce.part_programming_cases", **described(__doc__)
    ).parse_args(arguments)
    rows = []
    for name in tqdm(CASES, unit="case", disable=None, leave=False):
        fixed, control, programmed = (
            planned(name, corrected=False),
            controlled(name),
            planned(name, corrected=True),
        )
        cells = [f"{cost:.2f} ({margin:.1f})" for cost, margin in (fixed, control, programmed)]
        rows.append([name, *cells, f"{100.0 * (control[0] / programmed[0] - 1.0):.0f} %"])
    heads = (
        "cost of a blank [min] (margin)",
        "planned",
        "real-time control",
        "part programming",
        "psi",
    )
    print(*table(heads, rows), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
