"""The scenario: one frozen, validated value with a section per subject, and its TOML files.

The sections are in ``sections.py``, the checks that they agree in ``validation.py``.
"""

import os
import re
import tomllib
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import cache
from importlib import resources
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, NamedTuple, Self

import tomli_w
from pydantic import (
    BeforeValidator,
    Field,
    PlainSerializer,
    PrivateAttr,
    ValidationError,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from turning_env.console import printable
from turning_env.files import digest_of, read_regular, write_file
from turning_env.numerics.conversions import cutting_speed_at
from turning_env.scenario import sections
from turning_env.scenario.derived import DerivedQuantities
from turning_env.scenario.section import Section, few, names_instead
from turning_env.scenario.validation import complaints

START = ("initial_cutting_speed", "initial_feed")
"""Fields of ``control`` that move into the machine's range if no file states them."""

SPLITS = (
    "harder_lot",
    "forging_skin",
    "worn_lot",
    "sensor_bias",
    "small_diameter",
    "ck45",
    "h13_romi",
    "vicomtech",
)
"""Presets that test generalisation, with other bars, tools, sensors and steels.

No policy was tuned or trained on them. The first four have the nominal model of ``rough_turning``
and a model mismatch. The nominal models of the others have another diameter, another steel, and
the laws of two measured sets.
Build policies for them with ``Scenario.nominal()``. Reasons: ``docs/models.md``.
"""

# Which sensors there are decides the entries of observations; only their numbers may be mistaken.
_SENSORS = tuple(
    f"sensors.{name}"
    for name, field in sections.Sensors.model_fields.items()
    if field.annotation is not float
)
ALWAYS_KNOWN = (
    "name",
    "mismatch",
    "nominal_model",
    "control",
    "surface",
    "economics",
    "limits",
    *_SENSORS,
    "tool.wear_criterion",
    "tool.wear_rule",
    "machine.cutting_speed_min",
    "machine.cutting_speed_max",
    "machine.feed_min",
    "machine.feed_max",
    "machine.rated_power",
    "spindle",
    "workpiece.bars",
    "workpiece.diameter",
    "workpiece.depth_of_cut",
    "workpiece.depth_profile",
    "workpiece.bar_length",
    "workpiece.approach",
    "workpiece.support",
)
"""Sections and values that the control knows, so that the nominal model has no others.

Observations and actions are scaled by them.
"""

_ALL_PRESETS = "python -m turning_env show"
MAX_NAME = 64  # characters of a scenario's name
MAX_TOML = 1_000_000  # bytes of a TOML file; those that ship have less than a tenth
_MAX_SHOWN = 200  # characters of a value that an error quotes


def shipped(folder: str) -> dict[str, Any]:
    """Return the TOML files that ship in a folder of this package, by name."""
    files = sorted(
        (resources.files("turning_env.scenario") / folder).iterdir(), key=lambda file: file.name
    )
    return {file.name.removesuffix(".toml"): file for file in files if file.name.endswith(".toml")}


_PRESETS = shipped("presets")
_FAMILIES = shipped("families")


def always_known(name: str) -> bool:
    """Return whether the control knows the value of a dotted name."""
    return any(name == known or name.startswith(f"{known}.") for known in ALWAYS_KNOWN)


def flat(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return the values of a nested table by their dotted names."""
    values: dict[str, Any] = {}
    for key, value in table.items():
        name = f"{before}{key}"
        if isinstance(value, dict):
            values |= flat(value, f"{name}.")
        else:
            values[name] = value
    return values


def nested(values: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Return values by dotted names as a nested table."""
    table: dict[str, Any] = {}
    for name, value in values:
        *sections_above, key = name.split(".")
        inner = table
        for section in sections_above:
            inner = inner.setdefault(section, {})
        inner[key] = value
    return table


def merged(base: Any, values: Any) -> Any:
    """Return the base's values, overwritten entry by entry, also in nested tables."""
    if not (isinstance(base, dict) and isinstance(values, dict)):
        return values
    return base | {key: merged(base.get(key), value) for key, value in values.items()}


def _sorted_pairs(values: Any) -> Any:
    """Return a nested table as pairs of dotted name and value, which can be hashed."""
    return tuple(sorted(flat(values).items())) if isinstance(values, dict) else values


NominalModel = Annotated[
    tuple[tuple[str, Any], ...],
    BeforeValidator(_sorted_pairs),
    PlainSerializer(nested),
    WithJsonSchema({"type": "object"}),
]


class _Origin(NamedTuple):
    """The origin of a scenario. It is no part of its identity."""

    file: Path | None = None
    calibration: Any = None
    stated_start: frozenset[str] = frozenset()  # fields of ``START`` that the file or dict states


class Scenario(sections.Sections, DerivedQuantities):
    """Everything that defines an episode, except its seed and the actions."""

    nominal_model: NominalModel = Field(
        (), description="values of the nominal model that differ from the true ones, by section"
    )

    _origin: _Origin = PrivateAttr(default=_Origin())

    def __eq__(self, other: object) -> bool:
        """Return whether all values are equal, whatever file they come from."""
        if not isinstance(other, Scenario):
            return NotImplemented
        return dict(self) == dict(other)

    @field_validator("name")
    @classmethod
    def _names_a_folder(cls, name: str) -> str:
        if not re.fullmatch(rf"(?!\.)[A-Za-z0-9_.-]{{1,{MAX_NAME}}}", name):
            raise ValueError(
                f"{name!r} is not allowed: a scenario's name also names a folder, so only "
                f'1 to {MAX_NAME} of the characters A-Z, a-z, 0-9, "_", "-" and ".", '
                'the first of them not "."'
            )
        return name

    @model_validator(mode="after")
    def _makes_sense(self) -> Self:
        """Refuse values that contradict one another, in the scenario or in its nominal model."""
        faults = [*complaints(self)]
        for name, _ in self.nominal_model:
            if always_known(name):
                reason = f"the control always knows {name}"
                faults.append(f"nominal_model.{name} is set, but {reason}: leave it out")
        if not faults:
            try:
                self.nominal()
            except ValidationError as error:
                faults = [f"nominal_model: {fault}" for fault in complaints_of(error)]
        if faults:
            raise ValueError(few(faults))
        return self

    @property
    def file(self) -> Path | None:
        """TOML file from which the scenario was loaded, or None. Copies keep it."""
        return self._origin.file

    @property
    def calibration(self) -> Any:
        """Table ``calibration`` of the file or its base: how the laws were measured."""
        return self._origin.calibration

    @classmethod
    def load(cls, source: "Source") -> "Scenario":
        """Return the scenario of a preset's name, a TOML file's path or a dict.

        A ``Scenario`` is returned unchanged. A TOML file or a dict states only the values that
        differ from the defaults or, with ``base``, from that preset or TOML file. The path of a
        base is relative to the file's folder. Without a ``name``, a file's scenario gets the
        file's name, with "_" for characters that are not allowed; a dict's scenario is called
        "custom". A start speed or feed that only a preset states moves to the nearest value in
        the machine's range.

            Scenario.load({"base": "forging", "tool": {"wear_criterion": 0.2}})

        Raises:
            TypeError: if ``source`` is none of the four.
            ScenarioError: names file, field, value and what is allowed.
        """
        if isinstance(source, Scenario):
            return source
        if not isinstance(source, str | os.PathLike | Mapping):
            kind = type(source).__name__
            raise TypeError(
                f"a scenario is a preset's name, a path, a dict or a Scenario, not {kind}"
            )
        try:
            if isinstance(source, Mapping):
                return cls._from_values(
                    "scenario", {"name": "custom"} | dict(source), folder=Path()
                )
            return cls._read(source)
        # Files that are based on each other would be read without end.
        except RecursionError as error:
            title = "the dict" if isinstance(source, Mapping) else source
            raise ScenarioError(
                f"{title} is based on itself, or nested too deep to be a scenario"
            ) from error

    @classmethod
    def _read(cls, source: str | os.PathLike[str]) -> "Scenario":
        """Return the scenario of a preset or a file."""
        if source in _PRESETS:
            return _preset(str(source))
        if source in _FAMILIES:
            raise ScenarioError(
                f"{source} is a family of lathes, not a scenario: "
                f'gymnasium.make("RoughTurning-Family-v1", family="{source}")'
            )
        file = Path(source)
        table = table_of(source, _PRESETS, kind="preset", lists_all=_ALL_PRESETS)
        scenario = cls._from_values(table.title, table.values, folder=file.parent)
        scenario._origin = scenario._origin._replace(file=file)
        return scenario

    @classmethod
    def _from_values(cls, title: str, values: dict[str, Any], folder: Path) -> "Scenario":
        """Return the scenario of a table, which errors call by its title.

        The path of a base is relative to ``folder``.
        """
        base = values.pop("base", None)
        calibration = values.pop("calibration", None)
        control = values.get("control", {})
        if isinstance(control, dict):
            stated_start = frozenset(name for name in START if name in control)
        else:
            stated_start = frozenset(START)  # validation refuses such a section
        if base is not None:
            above = cls._base_of(title, base, folder=folder)
            values = merged(above.model_dump(exclude={"name"}), values)
            if calibration is None:
                calibration = above.calibration
            # A preset's start is for its own machine, so the start of a file based on it may move.
            if base not in _PRESETS:
                stated_start |= above._origin.stated_start
        try:
            scenario = cls.model_validate(start_in_range(values, stated_start))
        except ValidationError as error:
            raise ScenarioError(f"{title}: {few(complaints_of(error))}") from error
        scenario._origin = _Origin(calibration=calibration, stated_start=stated_start)
        return scenario

    @classmethod
    def _base_of(cls, title: str, base: Any, folder: Path) -> "Scenario":
        """Return the scenario on which a table is based."""
        is_text = isinstance(base, str)
        if not is_text or (base not in _PRESETS and not base.endswith(".toml")):
            advice = names_instead(base if is_text else "", _PRESETS, lists_all=_ALL_PRESETS)
            raise ScenarioError(
                f"{title}: base: {_shown(base)} is neither a preset nor a TOML file; {advice}"
            )
        try:
            return cls._read(base if base in _PRESETS else folder / base)
        except ScenarioError as error:
            raise ScenarioError(f"{title}: base: {error}") from error

    def to_toml(self) -> str:
        """Return the whole scenario as TOML, with units as comments.

        ``Scenario.load`` reads back an equal scenario.
        """
        section: Any = self
        lines = []
        for line in tomli_w.dumps(self.model_dump()).splitlines():
            if line.startswith("["):
                # Nominal values have the units of the true ones.
                name = line[1:-1].removeprefix("nominal_model").removeprefix(".")
                section = attrgetter(name)(self) if name else self
            unit = self._unit_of_line(line, section)
            lines.append(f"{line} # {unit}" if unit else line)
        return "\n".join(lines) + "\n"

    def _unit_of_line(self, line: str, section: Section) -> str:
        """Return the unit of a line ``name = number`` of a section in TOML; "" if it has none."""
        field = type(section).model_fields.get(line.partition(" = ")[0])
        declared: Any = field.json_schema_extra if field else None
        # A table or an array that goes on in the next lines is no number.
        if not declared or line[-1] in "[{":
            return ""
        unit: str = declared["unit"]
        if unit in ("-", "response"):
            return ""
        return unit.replace("money", self.economics.currency)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the whole scenario as a TOML file, whole or not at all; make a missing folder."""
        write_file(Path(path), self.to_toml())

    def differences(self) -> dict[str, Any]:
        """Return the values that differ from the defaults, nested by section, without the name.

        They identify a scenario.
        """
        values = flat(self.model_dump(exclude={"name"}))
        differing = {}
        for name, value in values.items():
            if value != _DEFAULT_VALUES.get(name):
                differing[name] = value
        return nested(differing.items())

    def digest(self) -> str:
        """Return the SHA-256 of ``differences()``.

        Equal digests mean equal physics, even under different names.
        """
        return digest_of(self.differences())

    def portable(self) -> str | dict[str, Any]:
        """Return a source for ``load`` that JSON can hold and that works anywhere.

        It is a preset's name, or a dict of differences.
        """
        if self.name in _PRESETS and self == self._read(self.name):
            return self.name
        return {"base": _DEFAULTS.name, "name": self.name} | self.differences()

    def nominal(self) -> "Scenario":
        """Return the nominal model, with which controllers are built.

        It has the values of ``nominal_model`` and no model mismatch.
        """
        fields: dict[str, Any] = {"mismatch": sections.Mismatch(), "nominal_model": ()}
        if self.nominal_model:
            values = self.model_dump(exclude=set(fields))
            fields = dict(Scenario.model_validate(merged(values, nested(self.nominal_model))))
        return self.model_copy(update=fields)


Source = str | os.PathLike[str] | Mapping[str, Any] | Scenario
"""Types that ``Scenario.load`` takes."""

_DEFAULTS = Scenario()
_DEFAULT_VALUES = flat(_DEFAULTS.model_dump())


# A scenario is frozen, so all users of a preset can share one.
@cache
def _preset(name: str) -> Scenario:
    """Return the scenario of a preset."""
    table = table_of(name, _PRESETS, kind="preset", lists_all=_ALL_PRESETS)
    return Scenario._from_values(table.title, table.values, folder=Path())


def _with_defaults(values: Any) -> Any:
    return merged(_DEFAULTS.model_dump(), values) if isinstance(values, dict) else values


def _without_defaults(scenario: Scenario) -> dict[str, Any]:
    return {"name": scenario.name} | scenario.differences()


PortableScenario = Annotated[
    Scenario, BeforeValidator(_with_defaults), PlainSerializer(_without_defaults)
]
"""A field of a file's model that keeps a scenario's name and its differences from the defaults."""


class ScenarioError(ValueError):
    """A scenario that cannot be used. The message names the field, its value and what is allowed.

    It is one line that a terminal can show: it may quote keys and values of a stranger's file.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


def presets() -> tuple[str, ...]:
    """Return the names of the scenarios that come with the package."""
    return tuple(_PRESETS)


def name_of_file(path: Path) -> str:
    """Return the name for the scenario of a file that states none.

    It is the file's, without accents, and with "_" for characters that are not allowed.
    """
    decomposed = unicodedata.normalize("NFKD", path.stem)
    letters = [letter for letter in decomposed if not unicodedata.combining(letter)]
    return re.sub(r"^\.|[^A-Za-z0-9_.-]", "_", "".join(letters))[:MAX_NAME]


def start_in_range(values: dict[str, Any], stated: Collection[str]) -> dict[str, Any]:
    """Return a scenario's values with a start that is not stated moved into the machine's range.

    Values that are not valid come back as they are: the scenario's own validation names the fault.
    """
    # Sections are validated one by one, before the scenario compares them with each other.
    try:
        machine = sections.Machine.model_validate(values.get("machine", {}))
        spindle = sections.Spindle.model_validate(values.get("spindle", {}))
        work = sections.Workpiece.model_validate(values.get("workpiece", {}))
        control = sections.Control.model_validate(values.get("control", {}))
    except ValidationError:
        return values
    highest_speed = machine.cutting_speed_max
    if spindle.max_speed > 0.0:
        by_spindle = cutting_speed_at(spindle.max_speed, work.diameter)
        highest_speed = min(highest_speed, by_spindle)
    highest_feed = machine.feed_max
    if control.action == "override":
        highest_feed /= control.override_max  # an override of 100 % is the start
    ranges = {
        "initial_cutting_speed": (machine.cutting_speed_min, highest_speed),
        "initial_feed": (machine.feed_min, highest_feed),
    }
    moved = {}
    for name, (low, high) in ranges.items():
        start = getattr(control, name)
        if name not in stated and low <= high and not low <= start <= high:
            moved[name] = min(max(start, low), high)
    return merged(values, {"control": moved}) if moved else values


class TomlTable(NamedTuple):
    """The values of a TOML file."""

    title: str  # what errors call the file
    values: dict[str, Any]


def table_of(source: Any, shipped: Mapping[str, Any], kind: str, lists_all: str) -> TomlTable:
    """Return the table of a TOML file that ships, by its name, or of a path; add a missing name.

    Args:
        source: a name in ``shipped``, or a path.
        shipped: files that ship, by name.
        kind: what a file is, such as "preset".
        lists_all: command or function that lists the names in ``shipped``.

    Raises:
        ScenarioError: if there is no such file, or it is not TOML.
    """
    ships = source in shipped
    path = shipped[source] if ships else Path(source)
    title = f"{kind} {source}" if ships else str(path)
    try:
        if not path.is_file():
            advice = names_instead(title, shipped, lists_all=lists_all)
            raise ScenarioError(f"no {kind} and no file is called {title[:_MAX_SHOWN]!r}; {advice}")
        # A file that ships may lie in an archive, and has a moderate size.
        content = path.read_bytes() if ships else read_regular(path, MAX_TOML)
    except OSError as error:
        raise ScenarioError(f"{title[:_MAX_SHOWN]!r} cannot be read: {error.strerror}") from error
    try:
        # With or without a byte-order mark. ValueError also if the bytes are no text, or a whole
        # number has thousands of digits.
        values = tomllib.loads(content.decode("utf-8-sig"))
    except ValueError as error:
        advice = _advice_on_comma(content)
        raise ScenarioError(f"{title} is not TOML: {error}{advice}") from error
    name = source if ships else name_of_file(path)
    return TomlTable(title, {"name": name} | values)


def _advice_on_comma(content: bytes) -> str:
    """Return advice if a number in a TOML file has a decimal comma, else ""."""
    number = re.search(rb"(?m)^[^\n=#]*=\s*([+-]?\d+),(\d+)\s*(?:#.*)?$", content)
    if not number:
        return ""
    return f'; numbers have a decimal point: "{number[1].decode()}.{number[2].decode()}"'


def complaints_of(error: ValidationError) -> Iterator[str]:
    """Yield the fault of each field, and those of the whole."""
    for detail in error.errors():
        field = ".".join(str(part) for part in detail["loc"])
        message = detail["msg"].removeprefix("Value error, ")
        if detail["type"] not in ("value_error", "missing"):
            message = f"{_shown(detail['input'])} is not allowed: {message}"
        yield f"{field}: {message}" if field else message


def _shown(value: Any) -> str:
    try:
        text = repr(value)
    except ValueError:  # Python writes no whole number of thousands of digits, though it reads some
        return "a whole number of thousands of digits"
    return text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}..."
