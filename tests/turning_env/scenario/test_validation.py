"""Laws whose numbers cannot be represented are refused by name; laws just within the range stay finite."""

from typing import Any

import numpy as np
import pytest

from turning_env import RoughTurningEnv, Scenario


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


def test_law_just_within_range_stays_finite() -> None:
    material: dict[str, Any] = Scenario().material.model_dump()
    material["thrust_force"] |= {"coefficient": 1e12, "cutting_speed": 10.0, "depth_of_cut": 5.0}
    env = RoughTurningEnv(Scenario.model_validate({"material": material, "sensors": {"force": "servo_current"}}))
    env.reset(seed=0)
    for _ in range(20):
        observation, reward, terminated, _, info = env.step(np.ones(2))
        assert env.observation_space.contains(observation)
        assert np.isfinite([reward, *info.values()]).all()
        if terminated:
            break
    assert info["thrust_force"] > 1e20
