"""The base of a scenario's sections: numbers with a default, a unit and a range that is checked.

Which numbers there are is declared in ``sections.py`` and ``power_law.py``.
"""

from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from functools import cache
from itertools import islice
from typing import Any, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

MAX_LISTED = 8  # names that an error lists; of more, it says where they are listed
MAX_FAULTS = 10  # faults that an error lists
MAX_FAULT = 2_000  # characters of a fault
MAX_KEY = 100  # characters of an unknown key that an error quotes


def quantity(default: Any, low: float, high: float, unit: str, description: str) -> Any:
    """Declare a number: its default, allowed range (ends included), unit and meaning."""
    return Field(
        default,
        description=f"{description} [{unit}]",
        json_schema_extra={"minimum": low, "maximum": high, "unit": unit},
    )


def names_instead(
    name: str, allowed: Iterable[str], lists_all: str = "", *, max_listed: int = MAX_LISTED
) -> str:
    """Return advice on an unknown name: similar names, or all names if they are few.

    Of more than ``max_listed`` names, the advice is ``lists_all``, the command or function that
    lists them; without one, the first few.
    """
    names = list(allowed)
    close = get_close_matches(name[:100], names, n=3, cutoff=0.7)
    if close:
        return f"did you mean {' or '.join(close)}?"
    if len(names) <= max_listed:
        return f"allowed are {', '.join(names)}"
    if lists_all:
        return f"list all with: {lists_all}"
    return f"allowed are {', '.join(names[:max_listed])} and {len(names) - max_listed} others"


def few(faults: Iterable[str]) -> str:
    """Return the first faults as one text of bounded length. Others are not even worked out."""
    faults = iter(faults)
    shown = []
    for fault in islice(faults, MAX_FAULTS):
        shown.append(fault if len(fault) <= MAX_FAULT else f"{fault[:MAX_FAULT]}...")
    if next(faults, None) is not None:
        shown.append("and more")
    return "; ".join(shown)


def _with_tuples(value: Any) -> Any:
    """Return a value with tuples for the lists that TOML and JSON have: fields are frozen."""
    if isinstance(value, dict):
        return {key: _with_tuples(entry) for key, entry in value.items()}
    return tuple(value) if isinstance(value, list) else value


class Section(BaseModel):
    """A frozen group of fields that refuses unknown keys, wrong types, NaN and infinity.

    The docstring of a field is its description in the schema.
    """

    # Defaults are validated so that 3 becomes 3.0, as it would from a file.
    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        strict=True,
        validate_default=True,
        use_attribute_docstrings=True,
    )

    @model_validator(mode="before")
    @classmethod
    def _keys_known(cls, values: Any) -> Any:
        """Refuse unknown keys with advice, which Pydantic's own message lacks."""
        if not isinstance(values, dict):
            return values
        values = _with_tuples(values)
        faults = few(cls._unknown_keys(values))
        if faults:
            raise ValueError(faults)
        return values

    @classmethod
    def _unknown_keys(cls, values: dict[Any, Any]) -> Iterator[str]:
        """Yield a fault for each unknown key."""
        known = cls.model_fields
        for key in map(str, values):
            if key not in known:
                advice = names_instead(key, known, "python -m turning_env show --schema")
                shown = key if len(key) <= MAX_KEY else f"{key[:MAX_KEY]}..."
                yield f"unknown key {shown}; {advice}"

    @field_validator("*")
    @classmethod
    def _within_range(cls, value: Any, info: ValidationInfo) -> Any:
        allowed = _ranges_of(cls).get(str(info.field_name))
        if allowed and not allowed.low <= value <= allowed.high:
            raise ValueError(f"{value} is outside the allowed range {allowed.text()}")
        return value

    @model_validator(mode="after")
    def _minimum_below_maximum(self) -> Self:
        for name_of_min in _minima_of(type(self)):
            name_of_max = name_of_min.removesuffix("_min") + "_max"
            low = getattr(self, name_of_min)
            high = getattr(self, name_of_max)
            if low > high:
                raise ValueError(
                    f"{name_of_min} is {low}, but must not exceed {name_of_max}, which is {high}"
                )
        return self


class AllowedRange(NamedTuple):
    """The allowed range of a quantity, ends included."""

    low: float
    high: float
    unit: str

    def text(self) -> str:
        """Return the range as an error states it."""
        return f"{self.low} to {self.high} {self.unit}"


def _range_of(field: Any) -> AllowedRange | None:
    """Return the range that ``quantity`` declared for a field of a model, or None."""
    declared = field.json_schema_extra
    if not isinstance(declared, dict) or "unit" not in declared:
        return None
    return AllowedRange(low=declared["minimum"], high=declared["maximum"], unit=declared["unit"])


# A scenario is validated value by value, and its classes declare the same every time.
@cache
def _ranges_of(section: type[BaseModel]) -> dict[str, AllowedRange]:
    """Return the ranges of a section's quantities by their names."""
    ranges = {}
    for name, field in section.model_fields.items():
        allowed = _range_of(field)
        if allowed:
            ranges[name] = allowed
    return ranges


@cache
def _minima_of(section: type[BaseModel]) -> tuple[str, ...]:
    """Return the names of a section's fields that end in ``_min``."""
    return tuple(name for name in section.model_fields if name.endswith("_min"))


def declared_ranges(section: type[BaseModel], prefix: str = "") -> dict[str, AllowedRange]:
    """Return the range of every quantity of a section and the sections in it, by dotted names."""
    ranges: dict[str, AllowedRange] = {}
    for name, field in section.model_fields.items():
        allowed = _range_of(field)
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            ranges |= declared_ranges(field.annotation, f"{prefix}{name}.")
        elif allowed:
            ranges[prefix + name] = allowed
    return ranges
