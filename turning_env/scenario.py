"""What can be configured: one frozen, validated value, nested by subject.

Defaults are those of ``RoughTurning-v0``: 709M40 (En 19) steel cut by a GC435 insert on a Colchester Mascot lathe
(Alaskari and Oraby 2018). Where the papers are silent, the description says "assumption".
"""

import hashlib
import json
import os
import re
import tomllib
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Literal, Self

import tomli_w
from pydantic import ValidationError, field_validator, model_validator

from turning_env.files import replace_file
from turning_env.power_law import PowerLaw
from turning_env.quantity import Section, quantity


class Material(Section):
    """Machinability of the work material with the tool material (709M40 with GC435)."""

    wear: PowerLaw = PowerLaw(
        coefficient=0.00956410, cutting_speed=0.577, feed=0.168, depth_of_cut=0.15, time=0.245, hardness=0.5
    )
    """Fresh-edge flank wear [mm]. Exponents of depth of cut and hardness: assumptions."""
    thrust_force: PowerLaw = PowerLaw(
        coefficient=106580.08, cutting_speed=-0.484, feed=0.236, depth_of_cut=0.75, wear=1.1, hardness=0.75
    )
    """Thrust force [N]. Exponents of depth of cut and hardness: assumptions."""
    power: PowerLaw = PowerLaw(
        coefficient=0.30338170, cutting_speed=0.820, feed=0.627, depth_of_cut=0.95, wear=0.342, hardness=0.75
    )
    """Spindle power [kW]. Exponents of depth of cut and hardness: assumptions."""

    @model_validator(mode="after")
    def _factors_known(self) -> Self:
        if self.wear.time <= 0:
            raise ValueError(f"wear.time is {self.wear.time}, but wear must grow with time: above 0, to 10")
        if self.wear.wear != 0:
            raise ValueError(f"wear.wear is {self.wear.wear}, but the fresh-edge wear law cannot depend on wear: only 0")
        for name, law in (("thrust_force", self.thrust_force), ("power", self.power)):
            if law.time != 0:
                raise ValueError(f"{name}.time is {law.time}, but {name} depends on time through wear alone: only 0")
        return self


class Tool(Section):
    """The cutting edge."""

    wear_criterion: float = quantity(0.3, 0.01, 5, "mm", "flank wear at which the edge is finished")
    wear_rule: Literal["equivalent_time", "clock_time"] = "equivalent_time"
    """How wear accumulates under changing parameters; "clock_time" is the grid-search paper's rule."""
    wear_factor_spread: float = quantity(
        0.10, 0, 1, "-", "insert to insert spread of wear (log standard deviation; from the paper's tests T1-T9)"
    )
    edge_strength: float = quantity(2690, 1, 1e6, "N", "median thrust force that breaks the edge (paper's test T9)")
    edge_strength_spread: float = quantity(0.12, 0, 1, "-", "its log standard deviation (assumption)")


class Machine(Section):
    """The lathe's ranges and drives."""

    cutting_speed_min: float = quantity(50, 0.1, 5000, "m/min", "lowest cutting speed")
    cutting_speed_max: float = quantity(200, 0.1, 5000, "m/min", "highest cutting speed")
    feed_min: float = quantity(0.06, 0.001, 10, "mm/rev", "lowest feed")
    feed_max: float = quantity(0.60, 0.001, 10, "mm/rev", "highest feed")
    feed_time_constant: float = quantity(0.13, 0, 60, "s", "lag of the feed servo (measured, roughness control paper)")
    spindle_time_constant: float = quantity(0.4, 0, 60, "s", "lag of the spindle (assumption)")

    @model_validator(mode="after")
    def _ranges_open(self) -> Self:
        for name in ("cutting_speed", "feed"):
            low, high = getattr(self, f"{name}_min"), getattr(self, f"{name}_max")
            if not low < high:
                raise ValueError(f"{name}_min is {low}, but must be below {name}_max, which is {high}")
        return self


class Workpiece(Section):
    """The row of bars and how they differ from the drawing."""

    bar_length: float = quantity(300, 1, 1e5, "mm", "length of cut of one bar (assumption)")
    diameter: float = quantity(100, 1, 5000, "mm", "diameter at which the bar is turned (assumption)")
    approach: float = quantity(3, 0, 1e4, "mm", "air before each bar (assumption)")
    depth_of_cut: float = quantity(2.5, 0.01, 50, "mm", "nominal depth of cut")
    depth_bar_spread: float = quantity(0.25, 0, 20, "mm", "standard deviation of depth of cut from bar to bar")
    depth_along_spread: float = quantity(0.30, 0, 20, "mm", "standard deviation of depth of cut along a bar")
    depth_correlation_length: float = quantity(25, 0.1, 1e5, "mm", "distance over which depth varies (assumption)")
    hardness_bar_spread: float = quantity(0.08, 0, 1, "-", "log standard deviation of hardness from bar to bar")
    hardness_along_spread: float = quantity(0.05, 0, 1, "-", "log standard deviation of hardness along a bar")
    hardness_correlation_length: float = quantity(40, 0.1, 1e5, "mm", "distance over which hardness varies (assumption)")


class Control(Section):
    """How the controller acts, and for how long."""

    interval: float = quantity(1.0, 0.001, 3600, "s", "control interval")
    sub_steps: int = quantity(10, 1, 10000, "sub-steps", "integration steps of one interval")
    action: Literal["incremental", "set_point"] = "incremental"
    """"incremental": steps of the logarithms of speed and feed; "set_point": -1..1 maps linearly onto the ranges."""
    cutting_speed_step: float = quantity(0.15, 1e-4, 10, "-", "largest change of log cutting speed in an interval")
    feed_step: float = quantity(0.40, 1e-4, 10, "-", "largest change of log feed in an interval")
    initial_cutting_speed: float = quantity(125, 0.1, 5000, "m/min", "cutting speed at the start (assumption)")
    initial_feed: float = quantity(0.25, 0.001, 10, "mm/rev", "feed at the start (assumption)")
    time_limit: float = quantity(60, 0.001, 1e5, "min", "machine time after which an episode is truncated (assumption)")

    @model_validator(mode="after")
    def _interval_within_time_limit(self) -> Self:
        if self.time_limit * 60 < self.interval:
            raise ValueError(f"time_limit is {self.time_limit} min, but must hold one interval of {self.interval} s")
        return self


class Sensors(Section):
    """What lies between the process and the controller."""

    power_noise: float = quantity(0.02, 0, 1, "-", "relative standard deviation of measured power (assumption)")
    force_noise: float = quantity(0.05, 0, 1, "-", "relative standard deviation of measured thrust force (assumption)")
    power_time_constant: float = quantity(0.1, 0, 60, "s", "lag of measured power (assumption)")
    force_time_constant: float = quantity(0.05, 0, 60, "s", "lag of measured thrust force (assumption)")


class Economics(Section):
    """What things are worth, in machine time. Money divided by the machine's rate gives these numbers."""

    reference_productivity: float = quantity(115, 0.001, 1e5, "cm3/min", "removal rate that just pays (assumption)")
    edge_cost: float = quantity(3, 0, 1e4, "min", "price of one edge in machine time (assumption)")
    edge_change_time: float = quantity(2, 0, 1e4, "min", "time to change an edge (adaptive part programming paper, tau_I)")
    breakage_downtime: float = quantity(10, 0, 1e5, "min", "further time lost when an edge breaks (assumption)")
    overload_price: float = quantity(10, 0, 1e4, "-", "price of a relative excess of 1 held for 1 s, in s (assumption)")


class Limits(Section):
    """What the process must not exceed."""

    thrust_force: float = quantity(1500, 0.001, 1e6, "N", "highest allowed thrust force")
    power: float = quantity(7, 0.001, 1e4, "kW", "highest allowed spindle power")
    overload_tolerance: float = quantity(0.05, 0, 1, "-", "relative excess beyond which a policy counts as overloading")
    overload_allowance: float = quantity(0.05, 0, 1, "-", "share of cutting time for which it may do so")


class Scenario(Section):
    """Everything that defines an episode but its seed and the actions."""

    name: str = "rough_turning"
    """Names the folders in which trainings and results are kept, so only characters that are safe there."""
    material: Material = Material()
    tool: Tool = Tool()
    machine: Machine = Machine()
    workpiece: Workpiece = Workpiece()
    control: Control = Control()
    sensors: Sensors = Sensors()
    economics: Economics = Economics()
    limits: Limits = Limits()

    @field_validator("name")
    @classmethod
    def _names_a_folder(cls, name: str) -> str:
        if not re.fullmatch(r"(?!\.)[A-Za-z0-9_.-]{1,64}", name):
            allowed = '1 to 64 of the characters A-Z, a-z, 0-9, "_", "-" and ".", the first of them not "."'
            raise ValueError(f"{name!r} is not allowed: a scenario's name also names a folder, so only {allowed}")
        return name

    @model_validator(mode="after")
    def _starts_within_range(self) -> Self:
        for name in ("cutting_speed", "feed"):
            start = getattr(self.control, f"initial_{name}")
            low, high = getattr(self.machine, f"{name}_min"), getattr(self.machine, f"{name}_max")
            if not low <= start <= high:
                raise ValueError(f"control.initial_{name} is {start}, but must lie in the machine's {low} to {high}")
        return self

    @classmethod
    def load(cls, source: "str | os.PathLike[str] | Scenario") -> "Scenario":
        """The scenario of a preset's name, a TOML file's path, or the scenario itself.

        A TOML file states only what differs from the defaults; without a name, it is called as the file is.

        Raises:
            ScenarioError: no such preset or file, not TOML, an unknown key, or a value out of range; names the field,
                the value and what is allowed.
            TypeError: ``source`` is none of the three.
        """
        if isinstance(source, Scenario):
            return source
        if not isinstance(source, str | os.PathLike):
            raise TypeError(f"a scenario is a preset's name, a path or a Scenario, not {type(source).__name__}")
        if isinstance(source, str) and source in presets():
            text = (resources.files("turning_env") / "presets" / f"{source}.toml").read_bytes()
            return cls._parse(text, f"preset {source}", source)
        path = Path(source)
        if not path.is_file():
            raise ScenarioError(f"no preset and no file is called {str(source)!r}; presets: {', '.join(presets())}")
        return cls._parse(path.read_bytes(), str(path), path.stem)

    @classmethod
    def _parse(cls, text: bytes, source: str, name: str) -> "Scenario":
        try:
            return cls.model_validate({"name": name} | tomllib.loads(text.decode()))
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise ScenarioError(f"{source} is not TOML: {error}") from error
        except ValidationError as error:
            raise ScenarioError(f"{source}: " + "; ".join(_complaints(error))) from error

    def to_toml(self) -> str:
        """The whole scenario as TOML; ``Scenario.load`` reads it back equal."""
        return tomli_w.dumps(self.model_dump())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the whole scenario as a TOML file: all of it or nothing; its folder is made."""
        replace_file(Path(path), lambda partial: partial.write_text(self.to_toml(), "utf-8"))

    def digest(self) -> str:
        """SHA-256 of all values but the name: equal digests mean equal physics."""
        values = json.dumps(self.model_dump(exclude={"name"}), sort_keys=True)
        return hashlib.sha256(values.encode()).hexdigest()


class ScenarioError(ValueError):
    """A scenario that cannot be used. The message names the field, the value and what is allowed."""


def presets() -> tuple[str, ...]:
    """Names of the scenarios that come with the package."""
    folder = resources.files("turning_env") / "presets"
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def _complaints(error: ValidationError) -> Iterator[str]:
    for detail in error.errors():
        field = ".".join(str(part) for part in detail["loc"]) or "scenario"
        message = detail["msg"].removeprefix("Value error, ")
        if detail["type"] not in ("value_error", "missing"):
            message = f"{detail['input']!r} is not allowed: {message}"
        yield f"{field}: {message}"
