"""Actions that move the commands towards set points, and the commands of actions."""

import numpy as np
from numpy.typing import NDArray

from turning_env import Reading, Scenario
from turning_env.numerics.compilation import compiled_entry
from turning_env.numerics.functions import log
from turning_env.observation import parameters_of
from turning_env.physics.lathe import command
from turning_env.physics.quantities import WIDTH
from turning_env.physics.records import SCRATCH, STATE, new_records
from turning_env.scenario import ScenarioBatch
from turning_env.scoring.policy import Actions


def sets_speed_and_feed(scenario: Scenario) -> bool:
    """Return whether an action sets cutting speed and feed at every step."""
    return scenario.control.action in ("incremental", "set_point")


def sets_feed(scenario: Scenario) -> bool:
    """Return whether an action sets the feed at every step, with or without the cutting speed."""
    return scenario.control.action in ("incremental", "set_point", "override")


def set_point_action(value: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """Return the action, -1 at the low end of a range and 1 at the high end, that commands a value."""
    return 2.0 * (value - low) / (high - low) - 1.0


def towards(
    reading: Reading,
    scenario: Scenario | ScenarioBatch,
    cutting_speed: NDArray[np.float64],
    feed: NDArray[np.float64],
    change_edge: NDArray[np.bool_] | None = None,
) -> Actions:
    """Return actions, shape (environments, 1 to 3), that command a cutting speed [m/min] and a feed [mm/rev].

    Incremental actions come as near as one step allows. An override does not change the cutting speed. If edges are changed on
    command, they are changed where ``change_edge`` is true; without ``change_edge``, none is changed.
    """
    control, machine = scenario.control, scenario.machine
    if control.action == "incremental":
        columns = [
            log(cutting_speed / reading.commanded_cutting_speed) / control.cutting_speed_step
        ]
        columns += [log(feed / reading.commanded_feed) / control.feed_step]
    elif control.action == "set_point":
        columns = [
            set_point_action(cutting_speed, machine.cutting_speed_min, machine.cutting_speed_max)
        ]
        columns += [set_point_action(feed, machine.feed_min, machine.feed_max)]
    else:
        columns = [2.0 * feed / (control.override_max * control.initial_feed) - 1.0]
    if control.edge_changes == "commanded":
        columns.append(
            np.full(len(feed), -1.0) if change_edge is None else np.where(change_edge, 1.0, -1.0)
        )
    actions: Actions = np.clip(np.stack(columns, axis=1), -1.0, 1.0).astype(np.float32)
    return actions


def commanded(
    actions: Actions,
    cutting_speed: NDArray[np.float64],
    feed: NDArray[np.float64],
    scenario: Scenario,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the cutting speed [m/min] and feed [mm/rev] that actions command after a commanded speed and feed.

    The transition itself decodes the actions, on the first section of a bar. All arrays have one row per environment.
    """
    count = len(actions)
    states = new_records(STATE, -(-count // WIDTH))
    for name, values in (("commanded_cutting_speed", cutting_speed), ("commanded_feed", feed)):
        states[name].flat[:count] = values  # writes through to the records
    command_all(
        states,
        parameters_of(scenario),
        new_records(SCRATCH, 1),
        np.asarray(actions, np.float64),
        count,
    )
    return states["commanded_cutting_speed"].ravel()[:count], states["commanded_feed"].ravel()[
        :count
    ]


@compiled_entry
def command_all(states, parameters, scratches, actions, count):  # type: ignore[no-untyped-def]
    """Set the commanded speed and feed of environments in blocks from their actions."""
    for block in range(len(states)):
        first = block * WIDTH
        command(
            states[block],
            scratches[0].work,
            actions[first:],
            min(count - first, WIDTH),
            parameters[0],
        )
