import numpy as np
import pytest

from baselines.models.edge_value import USED_LIVES, worth
from baselines.models.life_price import price_life
from baselines.optimiser import parameter_record
from turning_env import Scenario

SCENARIO = Scenario.load("shift")
SHARES = USED_LIVES[3::6]


def prices(**changes: float) -> np.ndarray:
    """Return the prices of life [s] at ``SHARES``, with changes of the laws."""
    parameters, material = parameter_record(SCENARIO, 1.0), SCENARIO.material
    laws = dict(zip(("life_rate", "life_speed", "life_feed"), parameters["life"][0], strict=True))
    for name, law in (("force", material.thrust_force), ("power", material.power)):
        laws |= {name: parameters[name][0], f"{name}_speed": law.cutting_speed, f"{name}_feed": law.feed}
        laws[f"{name}_life"] = law.wear * material.wear.time
    values = [value + changes.get(name, 0.0) for name, value in laws.items()]
    found = np.empty(len(SHARES))
    price_life(parameters, np.tile(values, (len(SHARES), 1)), SHARES, found)
    return found


def test_it_is_near_the_price_by_dynamic_programming() -> None:
    exact = worth(SCENARIO, SCENARIO.economics.overload_price).life[3::6]
    assert prices() == pytest.approx(exact, abs=0.15 * exact.max())
    assert (np.diff(prices()) < 0.0).all()


def test_life_is_dearer_where_loads_are_lower_and_cheaper_where_it_is_soon_used() -> None:
    assert (prices(force=-0.2, power=-0.2)[-2:] >= prices()[-2:]).all()
    assert (prices(life_rate=0.3) < prices())[0]
