"""The scenario: one frozen, validated value with a section per subject (``sections.py``), and its TOML files."""

import math
import os
import re
import tomllib
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Mapping
from importlib import resources
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
import tomli_w
from pydantic import (
    BeforeValidator,
    Field,
    PlainSerializer,
    ValidationError,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from turning_env.console import printable
from turning_env.files import digest_of, replace_file
from turning_env.scenario import sections
from turning_env.scenario.section import Section, names_instead
from turning_env.scenario.validation import complaints

_SOURCE, _CALIBRATION = (
    "_source",
    "_calibration",
)  # beside the fields, as Pydantic would compare a private attribute
_STATED_START = "_stated_start"  # likewise: which fields of the start the files or the dict state
START = ("initial_cutting_speed", "initial_feed")
"""Fields of ``control`` that move into the machine's range if no file states them."""
_ALL_PRESETS = "python -m turning_env presets"

SPLITS = ("harder_lot", "forging_skin", "worn_lot", "sensor_bias", "small_diameter", "ck45")
"""Presets that test generalisation, with other bars, tools, sensors and steels; no policy was tuned or trained on them.

The first four have its nominal model and a model mismatch. The nominal models of the last two have another diameter and another
steel. Build policies for them with ``Scenario.nominal()``. Reasons: ``docs/choices.md``.
"""


ALWAYS_TOLD = (
    *("name", "mismatch", "nominal_model", "control", "surface", "economics", "limits"),
    *("sensors.force", "sensors.probe", "sensors.inspects_edges"),
    *(
        "tool.wear_criterion",
        "tool.wear_rule",
        "machine.cutting_speed_min",
        "machine.cutting_speed_max",
        "machine.feed_min",
    ),
    *(
        "machine.feed_max",
        "machine.rated_power",
        "spindle",
        "workpiece.bars",
        "workpiece.diameter",
        "workpiece.depth_of_cut",
    ),
    *("workpiece.depth_profile", "workpiece.bar_length", "workpiece.approach", "workpiece.support"),
)
"""Sections and values that the control knows, so the nominal model has no others: observations and actions are scaled by them."""


def shipped(folder: str) -> dict[str, Any]:
    """Return the TOML files that ship in a folder of this package, by name."""
    files = {
        each.name: each for each in (resources.files("turning_env.scenario") / folder).iterdir()
    }
    return {
        name.removesuffix(".toml"): files[name] for name in sorted(files) if name.endswith(".toml")
    }


_PRESETS = shipped("presets")


def always_told(name: str) -> bool:
    """Return whether the control knows the value of a dotted name."""
    return any(name == each or name.startswith(each + ".") for each in ALWAYS_TOLD)


def flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return the values of a nested table by their dotted names."""
    values: dict[str, Any] = {}
    for key, value in table.items():
        values |= (
            flat(value, f"{before}{key}.") if isinstance(value, dict) else {f"{before}{key}": value}
        )
    return values


def nested(values: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Return values by dotted names as a nested table."""
    table: dict[str, Any] = {}
    for name, value in values:
        *above, key = name.split(".")
        inner = table
        for section in above:
            inner = inner.setdefault(section, {})
        inner[key] = value
    return table


def merged(base: Any, values: Any) -> Any:
    """Return the base's values, overwritten entry by entry, also in nested tables."""
    if not (isinstance(base, dict) and isinstance(values, dict)):
        return values
    return base | {key: merged(base.get(key), value) for key, value in values.items()}


NominalModel = Annotated[
    tuple[tuple[str, Any], ...],
    BeforeValidator(
        lambda values: tuple(sorted(flat(values).items())) if isinstance(values, dict) else values
    ),
    PlainSerializer(nested),
    WithJsonSchema({"type": "object"}),
]


class Scenario(Section):
    """Everything that defines an episode, except its seed and the actions. Properties also work on arrays (``plan.py``)."""

    name: str = "rough_turning"
    """Also the name of folders of trainings and results, so only characters that are safe in paths are allowed."""
    material: sections.Material = sections.Material()
    tool: sections.Tool = sections.Tool()
    edge_failure: sections.EdgeFailure = sections.EdgeFailure()
    swarf: sections.Swarf = sections.Swarf()
    machine: sections.Machine = sections.Machine()
    spindle: sections.Spindle = sections.Spindle()
    feed_drive: sections.FeedDrive = sections.FeedDrive()
    workpiece: sections.Workpiece = sections.Workpiece()
    control: sections.Control = sections.Control()
    surface: sections.Surface = sections.Surface()
    sensors: sections.Sensors = sections.Sensors()
    mismatch: sections.Mismatch = sections.Mismatch()
    economics: sections.Economics = sections.Economics()
    limits: sections.Limits = sections.Limits()
    nominal_model: NominalModel = Field(
        (), description="values of the nominal model that differ from the true ones, by section"
    )

    @field_validator("name")
    @classmethod
    def _names_a_folder(cls, name: str) -> str:
        if not re.fullmatch(r"(?!\.)[A-Za-z0-9_.-]{1,64}", name):
            allowed = '1 to 64 of the characters A-Z, a-z, 0-9, "_", "-" and ".", the first of them not "."'
            raise ValueError(
                f"{name!r} is not allowed: a scenario's name also names a folder, so only {allowed}"
            )
        return name

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        told = (name for name, _ in self.nominal_model if always_told(name))
        wrong = [*complaints(self)]
        wrong += [
            f"nominal_model.{name} is set, but the control always knows {name}: leave it out"
            for name in told
        ]
        try:
            if not wrong:
                self.nominal()
        except ValidationError as error:
            wrong = [f"nominal_model.{each}" for each in complaints_of(error)]
        if wrong:
            raise ValueError("; ".join(wrong))
        return self

    @property
    def file(self) -> Path | None:
        """Return the TOML file from which the scenario was loaded, or None. Copies keep it; it is not part of the identity."""
        file: Path | None = vars(self).get(_SOURCE)
        return file

    @property
    def calibration(self) -> Any:
        """Return the table ``calibration`` of the file or its base: how the laws were measured (``workshop``). Not identity."""
        return vars(self).get(_CALIBRATION)

    @classmethod
    def load(cls, source: "Source") -> "Scenario":
        """Return the scenario of a preset's name, a TOML file's path or a dict; return a ``Scenario`` unchanged.

        A TOML file or a dict states only the values that differ from the defaults or, with ``base``, from that preset or TOML
        file. The path of a base is relative to the file's folder. Without a ``name``, a file's scenario gets the file's name,
        with "_" for characters that are not allowed; a dict's scenario is called "custom". A start speed or feed that only a
        preset states moves to the nearest value in the machine's range. TypeError if ``source`` is none of the four;
        ScenarioError names file, field, value and what is allowed.

            Scenario.load({"base": "forging", "tool": {"wear_criterion": 0.2}})
        """
        if isinstance(source, Scenario):
            return source
        if not isinstance(source, str | os.PathLike | Mapping):
            raise TypeError(
                f"a scenario is a preset's name, a path, a dict or a Scenario, not {type(source).__name__}"
            )
        try:
            if isinstance(source, Mapping):
                return cls._from_values("scenario", {"name": "custom"} | dict(source), Path())
            return cls._read(source)
        except RecursionError as error:
            what = "the dict" if isinstance(source, Mapping) else source
            raise ScenarioError(
                f"{what} is based on itself, or nested too deep to be a scenario"
            ) from error

    @classmethod
    def _read(cls, source: str | os.PathLike[str]) -> "Scenario":
        """Return the scenario of a preset or a file."""
        path = None if source in _PRESETS else Path(source)
        shown, values = table_of(source, _PRESETS, "preset", _ALL_PRESETS)
        loaded = cls._from_values(shown, values, path.parent if path else Path())
        vars(loaded)[_SOURCE] = path
        return loaded

    @classmethod
    def _from_values(cls, source: str, values: dict[str, Any], folder: Path) -> "Scenario":
        """Return the scenario of a table. A base's path is relative to ``folder``."""
        base, calibration = values.pop("base", None), values.pop(_CALIBRATION[1:], None)
        control = values.get("control", {})
        stated_start = {name for name in START if not isinstance(control, dict) or name in control}
        if base is not None:
            if not isinstance(base, str) or (base not in _PRESETS and not base.endswith(".toml")):
                instead = names_instead(
                    base if isinstance(base, str) else "", _PRESETS, _ALL_PRESETS
                )
                raise ScenarioError(
                    f"{source}: base: {_shown(base)} is neither a preset nor a TOML file; {instead}"
                )
            try:
                above = cls._read(base if base in _PRESETS else folder / base)
            except ScenarioError as error:
                raise ScenarioError(f"{source}: base: {error}") from error
            values = merged(above.model_dump(exclude={"name"}), values)
            calibration = above.calibration if calibration is None else calibration
            if base not in _PRESETS:
                stated_start |= vars(above)[_STATED_START]
        try:
            loaded = cls.model_validate(start_in_range(values, stated_start))
            vars(loaded)[_CALIBRATION] = calibration
            vars(loaded)[_STATED_START] = stated_start
            return loaded
        except ValidationError as error:
            raise ScenarioError(f"{source}: " + "; ".join(complaints_of(error))) from error

    def to_toml(self) -> str:
        """Return the whole scenario as TOML, with units as comments; ``Scenario.load`` reads back an equal scenario."""
        section: Any = self
        lines = []
        for line in tomli_w.dumps(self.model_dump()).splitlines():
            if line.startswith("["):  # nominal values have the units of the true ones
                name = line[1:-1].removeprefix("nominal_model").removeprefix(".")
                section = attrgetter(name)(self) if name else self
            field = type(section).model_fields.get(line.partition(" = ")[0])
            unit = field.json_schema_extra["unit"] if field and field.json_schema_extra else "-"
            noted = unit not in ("-", "response") and line[-1] not in "[{"
            lines.append(
                f"{line} # {unit.replace('money', self.economics.currency)}" if noted else line
            )
        return "\n".join(lines) + "\n"

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the whole scenario as a TOML file, whole or not at all; make its folder if it is missing."""
        replace_file(Path(path), lambda partial: partial.write_text(self.to_toml(), "utf-8"))

    def differences(self) -> dict[str, Any]:
        """Return the values that differ from the defaults, nested by section, without the name. They identify a scenario."""
        values, defaults = flat(self.model_dump(exclude={"name"})), flat(_DEFAULTS.model_dump())
        return nested(
            (name, value) for name, value in values.items() if value != defaults.get(name)
        )

    def digest(self) -> str:
        """Return the SHA-256 of ``differences()``. Equal digests mean equal physics, even under different names."""
        return digest_of(self.differences())

    def portable(self) -> str | dict[str, Any]:
        """Return a source for ``load`` that JSON can hold and that works anywhere: a preset's name, or a dict of differences."""
        if self.name in _PRESETS and self == self._read(self.name):
            return self.name
        return {"base": _DEFAULTS.name, "name": self.name} | self.differences()

    @property
    def cutting_speed_max(self) -> Any:
        """The highest cutting speed that the machine's range and the spindle's highest speed allow at the diameter [m/min]."""
        reached = self._circumference * self.spindle.max_speed
        return np.minimum(
            self.machine.cutting_speed_max, np.where(np.equal(reached, 0.0), np.inf, reached)
        )

    @property
    def feed_range(self) -> tuple[Any, Any]:
        """Lowest and highest feed of the machine at which chips break, if they can tangle [mm/rev]."""
        machine, swarf = self.machine, self.swarf
        tangle = np.greater(swarf.tangle_rate, 0.0)
        low = np.maximum(machine.feed_min, np.where(tangle, swarf.chip_feed_min, 0.0))
        return low, np.minimum(machine.feed_max, np.where(tangle, swarf.chip_feed_max, np.inf))

    @property
    def base_cutting_speed(self) -> Any:
        """The cutting speed at the spindle's base speed [m/min]."""
        return self._circumference * self.spindle.base_speed

    @property
    def _circumference(self) -> Any:
        return math.pi * self.workpiece.diameter / 1000.0  # [m]

    @property
    def max_episode_steps(self) -> int | None:
        """The largest number of steps of an episode; None if edge changes can add steps."""
        control = self.control
        if control.action == "part":
            return self.workpiece.bars
        steps = control.time_limit * 60.0 / control.interval
        if control.edge_changes == "end":
            return round(steps)
        if self.economics.edge_change_time * 60.0 < control.interval:
            return None
        return math.ceil(
            steps - 0.5 / control.sub_steps
        )  # half a sub-step, as the clock is a sum and rounded

    def nominal(self) -> "Scenario":
        """Return the nominal model, with which controllers are built: the values of ``nominal_model``, and no model mismatch."""
        update: dict[str, Any] = {"mismatch": sections.Mismatch(), "nominal_model": ()}
        if self.nominal_model:
            update |= Scenario.model_validate(
                merged(self.model_dump(exclude=set(update)), nested(self.nominal_model))
            )
        return self.model_copy(update=update)


Source = str | os.PathLike[str] | Mapping[str, Any] | Scenario  # types that ``Scenario.load`` takes

_DEFAULTS = Scenario()


PortableScenario = Annotated[
    Scenario,
    BeforeValidator(
        lambda values: (
            merged(_DEFAULTS.model_dump(), values) if isinstance(values, dict) else values
        )
    ),
    PlainSerializer(lambda scenario: {"name": scenario.name} | scenario.differences()),
]
"""A field of a file's model that keeps a scenario's name and its differences from the defaults."""


class ScenarioError(ValueError):
    """A scenario that cannot be used. The message names the field, its value and the allowed values.

    It is one line that a terminal can show: it may quote keys and values of a stranger's file.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


def presets() -> tuple[str, ...]:
    """Return the names of the scenarios that come with the package."""
    return tuple(_PRESETS)


def name_of_file(path: Path) -> str:
    """Return the name for a file that states none: the file's, without accents, "_" for characters that are not allowed."""
    letters = [
        letter
        for letter in unicodedata.normalize("NFKD", path.stem)
        if not unicodedata.combining(letter)
    ]
    return re.sub(r"^\.|[^A-Za-z0-9_.-]", "_", "".join(letters))[:64]


def start_in_range(values: dict[str, Any], stated: Collection[str]) -> dict[str, Any]:
    """Return a scenario's values with a start that is not stated moved to the nearest value in the machine's range.

    Values that are not valid come back as they are: the scenario's own validation names the fault.
    """
    try:
        machine = sections.Machine.model_validate(values.get("machine", {}))
        spindle = sections.Spindle.model_validate(values.get("spindle", {}))
        work = sections.Workpiece.model_validate(values.get("workpiece", {}))
        control = sections.Control.model_validate(values.get("control", {}))
    except ValidationError:
        return values
    fastest = machine.cutting_speed_max
    if spindle.max_speed > 0.0:
        fastest = min(fastest, math.pi * work.diameter / 1000.0 * spindle.max_speed)
    highest_feed = machine.feed_max
    if control.action == "override":
        highest_feed /= control.override_max  # an override of 100 % is the start
    ranges = {
        "initial_cutting_speed": (machine.cutting_speed_min, fastest),
        "initial_feed": (machine.feed_min, highest_feed),
    }
    moved = {}
    for name, (low, high) in ranges.items():
        start = getattr(control, name)
        if name not in stated and low <= high and not low <= start <= high:
            moved[name] = min(max(start, low), high)
    return merged(values, {"control": moved}) if moved else values


def table_of(
    source: Any, shipped: Mapping[str, Any], kind: str, lists_all: str
) -> tuple[str, dict[str, Any]]:
    """Return what errors call a TOML file that ships or of a path, and its table with a name; ScenarioError if there is none."""
    path = shipped[source] if source in shipped else Path(source)
    shown = f"{kind} {source}" if source in shipped else str(path)
    try:
        if not path.is_file():
            raise ScenarioError(
                f"no {kind} and no file is called {shown!r}; {names_instead(shown, shipped, lists_all)}"
            )
        text: bytes = path.read_bytes()
    except OSError as error:
        raise ScenarioError(f"{shown[:200]!r} cannot be read: {error.strerror}") from error
    try:
        name = source if source in shipped else name_of_file(path)
        return shown, {"name": name} | tomllib.loads(
            text.decode("utf-8-sig")
        )  # with or without a byte-order mark
    except (
        ValueError
    ) as error:  # also of bytes that are no text, and of whole numbers of thousands of digits
        comma = re.search(rb"(?m)^[^\n=#]*=\s*([+-]?\d+),(\d+)\s*(?:#.*)?$", text)
        advice = (
            f'; numbers have a decimal point: "{comma[1].decode()}.{comma[2].decode()}"'
            if comma
            else ""
        )
        raise ScenarioError(f"{shown} is not TOML: {error}{advice}") from error


def complaints_of(error: ValidationError) -> Iterator[str]:
    """Yield the fault of each field."""
    for detail in error.errors():
        field = ".".join(str(part) for part in detail["loc"]) or "scenario"
        message = detail["msg"].removeprefix("Value error, ")
        if detail["type"] not in ("value_error", "missing"):
            message = f"{_shown(detail['input'])} is not allowed: {message}"
        yield f"{field}: {message}"


def _shown(value: Any) -> str:
    try:
        text = repr(value)
    except ValueError:  # Python writes no whole number of thousands of digits, though it reads some
        return "a whole number of thousands of digits"
    return text if len(text) <= 200 else f"{text[:200]}..."
