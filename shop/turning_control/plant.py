"""The plant: the process that a lathe without hardware lacks, fed by the control's actual motion.

It is the simulation's transition with hidden hardness, depth and wear, but without its drives,
because the control moves. ``hal_bridge.py`` starts it as the simulated lathe's process:

python -m turning_control.plant --scenario override --log plant.csv
"""

import csv
import math
from pathlib import Path

import numpy as np
from turning_control.pins import FEED_MOTION, Pins
from turning_control.readings import force_reading
from turning_control.streams import standard_streams_taken

from turning_env.console import Parser, described, exits
from turning_env.numerics.compilation import FIRST_ENV, ONE_ENV, compiled_entry
from turning_env.physics.drives import lag_share
from turning_env.physics.lathe import run_step, start_episode
from turning_env.physics.records import block_records
from turning_env.scenario import Scenario

STILL = 1e-6  # feed in place of a standstill [mm/rev]; it removes nothing worth mentioning
MIN_SPINDLE_SPEED = 1e-3  # in place of a standstill [rev/min]
MIN_CUTTING_SPEED = 1e-3  # in place of a standstill [m/min]
# Sums over a call, from the transition's report, and values at its end, from the state.
REPORTED = ("engaged_time", "severe_overload_time", "removed", "edges_broken")
STATES = (
    "thrust_force",
    "power",
    "depth_of_cut",
    "cutting",
    "edge",
    "measured_power",
    "measured_thrust_force",
    "measured_servo_current",
)


class Plant:
    """A lathe's process, with the bars and edges that a seed determines in the simulation.

    Every pass of the program cuts the next bar.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self._scenario = endless(scenario)
        self._states, self._parameters, self._scratches = block_records(self._scenario)
        self._states["seed"][0, 0] = seed
        start_plant(self._states, self._parameters, self._scratches)
        self._free_motion()
        self._bar = 0
        self._along = 0.0  # position from the beginning of the approach [mm]
        self._returns = False  # to the beginning of the next bar

    def _free_motion(self) -> None:
        """Let speed and feed follow the control at once, within no limits."""
        self._parameters["spindle_share"] = 0.0
        self._parameters["feed_share"] = 0.0
        self._parameters["cutting_speed_min"] = MIN_CUTTING_SPEED
        self._parameters["reachable_cutting_speed"] = math.inf
        self._parameters["feed_min"] = STILL
        self._parameters["feed_max"] = math.inf

    def advance(
        self, seconds: float, along: float, spindle_speed: float, velocity: float, in_feed: bool
    ) -> dict[str, float]:
        """Move the tool for some seconds; return its sensors' readings and the hidden values.

        A return to the beginning brings the next bar.

        Args:
            seconds: duration of the motion [s].
            along: tool position at its end, from the beginning of the approach [mm].
            spindle_speed: [rev/min].
            velocity: feed velocity [mm/s].
            in_feed: whether the tool moves at feed.
        """
        parameters = self._parameters
        sensors = self._scenario.sensors
        if self._along - along > 0.5 * self._scenario.workpiece.bar_length:
            self._bar += 1
            self._returns = True
        self._returns &= not in_feed
        if self._returns:
            self._along = along

        speed = max(
            spindle_speed / float(parameters["revolutions_per_metre"][0, 0]), MIN_CUTTING_SPEED
        )
        feed = STILL
        if in_feed:
            feed = max(60.0 * velocity / max(spindle_speed, MIN_SPINDLE_SPEED), STILL)
        pitch = float(parameters["bar_pitch"][0, 0])
        self._set(
            cutting_speed=speed,
            commanded_cutting_speed=speed,
            feed=feed,
            commanded_feed=feed,
            # The tool stays within its bar, however far the program moves.
            path=self._bar * pitch + min(max(self._along, 0.0), pitch - 1e-6),
            ended=0,
            clock=0.0,
        )
        parameters["sub_step"] = seconds / 60.0
        parameters["power_sensor_share"] = lag_share(seconds, sensors.power_time_constant)
        parameters["force_sensor_share"] = lag_share(seconds, sensors.force_time_constant)
        move_plant(self._states, parameters, self._scratches, np.zeros((1, 2)))
        if in_feed:
            self._along = max(self._along, along)

        values = {"bar": float(self._bar), "along": self._along, "feed": feed}
        for name in REPORTED:
            values[name] = float(self._scratches["report"][name][0, 0])
        for name in STATES:
            values[name] = float(self._states[name][0, 0])
        return values

    def _set(self, **values: float) -> None:
        """Set quantities of the only environment's state."""
        for name, value in values.items():
            self._states[name][0, 0] = value


def endless(scenario: Scenario) -> Scenario:
    """Return a scenario with bars without end, whose step is one sub-step of the transition."""
    control = scenario.control.model_copy(
        update={
            "action": "incremental",
            "edge_changes": "automatic",
            "sub_steps": 1,
            "time_limit": 1e5,
        }
    )
    workpiece = scenario.workpiece.model_copy(update={"bars": 0})
    return scenario.model_copy(update={"control": control, "workpiece": workpiece})


@compiled_entry
def start_plant(states, parameters, scratches):  # type: ignore[no-untyped-def]
    """Put a fresh edge before the first bar."""
    scratch = scratches[0]
    start_episode(states[0], scratch.work, scratch.report, FIRST_ENV, parameters[0])


@compiled_entry
def move_plant(states, parameters, scratches, actions):  # type: ignore[no-untyped-def]
    """Run the transition over one sub-step of the length in the parameters."""
    scratch = scratches[0]
    run_step(states[0], scratch.work, scratch.report, actions, ONE_ENV, parameters[0])


def serve(scenario: Scenario, seed: int, log: Path, bridge: Pins) -> None:
    """Answer the plant's pins until the bridge's requests end, and log every cycle to a file."""
    work = scenario.workpiece
    # The first call compiles, which must not delay the first answer.
    Plant(scenario, seed).advance(0.01, along=0.0, spindle_speed=100.0, velocity=0.0, in_feed=False)
    plant = Plant(scenario, seed)
    time_before: float | None = None
    writer: csv.DictWriter[str] | None = None
    with log.open("w", newline="") as file:
        for pins in bridge:
            seconds = 0.001 if time_before is None else pins["time"] - time_before
            time_before = pins["time"]
            along = work.approach + pins["position"]
            on_bar = 0.0 <= along < work.approach + work.bar_length
            at_feed = pins["motion-type"] == FEED_MOTION and on_bar
            values = plant.advance(
                max(seconds, 1e-4),
                along,
                spindle_speed=abs(pins["spindle-speed"]),
                velocity=pins["feed-velocity"],
                in_feed=at_feed,
            )
            row = {
                "time": pins["time"],
                "seconds": seconds,
                "at_feed": int(at_feed),
                "adaptive_feed": pins["adaptive-feed"],
                "delay": pins["delay"],
                **values,
            }
            if writer is None:
                writer = csv.DictWriter(file, list(row))
                writer.writeheader()
            writer.writerow(row)
            bridge.answer(
                power=values["measured_power"],
                thrust_force=values[f"measured_{force_reading(scenario)}"],
                edge=int(values["edge"]),
            )


def main(arguments: list[str] | None = None) -> int:
    """Answer lines of pins (JSON) with simulated loads until they end; return the exit status."""
    parser = Parser(prog="python -m turning_control.plant", **described(__doc__))
    parser.add_argument(
        "--scenario",
        default="override",
        metavar="NAME",
        help="preset or TOML file (default: %(default)s)",
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="determines bars and edges (default: %(default)s)",
    )
    parser.add_argument(
        "--log", type=Path, required=True, metavar="CSV", help="file for every cycle"
    )
    options = parser.parse_args(arguments)

    def run() -> int:
        scenario = Scenario.load(options.scenario)
        with standard_streams_taken() as streams:
            serve(scenario, options.seed, options.log, Pins(*streams))
        return 0

    return exits(ValueError, OSError)(run)()


if __name__ == "__main__":
    raise SystemExit(main())
