"""The stepped bar of the fuzzy override paper without randomness, to compare laws of feed override.

Steel E295 on a 9 kW lathe, programmed feed 0.4 mm/rev, target load 60 % of the drive's torque
(preset `override_torque`). There are no spreads and no noise, and the edge does not break. The
figures and checks that use the bar are in ``figures/override.py`` and ``reproduce``.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from research.papers import changed, record
from turning_env import Scenario
from turning_env.numerics.conversions import spindle_speed_at
from turning_env.policy import PolicyFactory

RIPPLE = 0.02  # amplitude of the ripple of depth in the paper's test, over the depth [-]
STEPS = (1.0, 2.0, 3.0)  # depths of cut of the paper's test [mm]
NO_SPREADS: dict[str, Any] = {
    "depth_bar_spread": 0.0,
    "depth_along_spread": 0.0,
    "hardness_bar_spread": 0.0,
    "hardness_along_spread": 0.0,
}
"""Values of the workpiece that make all bars alike and each bar uniform within its sections."""


def stepped_bar(
    depths: tuple[float, ...] = STEPS,
    bar_length: float = 100.0,
    ripple_period: float | None = None,
    torque: float = 1.0,
    **machine: float,
) -> Scenario:
    """Return the scenario of a bar in sections of equal length.

    Args:
        depths: depth of cut of each section [mm].
        bar_length: length of all sections [mm].
        ripple_period: period of a ripple of depth [s]; None for a smooth bar.
        torque: torque of the main drive over the preset's [-].
        machine: other values of the machine, such as its lags.
    """
    base = Scenario.load("override_torque")

    workpiece = NO_SPREADS | {"depth_profile": depths, "bar_length": bar_length}
    workpiece["depth_ripple"] = 0.0
    if ripple_period is not None:
        # A scenario counts the ripple's period in revolutions.
        cutting_speed = base.control.initial_cutting_speed
        revolutions = spindle_speed_at(cutting_speed, base.workpiece.diameter)
        workpiece["depth_ripple"] = RIPPLE
        workpiece["depth_ripple_period"] = ripple_period / 60.0 * revolutions

    # The limit of power scales with the drive, so that the target load stays 60 %.
    return changed(
        "override_torque",
        tool={"wear_factor_spread": 0.0, "edge_strength": 1e6, "edge_strength_spread": 0.0},
        machine={"rated_power": torque * base.machine.rated_power} | machine,
        workpiece=workpiece,
        sensors={"power_noise": 0.0, "force_noise": 0.0},
        limits={"power": torque * base.limits.power},
    )


@dataclass(frozen=True)
class Trajectory:
    """A bar turned by a policy; arrays over steps, at their ends."""

    time: NDArray[np.float64]  # time since the start [s]
    depth: NDArray[np.float64]  # depth of cut [mm], 0 in air
    override: NDArray[np.float64]  # commanded feed over the programmed one [-]
    load: NDArray[np.float64]  # true spindle load [-]

    def _where(self, kept: NDArray[np.bool_]) -> "Trajectory":
        return Trajectory(
            time=self.time[kept],
            depth=self.depth[kept],
            override=self.override[kept],
            load=self.load[kept],
        )

    def after(self, time: float) -> "Trajectory":
        """Return the part from a time [s] on, in metal."""
        return self._where((self.time >= time) & (self.depth > 0.0))

    def at_depth(self, depth: float, settled: float) -> "Trajectory":
        """Return the parts at a depth of cut [mm], each without its first ``settled`` seconds."""
        at_depth = np.isclose(self.depth, depth)
        was_at_depth = np.append(False, at_depth[:-1])
        arrives = at_depth & ~was_at_depth
        arrivals = np.where(arrives, self.time, -np.inf)

        # The running maximum carries the time of the latest arrival to all steps after it.
        latest_arrival = np.maximum.accumulate(arrivals)
        has_settled = self.time >= latest_arrival + settled
        return self._where(at_depth & has_settled)


def play_bar(make_policy: PolicyFactory, scenario: Scenario) -> Trajectory:
    """Return the trajectory of a policy on a bar."""
    recorded = record(
        make_policy(1),
        scenario,
        [0],
        names=("time", "depth_of_cut", "commanded_feed", "spindle_load"),
    )
    commanded_feed = recorded["commanded_feed"][:, 0]
    return Trajectory(
        time=np.cumsum(recorded["time"][:, 0]),
        depth=recorded["depth_of_cut"][:, 0],
        override=commanded_feed / scenario.control.initial_feed,
        load=recorded["spindle_load"][:, 0],
    )
