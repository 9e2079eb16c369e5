"""The causal oracle of whole parts: the cheapest plan of each blank, measured without error.

Before a part, the oracle knows depth and hardness all along the present blank, and wear factor and
strength of the present edge. It does not know the next blanks and edges. The rules of
``baselines/part_planning.py`` know the mean depth only, take a speed and feed from two limits, and
keep a margin to them.

A plan is a number of passes, the allowance of the path, and cutting speed and feed of each pass.
The search takes every number of passes and some allowances. For each pass it narrows a grid of
speeds and feeds down to the least cost in machine time [min]:

    minutes (1 + overload price x mean excess) + price of an edge x used life

The price of an edge includes the stop to change it, as every edge here wears out in the end. In a
plan, the wear of an edge goes on at its factor.

The blanks follow from a seed, so the oracle is built from the seeds of its environments.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from baselines.oracles.cells import LOG_DEPTH, LOG_HARDNESS, start_episode_of, survey
from baselines.part_planning import plan
from baselines.rule import Mask
from turning_env import PowerLaw, Scenario
from turning_env.numerics.compilation import compiled, compiled_entry
from turning_env.numerics.functions import exp, log, real_power
from turning_env.physics.records import block_records
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario.laws import edge_price

VERSION = 1  # raised when its actions change
CELLS = 60  # of a blank
ALLOWANCES = np.linspace(0.6, 1.4, 9)  # of the path, over the blank's mean depth [-]
POINTS = 7  # of a grid along one axis
ROUNDS = 4  # of narrowing: each grid is a third as wide as the one before


class LoadLaw(NamedTuple):
    """A response over its limit, coefficient V^a f^b d^c H^h [-]."""

    coefficient: float
    cutting_speed: float
    feed: float
    depth_of_cut: float
    hardness: float


class PlanningTask(NamedTuple):
    """Laws and ranges by which the plans of a scenario are compared."""

    force: LoadLaw
    power: LoadLaw
    wear: LoadLaw  # used life per minute of cutting [1/min]
    log_speeds: tuple[float, float]  # range of cutting speeds [log m/min]
    log_feeds: tuple[float, float]  # range of feeds [log mm/rev]
    crossing: float  # time of a pass at 1 m/min and 1 mm/rev, without its return [min]
    in_metal: float  # share of it that cuts [-]
    return_time: float  # [min]
    overload_price: float  # [-]
    edge_price: float  # [min]
    breakage_price: float  # [min]


class Blank(NamedTuple):
    """A blank and the edge that cuts it."""

    depth: Any  # allowance of each cell [mm]
    hardness: Any  # of each cell [-]
    life_factor: float  # used life over that of a nominal edge [-]
    strength: float  # of the edge over the force limit [-]


class UnitPass(NamedTuple):
    """A pass at 1 m/min and 1 mm/rev, arrays of shape (cells,); 0 in air."""

    force: Any  # over its limit [-]
    power: Any  # over its limit [-]
    life: Any  # used life per minute [1/min]


class SetPoint(NamedTuple):
    """The set point of a pass, and its cost."""

    log_speed: float  # [log m/min]
    log_feed: float  # [log mm/rev]
    cost: float  # [min]


class BlankPlan(NamedTuple):
    """The plan of a blank."""

    passes: int
    allowance: float  # of the path [mm]
    cost: float  # [min]


class PerfectBlanks(Policy):
    """Plan every part for the true blank. Call ``tell`` before every action.

    Args:
        scenario: task, for which ``covers`` is true.
        seeds: seed of each environment. The policy plays their first episodes.
    """

    def __init__(self, scenario: Scenario, seeds: Sequence[int]) -> None:
        self._scenario = scenario
        self._task = _task(scenario)
        # Shape (num_envs, 3, bars * CELLS).
        self._fields = np.stack([_fields(scenario, seed) for seed in seeds])
        self._part = np.zeros(len(seeds), np.int64)
        self._truth: Mapping[str, Any] = {}

    def tell(self, infos: Mapping[str, Any]) -> None:
        """Take the ``infos`` of the vector environment that came with the next observations."""
        self._truth = infos

    def reset(self, mask: Mask) -> None:
        self._part[mask] = 0

    def act(self, observations: Observations) -> Actions:
        scenario = self._scenario
        count = len(observations)
        passes = np.ones(count)
        allowance = np.empty(count)
        shape = (count, scenario.control.passes_max)
        # Set points of passes that a plan does not have do not matter.
        log_speeds = np.full(shape, self._task.log_speeds[0])
        log_feeds = np.full(shape, self._task.log_feeds[0])
        for env_index in range(count):
            blank = self._blank(env_index)
            candidates = ALLOWANCES * blank.depth.mean()
            # It writes the set points of its passes into the rows of this environment.
            best = best_plan(
                blank, self._task, candidates, log_speeds[env_index], log_feeds[env_index]
            )
            passes[env_index] = best.passes
            allowance[env_index] = best.allowance
        self._part += 1
        return plan(
            scenario,
            passes,
            allowance=allowance,
            cutting_speed=exp(log_speeds),
            feed=exp(log_feeds),
        )

    def _blank(self, env_index: int) -> Blank:
        """Return the blank that an environment cuts next, and its edge."""
        part = self._part[env_index] % self._scenario.workpiece.bars
        first_cell = part * CELLS
        cells = slice(first_cell, first_cell + CELLS)
        fields = self._fields[env_index]
        wear_factor = float(self._truth["wear_factor"][env_index])
        strength = float(self._truth["edge_strength"][env_index])
        # Wear grows as W_max D^n: a factor on wear is its n-th root on the used life D.
        life_factor = real_power(wear_factor, 1.0 / self._scenario.material.wear.time)
        return Blank(
            depth=exp(fields[LOG_DEPTH, cells]),
            hardness=exp(fields[LOG_HARDNESS, cells]),
            life_factor=float(life_factor),
            strength=strength / self._scenario.limits.thrust_force,
        )


def _fields(scenario: Scenario, seed: int) -> Any:
    """Return the true fields of a seed's blanks, shape (3, bars * CELLS)."""
    states, parameters, scratches = block_records(scenario)
    states["seed"][0, 0] = seed
    start_episode_of(states, parameters, scratches)
    fields = np.empty((3, scenario.workpiece.bars * CELLS))
    survey(states, parameters, scratches, fields, CELLS)
    return fields


def _task(scenario: Scenario) -> PlanningTask:
    """Return the laws, ranges and prices of a scenario."""
    economics = scenario.economics
    machine = scenario.machine
    work = scenario.workpiece
    exponent = scenario.material.wear.time
    change = edge_price(scenario)
    pitch = work.bar_length + work.approach
    return PlanningTask(
        force=_load(scenario.material.thrust_force, scenario.limits.thrust_force),
        power=_load(scenario.material.power, scenario.limits.power),
        # A constant cut uses the life t (K / W_max)^(1 / n) in a time t (``physics/wear.py``).
        wear=_load(scenario.material.wear, scenario.tool.wear_criterion, 1.0 / exponent),
        log_speeds=(float(log(machine.cutting_speed_min)), float(log(scenario.cutting_speed_max))),
        log_feeds=(float(log(machine.feed_min)), float(log(machine.feed_max))),
        crossing=float(np.pi * work.diameter * pitch / 1000.0),
        in_metal=work.bar_length / pitch,
        return_time=machine.return_time,
        overload_price=economics.overload_price,
        edge_price=change + economics.unplanned_stop,
        breakage_price=change + economics.breakage_downtime,
    )


def _load(law: PowerLaw, limit: float, power: float = 1.0) -> LoadLaw:
    """Return a law over its limit, raised to a power."""
    return LoadLaw(
        coefficient=float(exp(power * (law.log_coefficient - log(limit)))),
        cutting_speed=power * law.cutting_speed,
        feed=power * law.feed,
        depth_of_cut=power * law.depth_of_cut,
        hardness=power * law.hardness,
    )


@compiled_entry
def best_plan(blank, task, allowances, log_speeds, log_feeds):  # type: ignore[no-untyped-def]
    """Return the cheapest ``BlankPlan``, and set log speed and log feed of its passes.

    Args:
        blank: a ``Blank``, with its edge.
        task: prices and laws, a ``PlanningTask``.
        allowances: allowances of the path that are compared [mm].
        log_speeds: log cutting speeds to set [log m/min], shape (passes_max,).
        log_feeds: log feeds to set [log mm/rev], likewise.
    """
    passes_max = len(log_speeds)
    speeds = np.empty(passes_max)
    feeds = np.empty(passes_max)
    best = BlankPlan(0, 0.0, np.inf)
    for passes in range(1, passes_max + 1):
        for allowance in allowances:
            cost = 0.0
            for number in range(passes):
                cut = cut_of_pass(blank, task, passes, allowance, number)
                set_point = cheapest(cut, blank, task)
                speeds[number] = set_point.log_speed
                feeds[number] = set_point.log_feed
                cost += set_point.cost
                # Costs are positive: the rest of the passes cannot make this plan the best.
                if cost >= best.cost:
                    break
            if cost < best.cost:
                best = BlankPlan(passes, allowance, cost)
                log_speeds[:passes] = speeds[:passes]
                log_feeds[:passes] = feeds[:passes]
            if passes == 1:
                break  # a single pass cuts the whole blank, whatever its path's allowance
    return best


@compiled
def cut_of_pass(blank, task, passes, allowance, number):  # type: ignore[no-untyped-def]
    """Return the ``UnitPass`` of a pass; the first has the number 0 and cuts all above its floor.

    The path has ``passes`` passes of one depth through an ``allowance`` [mm].
    """
    pitch = allowance / passes
    floor = (passes - 1 - number) * pitch
    ceiling = np.inf if number == 0 else floor + pitch
    cells = len(blank.depth)
    cut = UnitPass(np.zeros(cells), np.zeros(cells), np.zeros(cells))
    for k in range(cells):
        depth = min(blank.depth[k], ceiling) - floor
        if depth > 0.0:
            log_depth = log(depth)
            log_hardness = log(blank.hardness[k])
            cut.force[k] = at_unit_set_point(task.force, log_depth, log_hardness)
            cut.power[k] = at_unit_set_point(task.power, log_depth, log_hardness)
            life = at_unit_set_point(task.wear, log_depth, log_hardness)
            cut.life[k] = life * blank.life_factor
    return cut


@compiled
def at_unit_set_point(load, log_depth, log_hardness):  # type: ignore[no-untyped-def]
    """Return a load at 1 m/min and 1 mm/rev."""
    return load.coefficient * exp(load.depth_of_cut * log_depth + load.hardness * log_hardness)


@compiled
def cheapest(cut, blank, task):  # type: ignore[no-untyped-def]
    """Return the cheapest ``SetPoint`` of a pass, by grids that narrow around the best point."""
    speed_low, speed_high = task.log_speeds
    feed_low, feed_high = task.log_feeds
    best = SetPoint(speed_low, feed_low, np.inf)
    for _ in range(ROUNDS):
        speed_step = (speed_high - speed_low) / (POINTS - 1)
        feed_step = (feed_high - feed_low) / (POINTS - 1)
        for row in range(POINTS):
            for column in range(POINTS):
                log_speed = speed_low + row * speed_step
                log_feed = feed_low + column * feed_step
                cost = cost_of_pass(cut, blank, task, log_speed, log_feed)
                if cost < best.cost:
                    best = SetPoint(log_speed, log_feed, cost)
        # The next grid reaches from one neighbour of the best point to the other.
        speed_low = max(best.log_speed - speed_step, task.log_speeds[0])
        speed_high = min(best.log_speed + speed_step, task.log_speeds[1])
        feed_low = max(best.log_feed - feed_step, task.log_feeds[0])
        feed_high = min(best.log_feed + feed_step, task.log_feeds[1])
    return best


@compiled
def cost_of_pass(cut, blank, task, log_speed, log_feed):  # type: ignore[no-untyped-def]
    """Return the cost [min] of a pass at a set point [log m/min], [log mm/rev]."""
    force_factor = at_set_point(task.force, log_speed, log_feed)
    power_factor = at_set_point(task.power, log_speed, log_feed)
    highest = 0.0
    excess = 0.0
    life = 0.0
    cells = len(cut.force)
    for k in range(cells):
        force = force_factor * cut.force[k]
        highest = max(highest, force)
        excess += max(force - 1.0, 0.0) + max(power_factor * cut.power[k] - 1.0, 0.0)
        life += cut.life[k]
    minutes = task.crossing * exp(-log_speed - log_feed)
    cutting = task.in_metal * minutes
    life_factor = at_set_point(task.wear, log_speed, log_feed)
    cost = minutes + task.return_time
    cost += task.overload_price * cutting * excess / cells
    cost += task.edge_price * cutting * life_factor * life / cells
    if highest > blank.strength:
        cost += task.breakage_price
    return cost


@compiled
def at_set_point(load, log_speed, log_feed):  # type: ignore[no-untyped-def]
    """Return the factor of a set point in a load."""
    return exp(load.cutting_speed * log_speed + load.feed * log_feed)


def covers(scenario: Scenario) -> bool:
    """Return whether an action plans a part, and force and power alone limit it, worn or not."""
    control = scenario.control
    material = scenario.material
    limits = scenario.limits
    mismatch = scenario.mismatch
    further = limits.radial_force.bounds or limits.torque.bounds or limits.roughness.bounds
    wears = material.thrust_force.wear != 0.0 or material.power.wear != 0.0
    # Depth and hardness of a cell must not depend on the pass, the turn or the time.
    changes = (
        scenario.workpiece.depth_ripple > 0.0
        or mismatch.skin_thickness > 0.0
        or mismatch.hardness_gradient != 0.0
        or mismatch.thermal_growth != 0.0
    )
    return control.action == "part" and not (further or wears or changes)
