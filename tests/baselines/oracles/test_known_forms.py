import numpy as np
import pytest

from baselines.oracles.known_forms import BUILT_UP_WEAR, collapses, edges_fail, lowest_speed
from tests.turning_env.playing import changed
from turning_env import Scenario

SHIFT = Scenario.load("shift")


def test_edges_build_up_below_the_lowest_speed_as_much_as_is_allowed() -> None:
    failure = {"built_up_edge": 8.0, "built_up_speed": 80.0, "built_up_width": 0.45}
    scenario = changed(SHIFT, edge_failure=failure)
    distance = np.log(lowest_speed(scenario) / 80.0) / 0.45
    assert distance > 0.0
    assert 8.0 * np.exp(-(distance**2)) == pytest.approx(BUILT_UP_WEAR)


def test_the_lowest_speed_of_edges_that_do_not_build_up_is_the_machines() -> None:
    assert lowest_speed(SHIFT) == SHIFT.machine.cutting_speed_min


@pytest.mark.parametrize(("temperature", "expected"), [(0.0, False), (1000.0, True), (9e3, False)])
def test_edges_collapse_if_the_machine_can_make_them_too_hot(
    temperature: float, expected: bool
) -> None:
    scenario = changed(SHIFT, edge_failure={"collapse_temperature": temperature})
    assert collapses(scenario) == expected
    assert edges_fail(scenario) == expected


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"edge_failure": {"notch_growth": 2.0}}, id="notch"),
        pytest.param({"edge_failure": {"built_up_edge": 5.0}}, id="built-up edge"),
        pytest.param({"machine": {"chatter": 0.5}}, id="chatter"),
    ],
)
def test_each_form_counts(changes: dict[str, dict[str, float]]) -> None:
    assert not edges_fail(SHIFT)
    assert edges_fail(changed(SHIFT, **changes))
