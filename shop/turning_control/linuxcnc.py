"""LinuxCNC: processes behind its HAL components, and a lathe without hardware that runs them.

``serve`` and ``plant`` are the processes behind ``hal_bridge.py``: lines of JSON with pins in, lines of JSON with pins out.
``run`` writes the lathe's configuration into a folder, starts LinuxCNC without a screen and waits for the program's end.
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
from collections.abc import Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import numpy as np
from turning_control.core import (
    Controller,
    Readings,
    Status,
    force_reading,
    highest_feed,
    on_control,
    safe_feed,
)
from turning_control.measure import markdown
from turning_control.plant import Plant
from turning_control.policy_process import in_own_process, loads_code_or_a_file
from turning_control.shield import LOG, Shield

from baselines import catalogue
from turning_env.action import towards
from turning_env.observation import read
from turning_env.physics.drives import lag_share
from turning_env.scenario import Scenario
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.policy import Actions, Observations, PolicyFactory
from turning_env.vector_env import RoughTurningVectorEnv

PYTHON = "/usr/bin/python3"  # the Python that has LinuxCNC's modules
PACKAGE = "linuxcnc-uspace"
FEED_MOTION = 2  # ``motion.motion-type`` of a move at feed
NOBODY = 65534  # user to whom LinuxCNC's motion falls back if root starts it

# Spindle speed [rev/min], feed velocity [mm/s], position along the bar [mm], power [kW], force [N], the controller's delay [s].
_MOTION = {
    "spindle-speed": "float",
    "feed-velocity": "float",
    "motion-type": "s32",
    "position": "float",
}
_LOADS = {"power": "float", "thrust-force": "float", "edge": "u32"}
CONTROLLER_PINS = {
    "in": _MOTION | _LOADS | {"in-position": "bit", "cutting": "bit"},
    "out": {"adaptive-feed": "float", "spindle-override": "float", "status": "s32"},
}
PLANT_PINS = {"in": _MOTION | {"adaptive-feed": "float", "delay": "float"}, "out": _LOADS}


class LinuxCncError(RuntimeError):
    """LinuxCNC is not installed, or did not run the program."""


def find_policy(name: str, scenario: Scenario, deadline: float = 10.0) -> PolicyFactory:
    """Return the policy that a user names, or raise ValueError.

    It is ``programmed`` (the part program's feed), a rule of ``baselines``, ``module:object`` or an
    ONNX file. The last two run in a process of their own, which must answer within the
    ``deadline`` [s].
    """
    if name == "programmed":
        control = scenario.control

        def programmed(observations: Observations) -> Actions:
            speed, feed = (
                np.full(len(observations), v)
                for v in (control.initial_cutting_speed, control.initial_feed)
            )
            return towards(read(observations, scenario), scenario, speed, feed)

        return as_factory(programmed)
    if loads_code_or_a_file(name):
        return in_own_process(name, deadline)
    return catalogue.spec(name, scenario).make


class Pins:
    """The other side of ``hal_bridge.py``: yields its requests, and answers the last one."""

    def __init__(self, requests: TextIO, answers: TextIO) -> None:
        self._requests = requests
        self._answers = answers
        self._time = 0.0  # of the last request

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Say that everything is loaded, then yield pins until the requests end."""
        self._write("ready")
        for line in self._requests:
            pins = json.loads(line)
            self._time = pins["time"]
            yield pins

    def answer(self, **pins: float) -> None:
        """Answer the last request."""
        values = {name.replace("_", "-"): value for name, value in pins.items()}
        self._write(json.dumps({"time": self._time, **values}))

    def _write(self, line: str) -> None:
        self._answers.write(line + "\n")
        self._answers.flush()


def serve(scenario: Scenario, make_policy: PolicyFactory, bridge: Pins) -> None:
    """Answer the controller's pins until the bridge's requests end."""
    controller = Controller(scenario, make_policy)
    for _ in range(3):  # compile and load everything before the first reading counts
        controller.decide(
            Readings(
                400.0, 100.0, True, True, 0.0, power=1.0, thrust_force=100.0, servo_current=1.0
            )
        )
    controller.start()
    before: dict[str, Any] = {}
    interval, begun, engaged, commands = scenario.control.interval, 0.0, 0.0, None
    lowest = 0.5 * scenario.machine.feed_min / 60.0  # over the spindle's speed
    for pins in bridge:
        seconds = pins["time"] - before.get("time", pins["time"])
        moves = pins["feed-velocity"] > lowest * abs(pins["spindle-speed"])  # not held
        in_feed = pins["motion-type"] == FEED_MOTION and not pins["in-position"] and moves
        engaged += seconds if pins["cutting"] and in_feed else 0.0
        if commands is None or pins["time"] - begun > interval - 0.5 * max(seconds, 1e-3):
            readings = Readings(
                spindle_speed=abs(pins["spindle-speed"]),
                feed_velocity=60.0 * pins["feed-velocity"],
                in_feed=in_feed,
                cutting=pins["cutting"],
                engaged_time=engaged,
                power=pins["power"],
                position=pins["position"],
                new_edge=pins["edge"] != before.get("edge", pins["edge"]),
                **{force_reading(scenario): pins["thrust-force"]},
            )
            if not before and (lacking := controller.lacks(readings)):
                LOG.warning(
                    "the policy's observation lacks %s: the safe feed holds", ", ".join(lacking)
                )
            commands = controller.decide(readings)
            begun, engaged = pins["time"], 0.0
        before = pins
        bridge.answer(
            adaptive_feed=commands.adaptive_feed,
            spindle_override=commands.spindle_override,
            status=int(commands.status),
        )


def serve_plant(scenario: Scenario, seed: int, log: Path, bridge: Pins) -> None:
    """Answer the plant's pins until the bridge's requests end, and log every cycle to a file."""
    Plant(scenario, seed).advance(0.01, 0.0, 100.0, 0.0, False)  # compiles
    plant, work, before = Plant(scenario, seed), scenario.workpiece, None
    with log.open("w", newline="") as file:
        writer = None
        for pins in bridge:
            seconds = pins["time"] - before if before else 0.001
            before = pins["time"]
            along = work.approach + pins["position"]
            at_feed = (
                pins["motion-type"] == FEED_MOTION
                and 0.0 <= along < work.approach + work.bar_length
            )
            hidden = plant.advance(
                max(seconds, 1e-4),
                along,
                abs(pins["spindle-speed"]),
                pins["feed-velocity"],
                at_feed,
            )
            row = {"time": pins["time"], "seconds": seconds, "at_feed": int(at_feed)}
            row |= {"adaptive_feed": pins["adaptive-feed"], "delay": pins["delay"]} | hidden
            if writer is None:
                writer = csv.DictWriter(file, list(row))
                writer.writeheader()
            writer.writerow(row)
            force = hidden[f"measured_{force_reading(scenario)}"]
            bridge.answer(
                power=hidden["measured_power"], thrust_force=force, edge=int(hidden["edge"])
            )


class Fault(NamedTuple):
    """A fault to cause while the program runs."""

    name: str  # one of those in ``lathe/panel.py``
    after: float  # time after the program's start [s]
    lasts: float = 2.0  # [s]


def program(scenario: Scenario, bars: int) -> str:
    """Return the part program: ``bars`` passes at the highest feed, with adaptive feed, between run-ups at the programmed one."""
    work, control, machine = scenario.workpiece, scenario.control, scenario.machine
    highest, radius = highest_feed(scenario), 0.5 * work.diameter
    spindle_speed = 1000.0 * control.initial_cutting_speed / (np.pi * work.diameter)
    lag = spindle_speed / 60.0 * machine.feed_time_constant  # [rev] by which the drive is behind
    run_up = 5.0 * lag * highest + 1.0  # [mm] in which it settles
    bar = f"""
M52 P0
G0 X{radius + 5:.3f}
G0 Z{work.approach + run_up:.3f}
G4 P{10.0 * machine.feed_time_constant:.2f}
G0 X{radius:.3f}
G1 Z{work.approach - lag * control.initial_feed:.3f} F{control.initial_feed:.4f}
M52 P1
G1 Z{-work.bar_length - run_up:.3f} F{highest:.4f}"""
    return f"G18 G21 G8 G90 G54\nG97 S{spindle_speed:.1f} M3\nG95{bars * bar}\nM52 P0\nG0 X{radius + 5:.3f}\nM5\nM2\n"


def run(
    policy: str, scenario: Path | str, bars: int, seed: int, fault: Fault | None = None
) -> list[dict[str, float]]:
    """Run a policy through LinuxCNC; return the plant's log, one row per cycle. LinuxCncError if it did not run to its end."""
    if shutil.which("linuxcnc") is None or not Path(PYTHON).exists():
        raise LinuxCncError(
            f"LinuxCNC is not installed: apt-get install --no-install-recommends {PACKAGE} (Debian) brings it"
        )
    loaded = Scenario.load(scenario)
    # LinuxCNC runs in a folder of its own.
    policy, scenario = (
        str(Path(each).resolve()) if Path(each).is_file() else str(each)
        for each in (policy, scenario)
    )
    places = os.pathsep.join(
        [os.getcwd(), *filter(None, sys.path)]
    )  # LinuxCNC sets paths of its own
    command = ["env", f"PYTHONPATH={places}", sys.executable, "-m", "turning_control"]
    with tempfile.TemporaryDirectory(prefix="turning-") as name:
        folder = Path(name)
        log, interval = folder / "log.csv", loaded.control.interval
        _write_lathe(folder, loaded)
        (folder / "bars.ngc").write_text(program(loaded, bars))
        turning: dict[str, Any] = CONTROLLER_PINS | {
            "period": interval,
            "echo": True,
            "ranges": pin_ranges(loaded),
            "safe": {
                "adaptive-feed": safe_feed(loaded),
                "spindle-override": 1.0,
                "status": int(Status.SAFE),
            },
            "command": [*command, "serve", "--policy", policy, "--scenario", scenario],
        }
        plant: dict[str, Any] = PLANT_PINS | {
            "period": min(interval / loaded.control.sub_steps, 0.02),
            "echo": True,
            "safe": {},  # late: the readings before hold
            "command": [
                *command,
                "plant",
                "--seed",
                str(seed),
                "--log",
                str(log),
                "--scenario",
                scenario,
            ],
        }
        panel = {"parent": os.getpid(), "fault": fault._asdict() if fault else None}
        for part, plan in {"turning": turning, "plant": plant, "panel": panel}.items():
            (folder / f"{part}.json").write_text(json.dumps(plan))
        output = _start(folder, 60.0 + bars * 600.0)
        lines = log.read_text().splitlines() if log.is_file() else []
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(lines)]
        if not rows:
            raise LinuxCncError(f"LinuxCNC did not run the program:\n{output[-2000:]}")
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
    """Write the lathe's configuration: accelerations ten times those that the drive's lag needs, so that the lag decides."""
    turns = (
        scenario.control.initial_cutting_speed
        * 1000.0
        / (np.pi * scenario.workpiece.diameter)
        / 60.0
    )
    velocity, lag = turns * scenario.machine.feed_max, scenario.machine.feed_time_constant
    values = {
        "PYTHON": PYTHON,
        "FOLDER": str(folder),
        "ACCELERATION": f"{max(10.0 * velocity / max(lag, 0.01), 10.0):.1f}",
    }
    values |= {"LAG_SHARE": f"{lag_share(0.001, lag):.9f}"}  # in a servo cycle
    values |= {
        f"METAL_{name}": f"{share * scenario.limits.power:.4f}"
        for name, share in (("POWER", 0.02), ("HYSTERESIS", 0.01))
    }
    for source in (files("turning_control") / "lathe").iterdir():
        if source.is_file():
            text = source.read_text()
            for name, value in values.items():
                text = text.replace(f"{{{name}}}", value)
            (folder / source.name).write_text(text)
    (folder / "panel.py").chmod(0o755)


def _start(folder: Path, limit: float) -> str:
    """Start LinuxCNC on the folder's lathe, wait for its end, and leave nothing running; return its output."""
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith("PYTHON")
    } | {"OMP_NUM_THREADS": "1"}
    environment["TURNING_FOLDER"] = str(folder)  # marks every process that descends from here
    if os.getuid() == 0:  # as root it wants to know which user it serves
        os.chown(folder, NOBODY, -1)
        environment |= {
            "RTAPI_UID": str(NOBODY),
            "RTAPI_FIFO_PATH": str(folder / "rtapi"),
            "HOME": str(folder),
        }
    command = ["script", "-qec", shlex.join(["linuxcnc", str(folder / "lathe.ini")]), "/dev/null"]
    with (folder / "output").open("wb") as output:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
        )
        try:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(limit)
        finally:
            _end(process, folder)
    said = (folder / "output").read_text(errors="replace")
    if process.returncode != 0:
        raise LinuxCncError(f"LinuxCNC did not run the program to its end:\n{said[-2000:]}")
    return said


def _end(process: subprocess.Popen[bytes], folder: Path) -> None:
    """Let LinuxCNC end in order through its panel; a second Ctrl-C, or a minute without an end, kills its processes."""
    (folder / "stop").touch()
    try:
        process.wait(60.0)
    finally:
        if process.poll() is None:
            for path in Path("/proc").glob("[0-9]*/environ"):
                with contextlib.suppress(OSError):
                    if f"TURNING_FOLDER={folder}".encode() in path.read_bytes().split(b"\0"):
                        os.kill(int(path.parent.name), signal.SIGKILL)


class Figures(NamedTuple):
    """Times, loads and edges of a policy on bars."""

    time: float  # time at feed per bar [s]
    mean_power: float  # [kW]
    severe: float  # share of cutting time with an excess above the tolerance [-]
    edges: float  # used
    safe: float  # share of the time at feed in which the safe feed held, because an answer was late [-]
    delay: float  # mean time from the controller's readings to its command; in the simulation, until drives follow [s]


def figures(rows: list[dict[str, float]], safe_feed: float) -> Figures:
    """Return the figures of a run through LinuxCNC, where ``safe_feed`` is the safe share of the highest feed."""
    columns = {name: np.array([row[name] for row in rows if row["at_feed"]]) for name in rows[0]}
    seconds, engaged = columns["seconds"], columns["engaged_time"]
    return Figures(
        time=seconds.sum() / len(np.unique(columns["bar"][engaged > 0.0])),
        mean_power=np.average(columns["power"], weights=engaged),
        severe=columns["severe_overload_time"].sum() / engaged.sum(),
        edges=1.0 + rows[-1]["edge"],
        safe=np.average(np.abs(columns["adaptive_feed"] - safe_feed) < 1e-6, weights=seconds),
        delay=np.average(columns["delay"], weights=seconds),
    )


def simulated(policy: str, scenario: Scenario, bars: int, seed: int) -> Figures:
    """Return the figures of the same shielded policy on the same bars in the simulation."""
    control, delayed = (
        scenario.control.model_copy(update={"edge_changes": "automatic"}),
        on_control(scenario),
    )
    workpiece = scenario.workpiece.model_copy(update={"bars": bars})
    env = RoughTurningVectorEnv(
        1, delayed.model_copy(update={"control": control, "workpiece": workpiece})
    )
    guard = Shield(find_policy(policy, scenario)(1), delayed, 1)
    observations, info = env.reset(seed=[seed])
    guard.reset(np.ones(1, np.bool_))
    names = (
        "time",
        "stopped_time",
        "engaged_time",
        "energy",
        "severe_overload_time",
        "edges_broken",
    )
    ended, sums = False, dict.fromkeys(names, 0.0)
    while not ended:
        guard.place = (
            info["path"] % (workpiece.approach + workpiece.bar_length) - workpiece.approach
        )  # which a control knows
        observations, _, terminated, truncated, info = env.step(guard.act(observations))
        ended = bool(terminated[0] or truncated[0])
        info["energy"] = info["engaged_time"] * info["mean_power"]
        sums = {name: total + float(info[name][0]) for name, total in sums.items()}
    return Figures(
        time=(sums["time"] - sums["stopped_time"]) / bars,
        mean_power=sums["energy"] / sums["engaged_time"],
        severe=sums["severe_overload_time"] / sums["engaged_time"],
        edges=1.0 + sums["edges_broken"],
        safe=0.0,
        delay=delayed.machine.command_delay,
    )


def table(runs: Mapping[str, tuple[Figures, Figures]]) -> str:
    """Return figures through LinuxCNC and in the simulation as a Markdown table."""
    heads = (
        "Policy, shielded",
        "Where",
        "Cycle time [s/bar]",
        "Mean power [kW]",
        "Over 5 % [% of cutting time]",
        "Edges",
    )
    rows = [
        (name, where, f"{each.time:.2f}", f"{each.mean_power:.2f}", f"{100 * each.severe:.1f}", f"{each.edges:.0f}",
         f"{100 * each.safe:.1f}", f"{1000 * each.delay:.1f}")
        for name, both in runs.items()
        for where, each in zip(("LinuxCNC", "simulation"), both, strict=True)
    ]  # fmt: skip
    return markdown((*heads, "Late [%]", "Delay [ms]"), rows)
