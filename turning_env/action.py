"""Actions that move the commands towards set points, and the commands of actions.

The transition decodes actions (``physics/lathe.py``); nothing here does it a second time.
"""

import numpy as np
from numpy.typing import NDArray

from turning_env import Reading, Scenario
from turning_env.numerics.compilation import compiled_entry
from turning_env.numerics.functions import log
from turning_env.observation import parameters_of
from turning_env.physics.lathe import command
from turning_env.physics.quantities import WIDTH
from turning_env.physics.records import SCRATCH, STATE, new_records
from turning_env.policy import Actions
from turning_env.scenario import ScenarioBatch

Array = NDArray[np.float64]


def sets_speed_and_feed(scenario: Scenario) -> bool:
    """Return whether an action sets cutting speed and feed at every step."""
    return scenario.control.action in ("incremental", "set_point")


def sets_feed(scenario: Scenario) -> bool:
    """Return whether an action sets the feed at every step, with or without the cutting speed."""
    return scenario.control.action in ("incremental", "set_point", "override")


def set_point_action(value: Array, low: float, high: float) -> Array:
    """Return the action, -1 at the low end of a range and 1 at the high end, for a value."""
    return 2.0 * (value - low) / (high - low) - 1.0


def towards(
    reading: Reading,
    scenario: Scenario | ScenarioBatch,
    cutting_speed: Array,
    feed: Array,
    change_edge: NDArray[np.bool_] | None = None,
) -> Actions:
    """Return actions that command a cutting speed [m/min] and a feed [mm/rev].

    Their shape is (environments, 1 to 3). Incremental actions come as near as one step allows. An
    override does not change the cutting speed. If edges are changed on command, they are changed
    where ``change_edge`` is true; without ``change_edge``, none is changed.
    """
    control = scenario.control
    machine = scenario.machine
    columns = []
    if control.action == "incremental":
        log_speed_ratio = log(cutting_speed / reading.commanded_cutting_speed)
        log_feed_ratio = log(feed / reading.commanded_feed)
        columns.append(log_speed_ratio / control.cutting_speed_step)
        columns.append(log_feed_ratio / control.feed_step)
    elif control.action == "set_point":
        columns.append(
            set_point_action(cutting_speed, machine.cutting_speed_min, machine.cutting_speed_max)
        )
        columns.append(set_point_action(feed, machine.feed_min, machine.feed_max))
    else:
        # The action -1 is an override of 0, and 1 is the highest.
        columns.append(2.0 * feed / (control.override_max * control.initial_feed) - 1.0)
    if control.edge_changes == "commanded":
        keeps_edge = np.full(len(feed), -1.0)
        if change_edge is None:
            columns.append(keeps_edge)
        else:
            columns.append(np.where(change_edge, 1.0, keeps_edge))
    actions: Actions = np.clip(np.stack(columns, axis=1), -1.0, 1.0).astype(np.float32)
    return actions


def commanded(
    actions: Actions, cutting_speed: Array, feed: Array, scenario: Scenario
) -> tuple[Array, Array]:
    """Return the cutting speed [m/min] and feed [mm/rev] that actions command.

    ``cutting_speed`` and ``feed`` are the commands before. Actions are decoded on the first section
    of a bar. All arrays have one row per environment.
    """
    count = len(actions)
    states = new_records(STATE, -(-count // WIDTH))
    speeds = states["commanded_cutting_speed"]
    feeds = states["commanded_feed"]
    # ``flat`` writes through to the records.
    speeds.flat[:count] = cutting_speed
    feeds.flat[:count] = feed
    command_all(
        states,
        parameters_of(scenario),
        new_records(SCRATCH, 1),
        np.asarray(actions, np.float64),
        count,
    )
    return speeds.ravel()[:count], feeds.ravel()[:count]


@compiled_entry
def command_all(states, parameters, scratches, actions, count):  # type: ignore[no-untyped-def]
    """Set the commanded speed and feed of environments in blocks from their actions."""
    work = scratches[0].work
    for block in range(len(states)):
        first = block * WIDTH
        envs = min(count - first, WIDTH)
        command(states[block], work, actions[first:], envs, parameters[0])
