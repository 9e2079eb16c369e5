"""Laws whose numbers cannot be represented are refused by name; laws just within the range stay finite."""

from typing import Any

import pytest

from turning_env import Scenario


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"thrust_force": {"coefficient": 1e12, "cutting_speed": 10.0, "wear": -10.0}}, "thrust_force comes to 1e7"),
        ({"wear": {"time": 0.01, "coefficient": 1e12}}, "wear comes to 1e"),
        (
            {law: {"coefficient": 1e12, "cutting_speed": 10.0, "wear": -10.0} for law in ("thrust_force", "power")},
            r"thrust_force comes to 1e.*; material\.power comes to 1e",
        ),
    ],
)
def test_law_beyond_range_is_refused_by_its_name(changed: dict[str, dict[str, float]], message: str) -> None:
    material: dict[str, Any] = Scenario().material.model_dump()
    for law, values in changed.items():
        material[law] |= values
    with pytest.raises(ValueError, match=rf"material\.{message}.* within the scenario's ranges"):
        Scenario.model_validate({"material": material})
