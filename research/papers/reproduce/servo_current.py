"""The servo current paper: cutting force from the current of the feed's motor, and feed adapted within a limit of it.

Its figures show an experiment with a brake, without numbers to compare, so the checks are those of the text. Everything is played
on the preset `override_current` (steps of 12 ms) and on `rough_turning_current` (steps of 1 s).
"""

import math
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from baselines.current_limit import CUTOFF, WINDOW, CurrentLimit, ForceEstimator
from baselines.fixed import FixedParameters
from baselines.models.part_program import PartProgram
from research.papers import changed, record
from research.papers.phase_current import CurrentReport, analyse
from research.papers.reproduce.checks import Check, at_least, at_most, claim, table
from research.papers.stepped_bar import NO_SPREADS
from turning_env import Scenario, read
from turning_env.physics.drives import force_from_current, steady_current
from turning_env.physics.records import parameter_records
from turning_env.scoring.play import play
from turning_env.scoring.policy import PolicyFactory
from turning_env.scoring.seeds import tuning_seeds

NUM_SEEDS = 8
SETTLED = 3.0  # time after which the programmed feed has entered the bar and the estimates have settled [s]
SETTINGS = ((0.2, 5), (0.5, 5), (CUTOFF, WINDOW))
"""Settings of the estimator: cut-off frequency over Nyquist's, samples of the root mean square. The last is the controller's."""
DELAYS = [
    ForceEstimator(Scenario(), 1, *setting).delay for setting in SETTINGS
]  # delays of the estimates [samples]
FEED_VELOCITIES = (
    50.0,
    100.0,
    150.0,
    200.0,
)  # feed velocities at which the paper measures the idle current [mm/min]
HALL_CURRENT, HALL_OUTPUT, HALL_RESISTANCE, HALL_SUPPLY = 6.0, 0.025, 500.0, 15.0
"""Highest current of the Hall sensor [A], its output there [A], the resistance that samples it [Ohm], and its supply [V]."""

UNDISTURBED = NO_SPREADS | {"depth_ripple": 0.0}


class Record(NamedTuple):
    """A record of forces and currents at a fixed speed and feed; arrays of shape (steps, seeds)."""

    force: NDArray[np.float64]  # true thrust force [N]
    current: NDArray[np.float64]  # measured current [A]
    plain: NDArray[np.float64]  # force by the static inversion of each sample [N]
    estimates: NDArray[
        np.float64
    ]  # force by filter and root mean square [N], shape (settings, steps, seeds)
    in_metal: NDArray[
        np.bool_
    ]  # whether the tool is in metal, and was for the last fifteen samples


def play_fixed(scenario: Scenario, seconds: float, feed: float | None = None) -> Record:
    """Play episodes from their start at the programmed speed, and the programmed feed or another [mm/rev]."""
    policy = FixedParameters(
        scenario, scenario.control.initial_cutting_speed, feed or scenario.control.initial_feed
    )
    kept = record(policy, scenario, tuning_seeds(NUM_SEEDS), seconds)
    readings = [read(observations, scenario) for observations in kept["observation"]]
    estimators = [
        ForceEstimator(scenario, NUM_SEEDS, cutoff, window) for cutoff, window in SETTINGS
    ]
    return Record(
        kept["thrust_force"],
        np.array([reading.servo_current for reading in readings]),
        np.array([reading.thrust_force for reading in readings]),
        np.array(
            [[estimator.update(reading)[0] for reading in readings] for estimator in estimators]
        ),
        np.pad(
            sliding_window_view(kept["cutting"] > 0, 16, axis=0).all(axis=-1), ((15, 0), (0, 0))
        ),
    )


@cache
def stepped() -> Record:
    """Return the record of the stepped bar."""
    return play_fixed(Scenario.load("override_current"), 19.0)


def errors(kept: Record, start: float, lags: tuple[int, ...] | None = None) -> list[float]:
    """Return the root mean square errors over the mean force of the plain inversion and of every setting.

    Args:
        kept: the record.
        start: first step that counts.
        lags: lag of each behind the force with which it is compared [steps]; none by default.
    """
    estimates = (kept.plain, *kept.estimates)
    result = []
    for estimate, lag in zip(estimates, lags or (0,) * len(estimates), strict=True):
        force = np.roll(kept.force, lag, axis=0)
        counted = kept.in_metal & (np.arange(len(force)) >= start + lag)[:, np.newaxis]
        result.append(
            float(np.sqrt(np.mean((estimate - force)[counted] ** 2)) / force[counted].mean())
        )
    return result


@cache
def all_errors() -> dict[str, list[float]]:
    """Return the errors of the plain inversion and of every setting, by record."""
    start = SETTLED / Scenario.load("override_current").control.interval
    sensor = sensor_lag()
    lags = (sensor, *(sensor + round(delay) for delay in DELAYS))
    # One depth, one hardness, no run-out: only sensor noise and motor ripple.
    steady = play_fixed(
        changed("override_current", workpiece=UNDISTURBED | {"depth_profile": []}), 15.0
    )
    return {
        "12 ms, steady cutting": errors(steady, start),
        "12 ms, stepped bar": errors(stepped(), start),
        "12 ms, stepped bar, lag allowed for": errors(stepped(), start, lags),
        "1 s": errors(play_fixed(Scenario.load("rough_turning_current"), 300.0), 15),
    }


@cache
def sensor_lag(most: int = 40) -> int:
    """Return the lag of the force by static inversion behind the true force, at which they differ least [samples]."""
    start = round(SETTLED / 0.012)
    force, plain = stepped().force[start - most :], stepped().plain[start:]
    differences = [np.mean((plain - force[most - lag :][: len(plain)]) ** 2) for lag in range(most)]
    return int(np.argmin(differences))


@cache
def no_load_currents() -> NDArray[np.float64]:
    """Return the mean measured current in air at the paper's feed velocities [A]."""
    scenario = changed(
        "override_current", workpiece={"approach": 1000.0}, machine={"feed_min": 0.01}
    )
    revolutions = (
        1000.0 / (math.pi * scenario.workpiece.diameter) * scenario.control.initial_cutting_speed
    )
    return np.array(
        [
            play_fixed(scenario, 1.2, velocity / revolutions).current[-20:].mean()
            for velocity in FEED_VELOCITIES
        ]
    )


@cache
def currents_of_depths() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean true force [N] and measured current [A] at five depths of cut."""
    rows = []
    for depth in (0.5, 1.0, 1.5, 2.0, 3.0):
        kept = play_fixed(
            changed("override_current", workpiece=UNDISTURBED | {"depth_profile": [depth]}), 2.4
        )
        rows.append((kept.force[-50:].mean(), kept.current[-50:].mean()))
    forces, currents = np.array(rows).T
    return forces, currents


HOLD, SETTLING = 4.0, 0.5  # time at each depth of cut, and its first part that is not analysed [s]


@cache
def loaded_and_unloaded() -> tuple[float, CurrentReport]:
    """Return (electrical frequency [Hz], report of the current of phase u) while the depth rises to 3 mm and falls again.

    The phase current is the measured amplitude times the cosine of the electrical angle, equation (4).
    """
    depths = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 2.5, 2.0, 1.5, 1.0, 0.5)
    base = Scenario.load("override_current")
    control, drive = base.control, base.feed_drive
    speed = (
        1000.0
        * control.initial_cutting_speed
        / (math.pi * base.workpiece.diameter)
        * control.initial_feed
        / 60.0
    )  # [mm/s]
    length = len(depths) * HOLD * speed
    scenario = changed(
        "override_current", workpiece=UNDISTURBED | {"depth_profile": depths, "bar_length": length}
    )
    policy = FixedParameters(scenario, control.initial_cutting_speed, control.initial_feed)
    kept = record(policy, scenario, tuning_seeds(1), len(depths) * HOLD)
    path, depth, force = (kept[name][:, 0] for name in ("path", "depth_of_cut", "thrust_force"))
    amplitude = np.array(
        [read(observations, scenario).servo_current[0] for observations in kept["observation"]]
    )
    phase = amplitude * np.cos(2.0 * math.pi * drive.pole_pairs * path / drive.screw_lead)
    # Every hold without its start and end, at its mean force. The gaps close up, which no analysis of single holds sees.
    changes = np.flatnonzero(np.diff(depth)) + 1
    samples = round((HOLD - 2.0 * SETTLING) / control.interval)
    starts = [int(change) + round(SETTLING / control.interval) for change in changes[: len(depths)]]
    holds = [slice(start, start + samples) for start in starts]
    current = np.array([phase[hold] for hold in holds]).ravel()
    load = np.repeat([float(force[hold].mean()) for hold in holds], samples)
    time = control.interval * np.arange(len(current), dtype=np.float64)
    return drive.pole_pairs * speed / drive.screw_lead, analyse(time, current, load)


def characteristic_checks() -> Iterator[Check]:
    """Yield the checks of the quantities that tell the load from a phase current: spectrum, low-pass, root mean square."""
    frequency, report = loaded_and_unloaded()
    yield Check(
        "phase current: peak of the spectrum, at the electrical frequency [Hz]",
        frequency,
        report.frequency,
        0.35,
    )
    rising = np.diff(report.quantities["peak"][: int(np.argmax(report.load)) + 1])
    yield claim("phase current: the peak grows with the load, from depth to depth", rising > 0.0)
    for name, line in report.lines.items():
        yield at_least(f"phase current, {name}: linear in the load, R2", 0.99, line.r_squared)


def phase_checks() -> Iterator[Check]:
    """Yield the checks of the phase currents (4), of amplitude 1, at any angle."""
    current, thirds = (
        np.linspace(0.0, 2.0 * math.pi, 13)[:, np.newaxis],
        2.0 * math.pi / 3.0 * np.array([0.0, 1.0, -1.0]),
    )
    phases, rotor = (
        np.cos(current + thirds),
        current + 0.5 * math.pi,
    )  # a quarter turn ahead, or i_d would not be 0
    i_d, i_q = (
        math.sqrt(2.0 / 3.0) * (wave(rotor + thirds) * phases).sum(axis=1)
        for wave in (np.cos, np.sin)
    )
    yield at_most(
        "equation (5): largest sum of the phase currents, over I",
        1e-12,
        float(np.abs(phases.sum(axis=1)).max()),
    )
    yield at_most("equation (6): largest i_d, over I", 1e-12, float(np.abs(i_d).max()))
    yield at_most(
        "equation (6): i_q over I is the same at any angle: range", 1e-12, float(np.ptp(i_q))
    )
    # (7) needs i_q = I: its factor 3/2 is that of a transform with 2/3, not with the printed root of it.
    yield Check(
        "equation (6) with the factor 2/3: i_q over I",
        1.0,
        math.sqrt(2.0 / 3.0) * float(i_q[0]),
        1e-12,
    )


def motor_checks() -> Iterator[Check]:
    """Yield the checks of the current at no load, at various feeds and forces, and of its equations."""
    scenario = Scenario.load("override_current")
    parameters: Any = parameter_records(scenario)[0]
    current = float(steady_current(parameters, 0, 1000.0, 0.0))
    solved = float(force_from_current(parameters, 0, current, 0.0))  # type: ignore[no-untyped-call]
    yield Check(
        "force at the current of 1000 N: equations (3) and (8), solved [N]", 1000.0, solved, 1e-9
    )
    # The right-hand side of (9) as printed is a torque. Read as T_c, not F_c, it is (1), (2) and (8).
    drive = scenario.feed_drive
    screw = (
        drive.screw_lead / 1000.0 / (2.0 * math.pi * drive.efficiency)
    )  # torque over force [m] by (3)
    resistance = drive.guide_friction + drive.preload * (
        1.0 - drive.screw_efficiency**2
    )  # of friction and preload [N]
    printed = 1.5 * drive.pole_pairs * drive.flux_linkage * current - screw * resistance
    yield Check(
        "equation (9), read as the cutting torque T_c of 1000 N [N m]",
        1000.0 * screw,
        printed,
        1e-9,
    )
    idle = no_load_currents()
    yield claim("the current is not 0 at no load", bool(idle.min() > 0.1))
    yield claim(
        "the idle current changes with the feed rate, 50 to 200 mm/min", np.diff(idle) > 0.0
    )
    forces, currents = currents_of_depths()
    line = np.polyval(np.polyfit(forces, currents, 1), forces)
    yield at_most(
        "the current is linear in the force: largest deviation",
        0.01,
        float(np.abs(currents / line - 1.0).max()),
    )
    yield at_most(
        "idle current's change over the current of 1000 N: little",
        0.1,
        float(np.ptp(idle)) / current,
    )
    yield at_most(
        "Hall sensor: 25 mA over 500 Ohm [V], within its supply",
        HALL_SUPPLY,
        HALL_OUTPUT * HALL_RESISTANCE,
    )
    reason = "the drive's constants are assumptions; 3 mm at the programmed feed are too much for the sensor"
    yield at_most(
        "Hall sensor: highest current on the stepped bar [A]",
        HALL_CURRENT,
        float(stepped().current.max()),
        reason,
    )
    yield at_least("the current lags the force [samples of 12 ms]", 1, sensor_lag())


def estimation_checks() -> Iterator[Check]:
    """Yield the checks of filter and root mean square against the inversion of every sample."""
    plain, *filtered = all_errors()["12 ms, stepped bar"]
    yield claim(
        "stepped bar: the lowest cut-off lags so far that it does worse than one sample",
        filtered[0] > plain,
    )
    for name, most in (
        ("12 ms, steady cutting", 0.7),
        ("12 ms, stepped bar, lag allowed for", 0.8),
    ):
        plain, *filtered = all_errors()[name]
        for (cutoff, window), error in zip(SETTINGS, filtered, strict=True):
            yield at_most(
                f"{name}, cut-off {cutoff}, {window} samples: error over one sample's",
                most,
                error / plain,
            )


def control_checks() -> Iterator[Check]:
    """Yield the checks of the adaptive feed, with the current sensed and with a dynamometer."""
    results = controlled()
    sensed, measured, cautious = (
        results[name] for name in ("current", "dynamometer", "cautious feed")
    )
    yield at_most(
        "adaptive feed: return lost by sensing the current, over the dynamometer's",
        0.1,
        sensed[0] / measured[0] - 1.0,
    )
    yield at_most(
        "adaptive feed: time over that of a feed that suits the deepest cut",
        0.9,
        sensed[1] / cautious[1],
    )
    yield at_most(
        "adaptive feed: share of cutting time over the limit by more than 5 %", 0.05, sensed[2]
    )


@cache
def controlled() -> dict[str, tuple[float, float, float]]:
    """Return (mean return [s], mean time [s], severe share of cutting time [-]) on the stepped bar by policy."""
    current, dynamometer = Scenario.load("override_current"), Scenario.load("override")
    limit = dynamometer.limits.power / dynamometer.machine.rated_power
    share = 0.37  # of the thrust force limit: that at which the spindle has nearly the target load
    deepest = float(
        dynamometer.material.power(
            dynamometer.control.initial_cutting_speed, dynamometer.control.initial_feed, 3.0
        )
    )
    override = (limit * dynamometer.machine.rated_power / deepest) ** (
        1.0 / dynamometer.material.power.feed
    )
    feed = override * dynamometer.control.initial_feed
    policies: dict[str, tuple[Scenario, PolicyFactory]] = {
        "current": (
            current,
            lambda num_envs: CurrentLimit(PartProgram(current, {}), num_envs, share),
        ),
        "dynamometer": (
            dynamometer,
            lambda num_envs: CurrentLimit(PartProgram(dynamometer, {}), num_envs, share),
        ),
        "cautious feed": (
            current,
            lambda num_envs: FixedParameters(current, current.control.initial_cutting_speed, feed),
        ),
    }
    results = {}
    for name, (scenario, make) in policies.items():
        episodes = play(make, scenario, tuning_seeds(NUM_SEEDS))
        severe = episodes["severe_overload_time"].sum() / episodes["engaged_time"].sum()
        results[name] = (
            float(episodes["return"].mean()),
            float(episodes["time"].mean()),
            float(severe),
        )
    return results


def tables() -> Iterator[str]:
    """Yield the errors of the estimates, and how well each quantity of the phase current gives the load."""
    yield "Estimated against true thrust force, root mean square error over mean force, at the programmed feed."
    heads = [
        "",
        "every sample inverted",
        *(f"cut-off {cutoff}, {window} samples" for cutoff, window in SETTINGS),
    ]
    rows = [[name, *(f"{error:.1%}" for error in found)] for name, found in all_errors().items()]
    yield from table(
        heads, [*rows, ["lag of the estimate [samples]", "", *(f"{delay:.1f}" for delay in DELAYS)]]
    )
    yield ""
    yield "Phase current while the depth of cut rises to 3 mm and falls again."
    report = loaded_and_unloaded()[1]
    holds = zip(report.load, *report.quantities.values(), strict=True)
    yield from table(
        ["thrust force [N]", *report.quantities],
        [[f"{value:.4g}" for value in hold] for hold in holds],
    )


def checks() -> Iterator[Check]:
    """Yield all checks of the paper."""
    yield from phase_checks()
    yield from motor_checks()
    yield from characteristic_checks()
    yield from estimation_checks()
    yield from control_checks()
