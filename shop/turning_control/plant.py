"""The plant: the process that a lathe without hardware would lack, fed by the actual motion of the control.

It is the transition of the simulation with hidden hardness, depth and wear, without the drives, because the control moves.
"""

import math

import numpy as np

from turning_env.numerics.compilation import compiled_entry
from turning_env.physics.drives import lag_share
from turning_env.physics.lathe import run_step, start_episode
from turning_env.physics.records import block_records
from turning_env.scenario import Scenario

STILL = 1e-6  # feed in place of a standstill [mm/rev]; it removes nothing worth mentioning
# Sums over a call, from the transition's report, and values at its end, from the state.
REPORTED = ("engaged_time", "severe_overload_time", "removed", "edges_broken")
STATES = (
    "thrust_force",
    "power",
    "depth_of_cut",
    "edge",
    "measured_power",
    "measured_thrust_force",
    "measured_servo_current",
)


class Plant:
    """A lathe's process. Bars, as of a seed in the simulation, follow one another; every pass of the program is the next."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        one_step = {
            "action": "incremental",
            "edge_changes": "automatic",
            "sub_steps": 1,
            "time_limit": 1e5,
        }
        control, endless = (
            scenario.control.model_copy(update=one_step),
            scenario.workpiece.model_copy(update={"bars": 0}),
        )
        self._scenario = scenario.model_copy(update={"control": control, "workpiece": endless})
        self._records = self._states, self._parameters, self._scratches = block_records(
            self._scenario
        )
        self._states["seed"][0, 0] = seed
        start_plant(*self._records)
        free = {
            "spindle_share": 0.0,
            "feed_share": 0.0,
            "cutting_speed_min": 1e-3,
            "feed_min": STILL,
        }  # the control moves
        for name, value in (
            free | {"reachable_cutting_speed": math.inf, "feed_max": math.inf}
        ).items():
            self._parameters[name] = value
        self._bar, self._along, self._returns = 0, 0.0, False

    def advance(
        self, seconds: float, along: float, spindle_speed: float, velocity: float, in_feed: bool
    ) -> dict[str, float]:
        """Move the tool for some seconds [s], and return its sensors' readings and the hidden values.

        ``along`` is its position from the beginning of the approach [mm], with spindle speed [rev/min] and feed velocity [mm/s];
        ``in_feed``: whether it moves at feed. A return to the beginning brings the next bar.
        """
        p, sensors = self._parameters, self._scenario.sensors
        if self._along - along > 0.5 * self._scenario.workpiece.bar_length:
            self._bar += 1
            self._returns = True
        self._returns &= not in_feed
        if self._returns:
            self._along = along
        pitch = float(p["bar_pitch"][0, 0])
        speed = max(spindle_speed / float(p["revolutions_per_metre"][0, 0]), 1e-3)
        feed = max(60.0 * velocity / max(spindle_speed, 1e-3), STILL) if in_feed else STILL
        moved = {
            "cutting_speed": speed,
            "commanded_cutting_speed": speed,
            "feed": feed,
            "commanded_feed": feed,
        }
        path = self._bar * pitch + min(max(self._along, 0.0), pitch - 1e-6)
        for name, value in (moved | {"path": path, "ended": 0, "clock": 0.0}).items():
            self._states[name][0, 0] = value
        p["sub_step"] = seconds / 60.0
        p["power_sensor_share"] = lag_share(seconds, sensors.power_time_constant)
        p["force_sensor_share"] = lag_share(seconds, sensors.force_time_constant)
        move_plant(*self._records, np.zeros((1, 2)))
        self._along = max(self._along, along) if in_feed else self._along
        report = {name: float(self._scratches["report"][name][0, 0]) for name in REPORTED}
        state = {name: float(self._states[name][0, 0]) for name in STATES}
        return {"bar": float(self._bar), "along": self._along, "feed": feed} | report | state


@compiled_entry
def start_plant(states, parameters, scratches):  # type: ignore[no-untyped-def]
    """Put a fresh edge before the first bar."""
    start_episode(states[0], scratches[0].work, scratches[0].report, 0, parameters[0])


@compiled_entry
def move_plant(states, parameters, scratches, actions):  # type: ignore[no-untyped-def]
    """Run the transition over one sub-step of the length in the parameters."""
    run_step(states[0], scratches[0].work, scratches[0].report, actions, 1, parameters[0])
