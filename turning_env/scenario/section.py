"""Declare configured quantities: every number has a default, a unit and an allowed range, which is checked."""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any, NamedTuple, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator


def quantity(default: Any, low: float, high: float, unit: str, description: str) -> Any:
    """Declare a number with its default, its allowed range (ends included), its unit and its meaning."""
    return Field(
        default,
        description=f"{description} [{unit}]",
        json_schema_extra={"minimum": low, "maximum": high, "unit": unit},
    )


def names_instead(name: str, allowed: Iterable[str], lists_all: str) -> str:
    """Return advice on an unknown name: similar names, or all names if they are few, or the command that lists them."""
    names = list(allowed)
    if close := get_close_matches(name[:100], names, 3, 0.7):
        return f"did you mean {' or '.join(close)}?"
    return f"allowed are {', '.join(names)}" if len(names) <= 8 else f"list all with: {lists_all}"


def _with_tuples(value: Any) -> Any:
    """Return a value with tuples in place of the lists that TOML and JSON have: fields are frozen."""
    if isinstance(value, dict):
        return {key: _with_tuples(each) for key, each in value.items()}
    return tuple(value) if isinstance(value, list) else value


class Section(BaseModel):
    """A frozen group of fields that refuses unknown keys, wrong types, NaN and infinity. Field docstrings are descriptions."""

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
        if isinstance(values, dict):
            values = _with_tuples(values)
            unknown = [str(key) for key in values if key not in cls.model_fields]
            if unknown:
                known = cls.model_fields, "python -m turning_env schema"
                raise ValueError(
                    "; ".join(f"unknown key {key}; {names_instead(key, *known)}" for key in unknown)
                )
        return values

    @field_validator("*")
    @classmethod
    def _within_range(cls, value: Any, info: ValidationInfo) -> Any:
        declared = cls.model_fields[str(info.field_name)].json_schema_extra
        if isinstance(declared, dict) and "unit" in declared:
            low, high, unit = declared["minimum"], declared["maximum"], declared["unit"]
            if not low <= value <= high:
                raise ValueError(f"{value} is outside the allowed range {low} to {high} {unit}")
        return value

    @model_validator(mode="after")
    def _ranges_open(self) -> Self:
        for name in type(self).model_fields:
            other = name.removesuffix("_min") + "_max"
            if name.endswith("_min") and (low := getattr(self, name)) > (
                high := getattr(self, other)
            ):
                raise ValueError(f"{name} is {low}, but must not exceed {other}, which is {high}")
        return self


class Range(NamedTuple):
    """The allowed range of a quantity, ends included."""

    low: float
    high: float
    unit: str


def declared_ranges(section: type[BaseModel], prefix: str = "") -> dict[str, Range]:
    """Return the range of every quantity of a section and of the sections in it, by dotted names."""
    ranges: dict[str, Range] = {}
    for name, field in section.model_fields.items():
        declared: Any = field.json_schema_extra
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            ranges |= declared_ranges(field.annotation, f"{prefix}{name}.")
        elif isinstance(declared, dict) and "unit" in declared:
            ranges[prefix + name] = Range(
                declared["minimum"], declared["maximum"], declared["unit"]
            )
    return ranges
