"""The plant: the process that a lathe without hardware would lack, fed by the actual motion of the control.

It is the transition of the simulation with hidden hardness, depth and wear, without the drives, because the control moves.
"""

import math

import numpy as np

from turning_env.numerics.compilation import compiled_entry
from turning_env.physics.drives import lag_share
from turning_env.physics.lathe import run_step, start_episode
from turning_env.physics.quantities import action_size
from turning_env.physics.records import STATE, new_records, scratch_records
from turning_env.scenario import Scenario

_STILL = 1e-6  # [mm/rev] a feed that removes nothing worth mentioning


class Plant:
    """A lathe's process. Bars stand in a row as in the simulation; every pass of the program is the next bar.

    Args:
        scenario: scenario of the bars.
        seed: determines bars and edges.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        control = scenario.control.model_copy(
            update={"action": "incremental", "edge_changes": "automatic", "sub_steps": 1, "time_limit": 1e5}
        )
        self._scenario = scenario.model_copy(
            update={"control": control, "workpiece": scenario.workpiece.model_copy(update={"bars": 0})}
        )
        self._states, self._scratches = new_records(STATE, 1), scratch_records(self._scenario)
        self._states["seed"][0, 0] = seed
        self._actions = np.zeros((1, action_size(self._scenario)))
        start_plant(self._states, self._scratches)
        parameters = self._scratches["parameters"]
        for name in ("spindle_share", "feed_share"):
            parameters[name] = 0.0
        for name, low in (("cutting_speed_min", 1e-3), ("feed_min", _STILL)):
            parameters[name] = low
        parameters["reachable_cutting_speed"] = parameters["feed_max"] = math.inf
        self._bar, self._along, self._returns = 0, 0.0, False

    def advance(self, seconds: float, along: float, spindle_speed: float, velocity: float, in_feed: bool) -> dict[str, float]:
        """Move the tool, and return what its sensors read and what is hidden.

        Args:
            seconds: time since the last call [s].
            along: tool position from the beginning of the approach [mm].
            spindle_speed: [rev/min]
            velocity: feed velocity [mm/s]
            in_feed: whether the tool moves at feed; a return to the beginning of the approach brings the next bar.
        """
        p, sensors = self._scratches["parameters"], self._scenario.sensors
        if self._along - along > 0.5 * self._scenario.workpiece.bar_length:
            self._bar += 1
            self._returns = True
        self._returns &= not in_feed
        if self._returns:
            self._along = along
        speed = max(spindle_speed / float(p["revolutions_per_metre"][0]), 1e-3)
        feed = max(60.0 * velocity / max(spindle_speed, 1e-3), _STILL) if in_feed else _STILL
        for name, value in (
            ("cutting_speed", speed),
            ("commanded_cutting_speed", speed),
            ("feed", feed),
            ("commanded_feed", feed),
            ("path", self._bar * float(p["bar_pitch"][0]) + min(max(self._along, 0.0), float(p["bar_pitch"][0]) - 1e-6)),
            ("ended", 0),
            ("clock", 0.0),
        ):
            self._states[name][0, 0] = value
        p["sub_step"] = seconds / 60.0
        for name, tau in (
            ("power_sensor_share", sensors.power_time_constant),
            ("force_sensor_share", sensors.force_time_constant),
        ):
            p[name] = lag_share(seconds, tau)
        move_plant(self._states, self._scratches, self._actions)
        self._along = max(self._along, along) if in_feed else self._along
        report = self._scratches["report"]
        over = {name: float(report[name][0, 0]) for name in ("engaged_time", "severe_overload_time", "removed", "edges_broken")}
        now = (
            "thrust_force",
            "power",
            "depth_of_cut",
            "measured_power",
            "measured_thrust_force",
            "measured_servo_current",
            "edge",
        )
        return (
            {"bar": float(self._bar), "along": self._along, "feed": feed}
            | over
            | {name: float(self._states[name][0, 0]) for name in now}
        )


@compiled_entry
def start_plant(states, scratches):  # type: ignore[no-untyped-def]
    """Put a fresh edge before the first bar."""
    start_episode(states[0], scratches[0].work, scratches[0].report, 0, scratches[0].parameters)


@compiled_entry
def move_plant(states, scratches, actions):  # type: ignore[no-untyped-def]
    """Run the transition over one sub-step of the length in the parameters."""
    run_step(states[0], scratches[0].work, scratches[0].report, actions, 1, scratches[0].parameters)
