"""Declarations of fields: every field has its unit, range and description."""

import math
from typing import Any

import pytest
from pydantic import ValidationError

from turning_env import PowerLaw, Scenario
from turning_env.scenario.section import Section, names_instead

SECTIONS = [type(value) for value in dict(Scenario()).values() if isinstance(value, Section)]
SECTIONS.append(PowerLaw)

FIELDS = [
    pytest.param(section, name, id=f"{section.__name__}.{name}")
    for section in SECTIONS
    for name in section.model_fields
]

NUMBERS = [
    pytest.param(section, name, id=f"{section.__name__}.{name}")
    for section in SECTIONS
    for name, field in section.model_fields.items()
    if field.annotation in (float, int)
]


def just_outside(low: float, high: float, kind: type) -> tuple[float, float]:
    """Return the numbers of a kind next to the ends of a range."""
    below = math.nextafter(low, -math.inf)
    above = math.nextafter(high, math.inf)
    return (math.floor(below), math.ceil(above)) if kind is int else (below, above)


@pytest.mark.parametrize(("section", "name"), FIELDS)
def test_a_field_has_a_description(section: type[Section], name: str) -> None:
    assert section.model_fields[name].description


@pytest.mark.parametrize(("section", "name"), NUMBERS)
def test_a_number_has_a_unit_and_a_range_that_holds_its_default(
    section: type[Section], name: str
) -> None:
    field: Any = section.model_fields[name]
    low = field.json_schema_extra["minimum"]
    high = field.json_schema_extra["maximum"]
    unit = field.json_schema_extra["unit"]
    assert field.description.endswith(f"[{unit}]")
    required = {"coefficient": 1.0} if section is PowerLaw else {}
    assert low <= getattr(section(**required), name) <= high
    for outside in just_outside(low, high, kind=field.annotation):
        with pytest.raises(ValidationError, match=name) as refusal:
            section(**required | {name: outside})
        assert f"{low} to {high} {unit}" in str(refusal.value)


def test_sections_of_the_drawing_have_equal_lengths_unless_these_are_given() -> None:
    work = Scenario().workpiece.model_copy(
        update={"bar_length": 90.0, "depth_profile": (2.0, 0.0, 3.0)}
    )
    drawn = work.drawn_sections()
    assert drawn.depths.tolist() == [2.0, 0.0, 3.0]
    assert drawn.starts.tolist() == [0.0, 30.0, 60.0]
    assert drawn.ends.tolist() == [30.0, 60.0, 90.0]

    drawn = work.model_copy(update={"section_lengths": (20.0, 5.0, 65.0)}).drawn_sections()
    assert drawn.starts.tolist() == [0.0, 20.0, 25.0]
    assert drawn.ends.tolist() == [20.0, 25.0, 90.0]


def test_a_bar_of_one_depth_is_one_section() -> None:
    work = Scenario().workpiece.model_copy(update={"bar_length": 90.0, "depth_of_cut": 2.0})
    drawn = work.drawn_sections()
    assert drawn.depths.tolist() == [2.0]
    assert drawn.starts.tolist() == [0.0]
    assert drawn.ends.tolist() == [90.0]


MANY = [f"name_{number}" for number in range(20)]


@pytest.mark.parametrize(
    ("name", "allowed", "advice"),
    [
        pytest.param("forgin", ["forging", "casting"], "did you mean forging?", id="similar"),
        pytest.param("x", ["forging", "casting"], "allowed are forging, casting", id="few"),
        pytest.param("x", MANY, "list all with: a command", id="many"),
    ],
)
def test_an_unknown_name_gets_advice(name: str, allowed: list[str], advice: str) -> None:
    assert names_instead(name, allowed, lists_all="a command") == advice


def test_without_a_command_the_advice_has_the_first_of_many_names() -> None:
    advice = names_instead("x", MANY)
    assert advice.startswith("allowed are name_0, name_1, ")
    assert advice.endswith("name_7 and 12 others")
