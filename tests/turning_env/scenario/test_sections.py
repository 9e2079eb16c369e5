"""Declarations of fields: every field has its unit, range and description."""

import math
from typing import Any

import pytest
from pydantic import ValidationError

from turning_env import PowerLaw, Scenario
from turning_env.scenario.section import Section

SECTIONS = [
    *(type(value) for value in dict(Scenario()).values() if isinstance(value, Section)),
    PowerLaw,
]


FIELDS = [
    pytest.param(section, name, field, id=f"{section.__name__}.{name}")
    for section in SECTIONS
    for name, field in section.model_fields.items()
]


@pytest.mark.parametrize(("section", "name", "field"), FIELDS)
def test_field_has_description_unit_and_range(
    section: type[Section], name: str, field: Any
) -> None:
    assert field.description
    if field.annotation not in (float, int):
        return
    declared = field.json_schema_extra
    low, high, unit = declared["minimum"], declared["maximum"], declared["unit"]
    assert field.description.endswith(f"[{unit}]")
    required = {"coefficient": 1.0} if section is PowerLaw else {}
    assert low <= getattr(section(**required), name) <= high
    below, above = math.nextafter(low, -math.inf), math.nextafter(high, math.inf)
    for outside in (
        (math.floor(below), math.ceil(above)) if field.annotation is int else (below, above)
    ):
        with pytest.raises(ValidationError, match=name) as refusal:
            section(**required | {name: outside})
        assert f"{low} to {high} {unit}" in str(refusal.value)
