"""Laws that come to what no computer can represent are refused by name, and all that come near stay finite."""

from typing import Any

import numpy as np
import pytest

from turning_env import RoughTurningEnv, Scenario, presets


def test_every_preset_makes_sense() -> None:
    for preset in presets():
        Scenario.load(preset)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"thrust_force": {"coefficient": 1e12, "cutting_speed": 10.0, "wear": -10.0}}, "thrust_force comes to 1e7"),
        (
            {
                "wear": {"time": 6.0},
                "power": {"coefficient": 1e-12, "cutting_speed": -10.0, "depth_of_cut": 10.0, "wear": 10.0},
            },
            "power comes to 1e-",
        ),
        ({"wear": {"time": 0.01, "coefficient": 1e12}}, "wear comes to 1e"),
    ],
)
def test_a_law_beyond_sense_is_refused_by_its_name(changed: dict[str, dict[str, float]], message: str) -> None:
    material: dict[str, Any] = Scenario().material.model_dump()
    for law, values in changed.items():
        material[law] |= values
    with pytest.raises(ValueError, match=rf"material\.{message}.* within the scenario's ranges"):
        Scenario.model_validate({"material": material})


def test_a_law_at_the_edge_of_sense_stays_finite() -> None:
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


def test_all_laws_beyond_sense_are_named_at_once() -> None:
    material: dict[str, Any] = Scenario().material.model_dump()
    for law in ("thrust_force", "power"):
        material[law] |= {"coefficient": 1e12, "cutting_speed": 10.0, "wear": -10.0}
    with pytest.raises(ValueError, match=r"material\.thrust_force comes to 1e.*; material\.power comes to 1e"):
        Scenario.model_validate({"material": material})
