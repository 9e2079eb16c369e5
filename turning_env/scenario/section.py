"""The one way in which configured quantities are declared and checked: unit and allowed range with every field."""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator


def quantity(default: Any, low: float, high: float, unit: str, description: str) -> Any:
    """Declare a number with its default, its allowed range (both ends allowed) and its unit."""
    return Field(
        default,
        description=f"{description} [{unit}]",
        json_schema_extra={"minimum": low, "maximum": high, "unit": unit},
    )


class Section(BaseModel):
    """A frozen group of quantities. Unknown keys, wrong types, NaN and infinity are refused."""

    # Defaults are validated so that a default of 3 becomes 3.0, as it would when read from a file: digests depend on it.
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, strict=True, validate_default=True)

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
