"""LinuxCNC: the controller behind its HAL component, and a simulated lathe that runs it.

``serve`` is the process behind ``hal_bridge.py``: it reads lines of JSON with input pins, and
answers with lines of output pins. ``run`` writes the lathe's configuration into a folder, starts
LinuxCNC without a screen and waits for the program's end. ``figures`` and ``simulated`` compare
such a run with the simulation.

``core.py`` decides on commands, ``plant.py`` is the lathe's process, ``lathe/`` the configuration.
"""

import contextlib
import csv
import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from turning_control.core import (
    Commands,
    Controller,
    Status,
    highest_feed,
    on_control,
    safe_feed,
)
from turning_control.pins import FEED_MOTION, Pins
from turning_control.policy_process import in_own_process, loads_code_or_a_file
from turning_control.readings import (
    FURTHER,
    Readings,
    bar_spindle_speed,
    force_reading,
    needed_readings,
    possible_values,
)
from turning_control.shield import LOG, Shield

from baselines import catalogue
from leaderboard.adapt import as_factory
from turning_env.action import towards
from turning_env.observation import read
from turning_env.physics.drives import lag_share
from turning_env.policy import Actions, Observations, PolicyFactory
from turning_env.scenario import Scenario
from turning_env.vector_env import RoughTurningVectorEnv

PYTHON = "/usr/bin/python3"  # the Python that has LinuxCNC's modules
PACKAGE = "linuxcnc-uspace"
NOBODY = 65534  # user to whom LinuxCNC's motion falls back if root starts it
MAX_LATE = 0.01  # share of time at the safe feed up to which figures are the policy's [-]

# Pins, and their types. Units: spindle speed [rev/min], feed velocity [mm/s], position along the
# bar [mm], power [kW], force [N], and the controller's delay [s].
_MOTION = {
    "spindle-speed": "float",
    "feed-velocity": "float",
    "motion-type": "s32",
    "position": "float",
}
_LOADS = {"power": "float", "thrust-force": "float", "edge": "u32"}
CONTROLLER_PINS = {
    "in": {**_MOTION, **_LOADS, "in-position": "bit", "cutting": "bit"},
    "out": {"adaptive-feed": "float", "spindle-override": "float", "status": "s32"},
}
PLANT_PINS = {"in": {**_MOTION, "adaptive-feed": "float", "delay": "float"}, "out": _LOADS}


class LinuxCncError(RuntimeError):
    """LinuxCNC is not installed, or did not run the program."""


def find_policy(name: str, scenario: Scenario, deadline: float = 10.0) -> PolicyFactory:
    """Return the policy that a user names, or raise ValueError.

    It is ``programmed`` (the part program's feed), a rule of ``baselines``, ``module:object`` or an
    ONNX file. The last two run in a process of their own, which must answer within the
    ``deadline`` [s].
    """
    if name == "programmed":
        return _programmed(scenario)
    if loads_code_or_a_file(name):
        return in_own_process(name, deadline)
    return catalogue.spec(name, scenario).make


def _programmed(scenario: Scenario) -> PolicyFactory:
    """Return the policy that holds the part program's speed and feed."""
    control = scenario.control

    def policy(observations: Observations) -> Actions:
        num_envs = len(observations)
        return towards(
            read(observations, scenario),
            scenario,
            cutting_speed=np.full(num_envs, control.initial_cutting_speed),
            feed=np.full(num_envs, control.initial_feed),
        )

    return as_factory(policy)


def serve(scenario: Scenario, make_policy: PolicyFactory, bridge: Pins) -> None:
    """Answer the controller's pins until the bridge's requests end."""
    controller = Controller(scenario, make_policy)
    _warm_up(scenario, controller)
    interval = scenario.control.interval
    # Feed velocity [mm/s] over spindle speed [rev/min] below which a motion is held.
    min_advance = 0.5 * scenario.machine.feed_min / 60.0

    before: dict[str, Any] = {}  # pins of the last request
    commands: Commands | None = None
    decided_at = 0.0  # [s]
    engaged_time = 0.0  # since then [s]
    for pins in bridge:
        seconds = pins["time"] - before["time"] if before else 0.0
        spindle_speed = abs(pins["spindle-speed"])
        # A velocity that is lost (NaN) is no standstill.
        moves = not pins["feed-velocity"] <= min_advance * spindle_speed
        in_feed = pins["motion-type"] == FEED_MOTION and not pins["in-position"] and moves
        if pins["cutting"] and in_feed:
            engaged_time += seconds

        # Requests may come more often than decisions are due, and not quite in time.
        is_due = pins["time"] - decided_at > interval - 0.5 * max(seconds, 1e-3)
        if commands is None or is_due:
            readings = Readings(
                spindle_speed=spindle_speed,
                feed_velocity=60.0 * pins["feed-velocity"],
                in_feed=in_feed,
                cutting=pins["cutting"],
                engaged_time=engaged_time,
                power=pins["power"],
                position=pins["position"],
                new_edge=bool(before) and pins["edge"] != before["edge"],
                **{force_reading(scenario): pins["thrust-force"]},
            )
            if not before:
                _warn_of_lacking(controller, readings)
            commands = controller.decide(readings)
            decided_at = pins["time"]
            engaged_time = 0.0
        before = pins
        bridge.answer(
            adaptive_feed=commands.adaptive_feed,
            spindle_override=commands.spindle_override,
            status=int(commands.status),
        )


def _warm_up(scenario: Scenario, controller: Controller) -> None:
    """Compile and load everything before the first reading counts."""
    spans = possible_values(scenario)
    loads: dict[str, Any] = {}
    for name in needed_readings(scenario):
        loads[name] = 0.05 * spans[name].high
    for name in FURTHER:
        if name in spans:
            loads[name] = spans[name].low
    spindle_speed = bar_spindle_speed(scenario, scenario.control.initial_cutting_speed)
    motion = {
        "spindle_speed": spindle_speed,
        "feed_velocity": scenario.control.initial_feed * spindle_speed,
        "engaged_time": 0.0,
    }
    readings = Readings(**{**loads, **motion}, in_feed=True, cutting=True)
    for _ in range(3):
        controller.decide(readings)
    controller.start()


def _warn_of_lacking(controller: Controller, readings: Readings) -> None:
    lacking = controller.lacks(readings)
    if lacking:
        names = ", ".join(lacking)
        LOG.warning("the policy's observation lacks %s: the safe feed holds", names)


class Fault(NamedTuple):
    """A fault to cause while the program runs."""

    name: str  # one of those in ``lathe/panel.py``
    after: float  # time after the program's start [s]
    lasts: float = 2.0  # [s]


def program(scenario: Scenario, bars: int) -> str:
    """Return the part program.

    It makes ``bars`` passes at the highest feed with adaptive feed, between run-ups at the
    programmed feed.
    """
    work = scenario.workpiece
    control = scenario.control
    highest = highest_feed(scenario)
    radius = 0.5 * work.diameter
    spindle_speed = bar_spindle_speed(scenario, control.initial_cutting_speed)
    time_constant = scenario.machine.feed_time_constant
    lag = spindle_speed / 60.0 * time_constant  # [rev] by which the drive is behind
    run_up = 5.0 * lag * highest + 1.0  # [mm] in which it settles
    start = f"""G18 G21 G8 G90 G54
G97 S{spindle_speed:.1f} M3
G95
"""
    # M52 P1 lets the controller scale the feed of the pass, P0 takes it away. The dwell lets the
    # drive settle: the velocity of the rapids is no feed.
    bar = f"""M52 P0
G0 X{radius + 5:.3f}
G0 Z{work.approach + run_up:.3f}
G0 X{radius:.3f}
G4 P{10.0 * time_constant:.2f}
G1 Z{work.approach - lag * control.initial_feed:.3f} F{control.initial_feed:.4f}
M52 P1
G1 Z{-work.bar_length - run_up:.3f} F{highest:.4f}
"""
    end = f"""M52 P0
G0 X{radius + 5:.3f}
M5
M2
"""
    return start + bars * bar + end


def run(
    policy: str,
    scenario: Path | str,
    bars: int,
    seed: int,
    fault: Fault | None = None,
    decisions: Path | None = None,
) -> list[dict[str, float]]:
    """Run a policy through LinuxCNC; return the plant's log, one row per cycle.

    Args:
        policy: as ``find_policy`` names it.
        scenario: preset or TOML file.
        bars: number of bars to cut.
        seed: determines bars and edges.
        fault: fault to cause while the program runs.
        decisions: text file for every decision.

    Raises:
        LinuxCncError: LinuxCNC is not installed, or did not run the program to its end.
    """
    if shutil.which("linuxcnc") is None or not Path(PYTHON).exists():
        raise LinuxCncError(
            "LinuxCNC is not installed; install it on Debian with: "
            f"apt-get install --no-install-recommends {PACKAGE}"
        )
    loaded = Scenario.load(scenario)
    policy = _from_anywhere(policy)
    scenario = _from_anywhere(scenario)
    with tempfile.TemporaryDirectory(prefix="turning-") as name:
        folder = Path(name)
        log = folder / "log.csv"
        _write_lathe(folder, loaded)
        (folder / "bars.ngc").write_text(program(loaded, bars))
        serving = ["turning_control", "drive", "--policy", policy, "--scenario", scenario]
        if decisions is not None:
            serving += ["--log", str(decisions.resolve())]
        planting = ["turning_control.plant", "--scenario", scenario, "--seed", str(seed)]
        planting += ["--log", str(log)]
        plans: dict[str, dict[str, Any]] = {
            "turning": _controller_plan(loaded, serving),
            "plant": _plant_plan(loaded, planting),
            "panel": {"parent": os.getpid(), "fault": fault._asdict() if fault else None},
        }
        for part, plan in plans.items():
            (folder / f"{part}.json").write_text(json.dumps(plan))
        output = _start(folder, 60.0 + bars * 600.0)
        rows = _read_log(log)
        if not rows:
            raise LinuxCncError(f"LinuxCNC did not run the program:\n{output[-2000:]}")
        return rows


def _from_anywhere(name: Path | str) -> str:
    """Return a name that means the same in LinuxCNC's own folder: files get absolute paths."""
    path = Path(name)
    return str(path.resolve()) if path.is_file() else str(name)


def _controller_plan(scenario: Scenario, arguments: list[str]) -> dict[str, Any]:
    """Return the plan of the component behind which the controller runs (``hal_bridge.py``)."""
    safe = {
        "adaptive-feed": safe_feed(scenario),
        "spindle-override": 1.0,
        "status": int(Status.SAFE),
    }
    return {
        **CONTROLLER_PINS,
        "period": scenario.control.interval,
        "echo": True,
        "ranges": pin_ranges(scenario),
        "safe": safe,
        "command": _command(arguments),
    }


def _plant_plan(scenario: Scenario, arguments: list[str]) -> dict[str, Any]:
    """Return the plan of the component behind which the plant runs (``hal_bridge.py``)."""
    control = scenario.control
    return {
        **PLANT_PINS,
        "period": min(control.interval / control.sub_steps, 0.02),
        "echo": True,
        "safe": {},  # if an answer is late, the last loads hold
        "command": _command(arguments),
    }


def _command(arguments: list[str]) -> list[str]:
    """Return the command that runs a module from LinuxCNC, which sets paths of its own."""
    paths = os.pathsep.join([os.getcwd(), *filter(None, sys.path)])
    return ["env", f"PYTHONPATH={paths}", sys.executable, "-m", *arguments]


def _read_log(log: Path) -> list[dict[str, float]]:
    """Return the rows of the plant's log, none if there is no file."""
    if not log.is_file():
        return []
    rows = []
    for row in csv.DictReader(log.read_text().splitlines()):
        rows.append({name: float(value) for name, value in row.items()})
    return rows


def pin_ranges(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Return the lowest and highest values of the controller's outputs."""
    programmed = scenario.control.initial_cutting_speed
    lowest = scenario.machine.cutting_speed_min / programmed
    highest = scenario.cutting_speed_max / programmed
    rounding = 1e-3
    return {
        "adaptive-feed": (0.0, 1.0),
        "spindle-override": (lowest - rounding, highest + rounding),
        "status": (int(min(Status)), int(max(Status))),
    }


def _write_lathe(folder: Path, scenario: Scenario) -> None:
    """Write the lathe's configuration into a folder."""
    programmed_speed = scenario.control.initial_cutting_speed
    turns = bar_spindle_speed(scenario, programmed_speed) / 60.0  # [1/s]
    velocity = turns * scenario.machine.feed_max
    lag = scenario.machine.feed_time_constant
    # Accelerations are ten times those that the drive's lag needs, so that the lag decides.
    acceleration = max(10.0 * velocity / max(lag, 0.01), 10.0)
    values = {
        "PYTHON": PYTHON,
        "FOLDER": str(folder),
        "ACCELERATION": f"{acceleration:.1f}",
        "LAG_SHARE": f"{lag_share(0.001, lag):.9f}",  # in a servo cycle
        "METAL_POWER": f"{0.02 * scenario.limits.power:.4f}",
        "METAL_HYSTERESIS": f"{0.01 * scenario.limits.power:.4f}",
    }
    for source in (files("turning_control") / "lathe").iterdir():
        if source.is_file():
            text = source.read_text()
            for name, value in values.items():
                text = text.replace(f"{{{name}}}", value)
            (folder / source.name).write_text(text)
    (folder / "panel.py").chmod(0o755)


def _start(folder: Path, limit: float) -> str:
    """Start LinuxCNC on the folder's lathe and wait for its end; return its output.

    Nothing that it started is left running, even after ``limit`` [s] without an end.
    """
    environment = {}
    for name, value in os.environ.items():
        if not name.startswith("PYTHON"):
            environment[name] = value
    environment["OMP_NUM_THREADS"] = "1"
    environment["TURNING_FOLDER"] = str(folder)  # marks every process that descends from here
    if os.getuid() == 0:
        # As root, LinuxCNC asks which user it serves.
        os.chown(folder, NOBODY, -1)
        environment["RTAPI_UID"] = str(NOBODY)
        environment["RTAPI_FIFO_PATH"] = str(folder / "rtapi")
        environment["HOME"] = str(folder)
    # LinuxCNC wants a terminal, which ``script`` is.
    command = ["script", "-qec", shlex.join(["linuxcnc", str(folder / "lathe.ini")]), "/dev/null"]
    with (folder / "output").open("wb") as file:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=file,
            start_new_session=True,
        )
        try:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(limit)
        finally:
            _end(process, folder)
    output = (folder / "output").read_text(errors="replace")
    if process.returncode != 0:
        raise LinuxCncError(f"LinuxCNC did not run the program to its end:\n{output[-2000:]}")
    return output


def _end(process: subprocess.Popen[bytes], folder: Path) -> None:
    """Let LinuxCNC end in order through its panel.

    A second Ctrl-C, or a minute without an end, kills its processes.
    """
    (folder / "stop").touch()
    try:
        process.wait(60.0)
    finally:
        if process.poll() is None:
            _kill_processes_of(folder)


def _kill_processes_of(folder: Path) -> None:
    """Kill every process with the folder's mark in its environment."""
    mark = f"TURNING_FOLDER={folder}".encode()
    for path in Path("/proc").glob("[0-9]*/environ"):
        # Processes may end meanwhile, and those of others cannot be read.
        with contextlib.suppress(OSError):
            if mark in path.read_bytes().split(b"\0"):
                os.kill(int(path.parent.name), signal.SIGKILL)


class Figures(NamedTuple):
    """Times, loads and edges of a policy on bars."""

    time: float  # time at feed per bar [s]
    mean_power: float  # [kW]
    severe: float  # share of cutting time with an excess above the tolerance [-]
    edges: float  # used
    # Share of the time at feed in which the safe feed held, because an answer was late [-].
    safe: float
    # Mean time from the controller's readings to its command; in the simulation, until drives
    # follow [s].
    delay: float


class Comparison(NamedTuple):
    """A policy's figures on the same bars."""

    linuxcnc: Figures
    simulation: Figures


def figures(rows: list[dict[str, float]], safe_share: float) -> Figures:
    """Return the figures of a run through LinuxCNC.

    ``safe_share`` is the safe feed over the highest [-].
    """
    at_feed = [row for row in rows if row["at_feed"]]
    columns = {}
    for name in rows[0]:
        columns[name] = np.array([row[name] for row in at_feed])
    seconds = columns["seconds"]
    engaged = columns["engaged_time"]
    severe = columns["severe_overload_time"]
    in_metal = engaged > 0.0
    bars = np.unique(columns["bar"][in_metal])
    is_safe = np.abs(columns["adaptive_feed"] - safe_share) < 1e-6
    return Figures(
        time=seconds.sum() / len(bars),
        mean_power=np.average(columns["power"], weights=engaged),
        severe=severe.sum() / engaged.sum(),
        edges=1.0 + rows[-1]["edge"],
        safe=np.average(is_safe, weights=seconds),
        delay=np.average(columns["delay"], weights=seconds),
    )


def simulated(policy: str, scenario: Scenario, bars: int, seed: int) -> Figures:
    """Return the figures of the same shielded policy on the same bars in the simulation."""
    delayed = on_control(scenario)
    control = scenario.control.model_copy(update={"edge_changes": "automatic"})
    workpiece = scenario.workpiece.model_copy(update={"bars": bars})
    pitch = workpiece.approach + workpiece.bar_length
    env = RoughTurningVectorEnv(
        1, delayed.model_copy(update={"control": control, "workpiece": workpiece})
    )
    shield = Shield(find_policy(policy, scenario)(1), delayed, 1)
    observations, info = env.reset(seed=[seed])
    shield.reset(np.ones(1, np.bool_))
    names = ("time", "stopped_time", "engaged_time", "severe_overload_time", "edges_broken")
    sums = dict.fromkeys(names, 0.0)
    energy = 0.0  # [kW s]
    ended = False
    while not ended:
        shield.place = info["path"] % pitch - workpiece.approach  # a control knows it
        observations, _, terminated, truncated, info = env.step(shield.act(observations))
        ended = bool(terminated[0] or truncated[0])
        for name in names:
            sums[name] += float(info[name][0])
        energy += float(info["engaged_time"][0] * info["mean_power"][0])
    return Figures(
        time=(sums["time"] - sums["stopped_time"]) / bars,
        mean_power=energy / sums["engaged_time"],
        severe=sums["severe_overload_time"] / sums["engaged_time"],
        edges=1.0 + sums["edges_broken"],
        safe=0.0,
        delay=delayed.machine.command_delay,
    )


def figures_table(comparisons: Mapping[str, Comparison]) -> str:
    """Return the figures of policies as a Markdown table."""
    heads = (
        "Policy, shielded",
        "Where",
        "Cycle time [s/bar]",
        "Mean power [kW]",
        "Over 5 % [% of cutting time]",
        "Edges",
        "Late [%]",
        "Delay [ms]",
    )
    rows = []
    for name, comparison in comparisons.items():
        rows.append((name, "LinuxCNC", *_cells(comparison.linuxcnc)))
        rows.append((name, "simulation", *_cells(comparison.simulation)))
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def lateness(figures: Figures) -> str:
    """Return a warning if late answers make the figures those of the computer; else nothing."""
    if figures.safe <= MAX_LATE:
        return ""
    return (
        f"the safe feed held for {100 * figures.safe:.0f} % of the time, as answers came later "
        "than a control interval: do not compare the rows, and run it again on idle cores"
    )


def _cells(figures: Figures) -> list[str]:
    """Return the cells of figures in a row of the table."""
    return [
        f"{figures.time:.2f}",
        f"{figures.mean_power:.2f}",
        f"{100 * figures.severe:.1f}",
        f"{figures.edges:.0f}",
        f"{100 * figures.safe:.1f}",
        f"{1000 * figures.delay:.1f}",
    ]
