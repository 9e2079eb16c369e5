"""Declaration of configured quantities: every number has a default, an allowed range and a unit, which are checked."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator


def quantity(default: Any, low: float, high: float, unit: str, description: str) -> Any:
    """Declare a number with its default, its allowed range (ends included), its unit and its meaning."""
    return Field(
        default,
        description=f"{description} [{unit}]",
        json_schema_extra={"minimum": low, "maximum": high, "unit": unit},
    )


class Section(BaseModel):
    """A frozen group of fields, which refuses unknown keys, wrong types, NaN and infinity. Docstrings of fields describe them."""

    # Defaults are validated so that a default of 3 becomes 3.0, as if read from a file.
    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, strict=True, validate_default=True, use_attribute_docstrings=True
    )

    @model_validator(mode="before")
    @classmethod
    def _keys_known(cls, values: Any) -> Any:
        if isinstance(values, dict):
            unknown = [str(key) for key in values if key not in cls.model_fields]
            if unknown:
                raise ValueError(f"unknown key {', '.join(unknown)}; allowed are {', '.join(cls.model_fields)}")
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
