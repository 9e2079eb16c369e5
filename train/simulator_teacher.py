"""The teacher of the simulator-gradient agent: how the charged cost of a step follows its action.

The tool must travel all bars, and metal is paid by volume. So a policy can only gain by reducing
its cost per distance:

    (p_t * time + overload + p(D) * life used + expected stops) / distance,

where p_t is the price of time and p(D) that of the edge's life by dynamic programming
(``baselines/models/edge_value.py``). Copies of the environments take the same step with a slightly
higher or lower speed or feed. Randomness is keyed, so they meet the same bar, and the difference of
their costs is the change of what the step is charged, for every law and form of the lathe. No
equation of the lathe is restated.

Chips that tangle and edges that break are rare, and one sampled charge is mostly noise. Copies have
margins that no step uses up, and pay the expectation instead: what the step has used of a margin is
its expected number of events. An edge of unknown strength is charged the probability that it breaks
at the force of the step, given the highest force that it has borne.

(Finite differences with common random numbers: Glasserman and Yao 1992, doi 10.1287/mnsc.38.6.884;
the replaced flat charge of life: potential-based shaping, Ng et al. 1999.)
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.models.normal import probability
from train.model_gain import prices_of
from turning_env import FamilyVectorEnv, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.batch.driver import Trials
from turning_env.numerics.functions import log
from turning_env.physics.quantities import ROW

Array = NDArray[np.float64]

SPEED, FEED = range(2)
"""Columns of a gradient, and rows of ``Charge.log_commands``."""
LOG_PROBE = 0.01
"""Change of the logarithm of speed or feed in a copy, to either side."""
OVERRIDE_PROBE = 0.01
"""Change of the action in a copy if it is an override of the feed, to either side."""
WIDE = 10
"""Factor on these changes in the copies that show events which set in abruptly."""
MARGIN = 1e3
"""Margin of chipping and tangling of a copy [-], where 1 is an event's mean; no step uses it up."""
UNUSED_LIFE = 0.2
"""Share of an edge's life that is not used [-]: agents do not know the wear, and change edges early
(found on validation jobs). Edges pay for themselves in the share that is used."""
WORN_FROM = 0.9
"""Used life [-] over which the cost of wearing an edge out is spread, up to 1. Agents know the used
life less exactly, and an edge's last step alone teaches little."""
MAX_GRADIENT = 50.0
"""Largest absolute gradient [s]: an edge of a step, such as a bar's end, must not decide alone."""
FRESH_LIFE = 0.05
"""Used life [-] up to which an edge that breaks would also have broken if it had been new
(assumption)."""
MIN_FORCE = 1e-3  # smallest force over the median strength of edges [-]
MIN_SURVIVAL = 1e-3  # smallest probability to have survived
MIN_STRENGTH_SPREAD = 1e-3  # smallest log standard deviation of strengths [-]
MIN_CHANGE = 1e-4  # smallest change of a command's logarithm that has a quotient [-]
LIFE_NODES = 41

JOB = np.dtype(
    [
        ("time_price", np.float64),  # p_t [s per s]
        # p(D) [s] at used lives from 0 to 1, and its integral from each to 1.
        ("life_price", np.float64, (LIFE_NODES,)),
        ("remaining_value", np.float64, (LIFE_NODES,)),
        ("stop_for_chips", np.float64),  # cost of a stop for tangled chips [s]
        ("stop_unplanned", np.float64),  # cost of wearing an edge out, beside its life [s]
        ("breakage", np.float64),  # cost of breaking an edge, beside its life [s]
        ("strength", np.float64),  # median thrust force that breaks an edge [N]
        ("strength_spread", np.float64),  # its log standard deviation [-]
    ]
)
"""Prices of a job, by its true laws."""


def job_of(scenario: Scenario) -> NDArray[np.void]:
    """Return the prices of a true scenario, a record of ``JOB``."""
    economics = scenario.economics
    changes_edges = scenario.control.edge_changes != "end"
    usable = 1.0 - UNUSED_LIFE * changes_edges
    dearer = economics.model_copy(
        update={
            "edge_cost": economics.edge_cost / usable,
            "edge_change_time": economics.edge_change_time / usable,
        }
    )
    prices = prices_of(scenario.model_copy(update={"economics": dearer}))
    job = np.zeros((), JOB)
    job["time_price"] = prices.time
    # Before the first used life with a price, it is constant.
    life_price = np.concatenate([prices.life[:1], prices.life])
    job["life_price"] = life_price
    # The integral from each node to 1, by the trapezoidal rule.
    pieces = 0.5 * (life_price[:-1] + life_price[1:]) / (LIFE_NODES - 1)
    job["remaining_value"][:-1] = np.cumsum(pieces[::-1])[::-1]
    job["stop_for_chips"] = 60.0 * scenario.swarf.tangle_time * prices.time
    # If the episode ends with the edge, no time passes, and breakage has its price.
    price_of_downtime = prices.time if changes_edges else 1.0
    job["stop_unplanned"] = 60.0 * economics.unplanned_stop * prices.time * changes_edges
    job["breakage"] = 60.0 * economics.breakage_downtime * price_of_downtime
    job["strength"] = scenario.tool.edge_strength
    job["strength_spread"] = max(scenario.tool.edge_strength_spread, MIN_STRENGTH_SPREAD)
    return job


def at_life(nodes: Array, used_life: Array) -> Array:
    """Return values at used lives [-], interpolated between those of nodes from 0 to 1.

    Args:
        nodes: shape (num_envs, ``LIFE_NODES``).
        used_life: shape (num_envs,).
    """
    position = np.clip(used_life, 0.0, 1.0) * (LIFE_NODES - 1)
    node = np.minimum(position.astype(np.int64), LIFE_NODES - 2)
    rows = np.arange(len(nodes))
    low = nodes[rows, node]
    high = nodes[rows, node + 1]
    return np.asarray(low + (high - low) * (position - node))


class Charge(NamedTuple):
    """The charge of a step of copies; fields have shape (num_envs,)."""

    cost: Array
    """Cost of time, overload, roughness, life and expected breakages [s]."""
    events: Array
    """Cost of events that set in abruptly [s]: expected stops for tangled chips, and breakages."""
    distance: Array
    """Distance of the tool [mm]."""
    going_on: Array
    """Earnings of the step over those of changing the edge before it [s]."""
    failed: NDArray[np.bool_]
    """Whether the edge was worn out or broken. Then the cost says nothing."""
    broken_fresh: NDArray[np.bool_]
    """Whether a fresh edge was broken, against which no change of edges helps."""
    log_commands: Array
    """Logarithms of the commanded cutting speed [m/min] and feed [mm/rev], shape (2, num_envs)."""


class Lesson(NamedTuple):
    """Gradients and earnings of a step by trials; arrays of shape (num_envs, ...)."""

    gradient: NDArray[np.float32]
    """Minus the derivative of the cost per distance, times the step's distance, by the logarithms
    of the commanded speed and feed [s], shape (num_envs, 2). Where an edge fails, it is that of
    abrupt events alone."""
    going_on: NDArray[np.float32]
    """Earnings of one more step with the edge in use [s]."""
    failed: NDArray[np.bool_]
    """Whether that step wears the edge out or breaks it."""
    cost: NDArray[np.float32]
    """Cost of the step [s]; 0 where the edge fails."""


class TrialVecEnv(RoughTurningVecEnv):
    """Environments whose copies try other actions before the next step.

    ``lesson`` teaches about a step that is not yet taken. The environments do not move, and draw no
    number.
    """

    def __getstate__(self) -> dict[str, Any]:
        values = dict(vars(self))
        # They are made again: they hold nothing from step to step.
        values.pop("_trials", None)
        return values

    def reset(self) -> NDArray[np.float32]:
        """Return first observations; see ``RoughTurningVecEnv.reset``."""
        observations = super().reset()
        self._jobs = np.array([self._present_job(i) for i in range(self.num_envs)])
        self._known_jobs: dict[int, NDArray[np.void]] = {}
        self._used_life = np.zeros(self.num_envs)
        self._borne_force = np.zeros(self.num_envs)
        return observations

    def _present_job(self, env_index: int) -> NDArray[np.void]:
        """Return the prices of the job that an environment plays."""
        envs = self.vector_env.unwrapped
        if isinstance(envs, FamilyVectorEnv):
            return job_of(envs.job(env_index).scenario)
        return job_of(envs.scenario)

    def training_rewards(self, rewards: Array, infos: dict[str, Any]) -> Array:
        """Keep the highest force of each edge, and return the rewards unchanged."""
        # Of the next episode, where one has ended.
        used_life = infos["used_life"]
        force = infos["thrust_force"]
        is_fresh = used_life < self._used_life
        if "final_info" in infos:
            ended = infos["_final_info"]
            is_fresh = is_fresh | ended
            self._take_jobs(np.flatnonzero(ended).tolist(), infos)
        self._borne_force = np.where(is_fresh, force, np.maximum(self._borne_force, force))
        self._used_life = used_life.copy()
        return rewards

    def _take_jobs(self, env_indices: list[int], infos: dict[str, Any]) -> None:
        """Take the prices of the jobs that environments begin."""
        if "job" not in infos:
            return  # a single scenario
        for env_index in env_indices:
            number = int(infos["job"][env_index])
            # To make a job takes some milliseconds.
            if number not in self._known_jobs:
                self._known_jobs[number] = self._present_job(env_index)
            self._jobs[env_index] = self._known_jobs[number]

    def lesson(self, actions: NDArray[np.float32]) -> Lesson:
        """Return what the simulator teaches about a step with some actions.

        The trials keep the edge, even where the action changes it.
        """
        scenario = self._wrapper_attr("scenario")
        control = scenario.control
        tried = np.array(actions, np.float64)
        if control.edge_changes == "commanded":
            tried[:, -1] = -1.0
        charge = self.charge(tried)
        failed = charge.failed
        gradient = np.zeros((self.num_envs, 2))
        if control.action == "override":
            probes = [OVERRIDE_PROBE]
            commands = [FEED]
        else:
            probes = [LOG_PROBE / control.cutting_speed_step, LOG_PROBE / control.feed_step]
            commands = [SPEED, FEED]
        for entry, probe in enumerate(probes):
            command = commands[entry]
            higher = self.charge(_moved(tried, entry, probe))
            lower = self.charge(_moved(tried, entry, -probe))
            unsound = failed | higher.failed | lower.failed
            slope = np.where(unsound, 0.0, self._quotient(higher, lower, charge, command))
            # The slope of what sets in abruptly, as the mean over the range of the probes.
            higher = self.charge(_moved(tried, entry, WIDE * probe))
            lower = self.charge(_moved(tried, entry, -WIDE * probe))
            change = higher.events - lower.events
            if command == SPEED:
                # Far above the speed at which edges collapse, both break. A lower speed would help.
                lost = charge.broken_fresh & (change == 0.0)
                change = np.where(lost, charge.events, change)
            gradient[:, command] = slope - change / (2.0 * WIDE * LOG_PROBE)
        return Lesson(
            gradient=np.clip(gradient, -MAX_GRADIENT, MAX_GRADIENT).astype(np.float32),
            going_on=charge.going_on.astype(np.float32),
            failed=failed,
            cost=np.where(failed, 0.0, charge.cost + charge.events).astype(np.float32),
        )

    def _quotient(self, higher: Charge, lower: Charge, charge: Charge, command: int) -> Array:
        """Return minus the change of the cost, at the distance of ``charge``, by a command."""
        change = higher.log_commands[command] - lower.log_commands[command]
        cost_higher = higher.cost * charge.distance / higher.distance
        cost_lower = lower.cost * charge.distance / lower.distance
        is_moved = change > MIN_CHANGE
        return np.where(is_moved, -(cost_higher - cost_lower) / np.where(is_moved, change, 1.0), 0)

    def charge(self, actions: Array) -> Charge:
        """Return the charge of the next step with some actions, by copies of the environments."""
        trials = self._copies()
        job = self._jobs
        edge = trials.state("edge").copy()
        path = trials.state("path").copy()
        used_life = trials.state("used_life").copy()
        trials.set_state("tangle_margin", MARGIN)
        trials.set_state("chipping_margin", MARGIN)
        trials.step(actions)
        table = trials.table
        tangles = MARGIN - trials.state("tangle_margin")
        chippings = MARGIN - trials.state("chipping_margin")

        life_after = table[ROW.used_life]
        broken = table[ROW.broken] > 0.0
        failed = broken | (life_after >= 1.0) | (trials.state("edge") != edge)
        chippings = np.where(failed, 0.0, chippings)
        used = np.where(failed, 0.0, life_after - used_life)
        life_price = at_life(job["life_price"], 0.5 * (used_life + np.minimum(life_after, 1.0)))
        life_cost = life_price * used
        # A broken edge loses the life that is left.
        breakage = job["breakage"] + at_life(job["remaining_value"], used_life)
        breakages = chippings + self._break_risk(table[ROW.thrust_force])
        cost = job["time_price"] * table[ROW.time] - table[ROW.reward_overload]
        cost = cost - table[ROW.reward_roughness] + life_cost
        cost = cost + breakages * breakage
        events = tangles * job["stop_for_chips"] + broken * breakage

        # While life has a price, the best set point earns just that price. Afterwards, going on
        # pays while metal earns more than time and overload cost. A breakage then costs its
        # downtime only: a change also forgoes the life that is left. What threatens any edge alike,
        # such as chipping by chatter, is no reason to change it.
        profit = table[ROW.reward_metal] + table[ROW.reward_overload]
        profit = profit - job["time_price"] * table[ROW.engaged_time]
        going_on = np.where(life_price > 0.0, life_cost, profit)
        going_on = going_on - _worn_out(used_life, life_after, failed) * job["stop_unplanned"]
        broken_fresh = broken & (used_life < FRESH_LIFE)
        going_on = np.where(broken, -job["breakage"], going_on)
        going_on = np.where(broken_fresh, 0.0, going_on)
        return Charge(
            cost=cost,
            events=events,
            distance=np.maximum(table[ROW.path] - path, 1e-6),
            going_on=going_on,
            failed=failed,
            broken_fresh=broken_fresh,
            log_commands=log(table[[ROW.commanded_cutting_speed, ROW.commanded_feed]]),
        )

    def _copies(self) -> Trials:
        """Return copies of the environments as they are now."""
        if not hasattr(self, "_trials"):
            self._trials: Trials = self.vector_env.unwrapped.trials()
        self._trials.begin()
        return self._trials

    def _break_risk(self, force: Array) -> Array:
        """Return the probability that a force [N] breaks edges that have borne those before."""
        borne = self._weaker(self._borne_force)
        risk = (self._weaker(force) - borne) / np.maximum(1.0 - borne, MIN_SURVIVAL)
        return np.maximum(risk, 0.0)

    def _weaker(self, force: Array) -> Array:
        """Return the share of edges that are weaker than a force [N]."""
        job = self._jobs
        log_load = log(np.maximum(force / job["strength"], MIN_FORCE))
        return np.asarray(probability(log_load / job["strength_spread"]).below)


def _worn_out(before: Array, after: Array, failed: NDArray[np.bool_]) -> Array:
    """Return the share of a stop for a worn-out edge that a step is charged [-].

    Args:
        before: used life before the step [-].
        after: used life after it, if the edge has not failed.
        failed: whether it has.
    """
    last = np.where(failed, 1.0, np.minimum(after, 1.0))
    first = np.clip(before, WORN_FROM, 1.0)
    return np.maximum(last - first, 0.0) / (1.0 - WORN_FROM)


def _moved(actions: Array, entry: int, change: float) -> Array:
    """Return actions with an entry changed, within -1..1."""
    moved = actions.copy()
    moved[:, entry] = np.clip(moved[:, entry] + change, -1.0, 1.0)
    return moved
