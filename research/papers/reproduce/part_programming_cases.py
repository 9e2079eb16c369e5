"""The five typical cases of Sharmazanashvili (2008): limits, formulas and kinds of control.

    python -m research.papers.reproduce.part_programming_cases

prints the cost of a blank under each kind of control. It takes a few minutes.

The presets `batch_p20`, `batch_k20`, `batch_p30`, `batch_p01` and `batch_m20` hold the slides'
limits and costs, with coefficients of handbooks. Three kinds of control turn the same blanks in
each:

* fixed-rule planning: speed and feed of each pass by a rule for the measured blank, on the path
  that the drawing asks for;
* adaptive real-time control: the same path, speed and feed by the rule every five seconds, from
  measured force and power;
* adaptive part programming: a new path for the measured blank, speed and feed of each pass by the
  rule.

Every kind has the margin to the limits, of ``MARGINS``, with which it costs least, as all must
allow for hardness.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from baselines.models.process import ALIKE, Limit, Process
from baselines.part_planning import RuledParts
from baselines.two_limits import ECONOMIC_OPTIMUM, AdaptiveRule
from leaderboard.play import play
from leaderboard.seeds import tuning_seeds
from research.papers import changed
from research.papers.reproduce.checks import Check, aligned_table, at_most, claim
from turning_env import PowerLaw, Scenario
from turning_env.console import described, exits
from turning_env.policy import PolicyFactory


class ForceLimits(NamedTuple):
    """The slides' limits of force in a case."""

    main: float  # [P_z] [N]
    radial: float  # [P_y] [N]


CASES = {
    "batch_p20": ForceLimits(main=3000.0, radial=400.0),
    "batch_k20": ForceLimits(main=3000.0, radial=700.0),
    "batch_p30": ForceLimits(main=3000.0, radial=700.0),
    "batch_p01": ForceLimits(main=3000.0, radial=700.0),
    "batch_m20": ForceLimits(main=2500.0, radial=700.0),
}
"""Presets with the slides' limits of force (there "30 n" and so on, taken as 100 N each)."""
ROUGHNESS = 0.002  # the slides' [R_z] [mm]
CHANGE_TIME = 2.0  # the slides' tau_I [min]
EDGE_COST = 6.7  # the slides' Q_I [cents]
MACHINE_COST = 10.0  # Q_T [cents/min] (assumption)
KILOGRAM = 9.80665  # newtons in a kilogram of force

EXACT = 1e-9
DEPTHS = np.geomspace(0.2, 10.0, num=200)  # depths of cut at which formulas are compared [mm]
AROUND = np.array([0.99, 1.0, 1.01])  # factors on a place where the cost should be least
MARGINS = (0.6, 0.8, 1.0)
MAX_PASSES = 3  # passes that real-time control tries
NUM_BLANKS = 40  # blanks that are turned in each case
SMOOTHING = 0.3  # weight of the newest measurement in real-time control [-]


def depth_limits(process: Process) -> dict[str, Limit]:
    """Return the limits without cutting speed, H of the slides' formula."""
    feed_law = PowerLaw(coefficient=1.0, feed=1.0)
    return {
        "P_z": process.thrust_force,
        "P_y": process.further["radial_force"],
        "M": process.torque,
        "S": Limit(feed_law, process.feed_range[1]),
        "R_z": process.further["roughness"],
    }


def speed_limits(process: Process, first: Limit) -> dict[str, Limit]:
    """Return the limits with cutting speed, Phi of the slides' formula.

    The economic life is that along ``first``.
    """
    speed_law = PowerLaw(coefficient=1.0, cutting_speed=1.0)
    return {
        "V": Limit(speed_law, process.cutting_speed_range[1]),
        "N": process.power,
        "T": process.life_limit(first),
    }


@dataclass(frozen=True)
class Along:
    """The cost of metal [min/cm3] along two limits over the depth of cut t [mm].

    It is q = a t^eta + gamma / C_T b t^lambda.
    """

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
        """Return the depth [mm] with dq/dt = 0; None if the cost rises or falls all along."""
        if self.eta * self.lambda_ > -ALIKE:
            return None
        # a eta t^(eta - 1) + gamma / C_T b lambda t^(lambda - 1) = 0
        falling = -self.a * self.eta
        rising = self.price * self.b * self.lambda_
        ratio = falling / rising
        exponent = 1.0 / (self.lambda_ - self.eta)
        return float(ratio**exponent)


def printed(process: Process, first: Limit, second: Limit) -> Along:
    """Return the cost along two limits by the slides' formula.

    The fractions that the copy garbles are restored, for limits H without cutting speed (alpha_H =
    0). With S = ([H] / C_H)^(1 / beta_H) t^(-gamma_H / beta_H), and V from Phi:

        a = ([H] / C_H)^((beta_Phi / alpha_Phi - 1) / beta_H) / ([Phi] / C_Phi)^(1 / alpha_Phi)
        b = ([Phi] / C_Phi)^((mu - 1) / alpha_Phi)
            / ([H] / C_H)^((beta_Phi mu / alpha_Phi - beta_Phi / alpha_Phi - nu + 1) / beta_H)
        eta = gamma_Phi / alpha_Phi + gamma_H / beta_H - 1
            - gamma_H beta_Phi / (beta_H alpha_Phi)
        lambda = (gamma_H beta_Phi / (beta_H alpha_Phi) - gamma_Phi / alpha_Phi) (mu - 1)
            - gamma_H / beta_H (nu - 1) + rho - 1

    Args:
        process: the process.
        first: limit H, without cutting speed.
        second: limit Phi, with cutting speed.
    """
    h = first.law
    phi = second.law
    first_line = first.line(1.0, 1.0, wear=process.mean_wear)
    second_line = second.line(1.0, 1.0, wear=process.mean_wear)
    log_h = float(first_line.room) / h.feed  # log([H] / C_H) / beta_H
    log_phi = float(second_line.room) / phi.cutting_speed  # log([Phi] / C_Phi) / alpha_Phi
    mu, nu, rho = process.life_exponents
    ratio = phi.feed / phi.cutting_speed
    depth_h = h.depth_of_cut / h.feed
    depth_phi = phi.depth_of_cut / phi.cutting_speed
    both = depth_h * ratio  # gamma_H beta_Phi / (beta_H alpha_Phi)

    log_a = log_h * (ratio - 1.0) - log_phi
    log_b = log_phi * (mu - 1.0) - log_h * (ratio * mu - ratio - nu + 1.0)
    wear_line = Limit(process.wear, process.wear_criterion).line(1.0, 1.0, wear=1.0)
    log_c_t = wear_line.room / process.wear.time
    c_t = float(np.exp(log_c_t))
    return Along(
        a=float(np.exp(log_a)),
        b=float(np.exp(log_b)),
        eta=depth_phi + depth_h - 1.0 - both,
        lambda_=(both - depth_phi) * (mu - 1.0) - depth_h * (nu - 1.0) + rho - 1.0,
        price=process.edge_price / c_t,
    )


def along_checks(process: Process) -> Iterator[Check]:
    """Yield the checks of the slides' formula of cost along two limits."""
    for first_name, first in depth_limits(process).items():
        for second_name, second in speed_limits(process, first).items():
            pair = f"[{first_name} {second_name}]"
            formula = printed(process, first, second)
            first_line = first.line(DEPTHS, 1.0, wear=process.mean_wear)
            second_line = second.line(DEPTHS, 1.0, wear=process.mean_wear)
            log_speed, log_feed = first_line.crossing(second_line)
            log_cost = process.log_cost(log_speed, log_feed, depth_of_cut=DEPTHS, hardness=1.0)
            difference = float(np.max(np.abs(formula(DEPTHS) / np.exp(log_cost) - 1.0)))
            yield at_most(
                f"{pair}: q by a, b, eta and lambda, relative difference", EXACT, ours=difference
            )
            cheapest = formula.cheapest_depth
            if cheapest is not None:
                yield claim(
                    f"{pair}: dq/dt = 0 where q is least",
                    _least_in_middle(formula(cheapest * AROUND)),
                )


def _least_in_middle(costs: Any) -> bool:
    return int(np.argmin(costs)) == len(costs) // 2


def optimum_checks(process: Process) -> Iterator[Check]:
    """Yield the checks of V*, S* and T_0.

    V* = (C_T / (gamma (mu - 1) S^nu t^rho))^(1 / mu)       dq/dV = 0
    S* = (C_T / (gamma (nu - 1) V^mu t^rho))^(1 / nu)       dq/dS = 0
    T_0 = gamma ((alpha nu - beta mu) / (alpha - beta) - 1)
    """
    feed = 0.12
    depth = 2.5
    speed = 100.0
    mu, nu, rho = process.life_exponents
    gamma = process.edge_price
    log_c_t = process.log_life(np.log(1.0), np.log(1.0), depth_of_cut=1.0, hardness=1.0)
    c_t = float(np.exp(log_c_t))

    def log_cost(cutting_speed: Any, feed: Any) -> Any:
        return process.log_cost(
            np.log(cutting_speed),
            np.log(feed),
            depth_of_cut=depth,
            hardness=1.0,
        )

    by_feed = gamma * (mu - 1.0) * feed**nu * depth**rho
    best_speed = (c_t / by_feed) ** (1.0 / mu)
    around_speed = log_cost(best_speed * AROUND, feed)
    yield claim("V*: dq/dV = 0 where q is least", _least_in_middle(around_speed))
    along_feed = Limit(PowerLaw(coefficient=1.0, feed=1.0), feed)
    feed_line = along_feed.line(depth, 1.0, wear=1.0)
    life_line = process.life_limit(along_feed).line(depth, 1.0, wear=1.0)
    log_speed, _ = feed_line.crossing(life_line)
    yield Check(
        "V*: [m/min], that of [ST]",
        best_speed,
        ours=float(np.exp(log_speed)),
        tolerance=1e-6,
    )

    by_speed = gamma * (nu - 1.0) * speed**mu * depth**rho
    best_feed = (c_t / by_speed) ** (1.0 / nu)
    around_feed = log_cost(speed, best_feed * AROUND)
    yield claim("S*: dq/dS = 0 where q is least", _least_in_middle(around_feed))

    log_speeds = np.log(np.geomspace(20.0, 2000.0, num=20001))
    costs = process.log_cost(log_speeds, np.log(feed), depth_of_cut=depth, hardness=1.0)
    cheapest = log_speeds[int(np.argmin(costs))]
    log_life = process.log_life(cheapest, np.log(feed), depth_of_cut=depth, hardness=1.0)
    yield Check(
        "T_0: life of least cost along a feed [min]",
        process.economic_life(along_feed),
        ours=float(np.exp(log_life)),
        tolerance=0.01,
    )


def power_checks(scenario: Scenario) -> Iterator[Check]:
    """Yield the checks of power and torque, N = V P_z / 6120 and M = 0.5e-3 D P_z."""
    feed = 0.12
    depth = 2.5
    speed = 180.0
    # The slides' P_z is in kilograms of force in N, and in newtons in M.
    force = float(scenario.material.thrust_force(1.0, feed, depth_of_cut=depth))
    power = float(scenario.material.power(speed, feed, depth_of_cut=depth))
    yield Check(
        "N: V P_z / 6120 [kW]",
        speed * force / KILOGRAM / 6120.0,
        ours=power,
        tolerance=1e-3 * power,
    )
    torque = float(scenario.limits.torque(1.0, feed, depth_of_cut=depth))
    yield Check(
        "M: 0.5e-3 D P_z [N m]",
        0.5e-3 * scenario.workpiece.diameter * force,
        ours=torque,
        tolerance=1e-3 * torque,
    )


def formula_checks() -> Iterator[Check]:
    """Yield the checks of the slides' formulas in the first case."""
    scenario = Scenario.load("batch_p20")
    process = Process.of(scenario)
    yield from along_checks(process)
    yield from optimum_checks(process)
    yield from power_checks(scenario)


def case_checks() -> Iterator[Check]:
    """Yield the checks of the presets' limits and costs."""
    for name, forces in CASES.items():
        scenario = Scenario.load(name)
        economics = scenario.economics
        limits = scenario.limits
        yield Check(f"case {name}: [P_z] [N]", forces.main, ours=limits.thrust_force)
        yield Check(f"case {name}: [P_y] [N]", forces.radial, ours=limits.radial_force.most)
        yield Check(f"case {name}: [R_z] [mm]", ROUGHNESS, ours=limits.roughness.most)
        yield Check(f"case {name}: tau_I [min]", CHANGE_TIME, ours=economics.edge_change_time)
        yield Check(
            f"case {name}: Q_I [cents] at 10 cents/min",
            EDGE_COST,
            ours=MACHINE_COST * economics.edge_cost,
            tolerance=1e-9,
        )


class Cost(NamedTuple):
    """The least cost of a blank under a kind of control."""

    minutes: float
    margin: float  # factor on the limits with which it costs least [-]


def charged(make_policy: PolicyFactory, scenario: Scenario) -> float:
    """Return the time and the charges for edges, overload and breakage [min] per blank."""
    bars = scenario.workpiece.bars
    batches = NUM_BLANKS // bars
    episodes = play(make_policy, scenario, seeds=tuning_seeds(batches))
    reward = 0.0
    for term in ("time", "edge", "overload", "breakage"):
        of_episodes = episodes[f"reward_{term}"]
        reward += float(of_episodes.sum())
    blanks = batches * bars
    return -reward / 60.0 / blanks


def planned(name: str, corrected: bool) -> Cost:
    """Return the least cost of a blank with speed and feed planned for each pass.

    Args:
        name: name of the case.
        corrected: whether the path is made for the measured blank.
    """
    scenario = Scenario.load(name)

    def cost(margin: float) -> Cost:
        policy = RuledParts(
            scenario,
            ECONOMIC_OPTIMUM,
            corrected=corrected,
            margin=margin,
            first_margin=margin,
        )
        return Cost(charged(lambda num_envs: policy, scenario), margin)

    return min(cost(margin) for margin in MARGINS)


def controlled(name: str) -> Cost:
    """Return the least cost of a blank under real-time control on the path as drawn.

    Every pass is a row of bars of its own, with its own edges. The first also removes the blanks'
    metal beyond the drawing.
    """
    scenario = Scenario.load(name)
    drawn_depth = scenario.workpiece.depth_of_cut

    def cost_of_pass(margin: float, workpiece: dict[str, Any]) -> float:
        task = changed(
            name,
            control={"action": "set_point", "interval": 5.0, "sub_steps": 10},
            sensors={"probe": False},
            workpiece=workpiece,
        )

        def make_policy(num_envs: int) -> AdaptiveRule:
            return AdaptiveRule(
                task, num_envs, rule=ECONOMIC_OPTIMUM, margin=margin, smoothing=SMOOTHING
            )

        return charged(make_policy, task)

    def cost(margin: float, passes: int) -> Cost:
        bars: dict[str, Any] = {"bars": 2, "depth_of_cut": drawn_depth / passes}
        minutes = cost_of_pass(margin, bars)
        if passes > 1:
            # The first pass leaves bars of the same diameter.
            even_bars = bars | {"depth_bar_spread": 0.0, "depth_along_spread": 0.0}
            minutes += (passes - 1) * cost_of_pass(margin, even_bars)
        minutes += passes * scenario.machine.return_time
        return Cost(minutes, margin)

    costs = []
    for margin in MARGINS:
        for passes in range(1, MAX_PASSES + 1):
            costs.append(cost(margin, passes))
    return min(costs)


@exits()
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the cost of a blank [min] and the margin [-] by kind of control in each case."""
    parser = argparse.ArgumentParser(
        prog="python -m research.papers.reproduce.part_programming_cases", **described(__doc__)
    )
    parser.parse_args(arguments)
    heads = [
        "cost of a blank [min] (margin)",
        "planned",
        "real-time control",
        "part programming",
        "psi",
    ]
    lines = []
    for name in tqdm(CASES, unit="case", disable=None, leave=False):
        fixed = planned(name, corrected=False)
        real_time = controlled(name)
        programmed = planned(name, corrected=True)
        cells = [name]
        for cost in (fixed, real_time, programmed):
            cells.append(f"{cost.minutes:.2f} ({cost.margin:.1f})")
        cells.append(f"{100.0 * (real_time.minutes / programmed.minutes - 1.0):.0f} %")
        lines.append(cells)
    print(*aligned_table(heads, lines), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
