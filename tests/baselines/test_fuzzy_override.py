import numpy as np
import pytest

from baselines.fuzzy_override import FIRST_FORM, MODIFIED_FORM, new_override
from turning_env import Scenario

OVERRIDE = Scenario.load("override")
AXES = np.meshgrid(np.linspace(0.0, 2.0, 41), np.linspace(0.0, 4.0, 81))
OVERRIDES, LOADS = (axis.ravel() for axis in AXES)
FORMS = [FIRST_FORM, MODIFIED_FORM]


def percent(override: float, load: float, target: float, form: dict[str, float]) -> float:
    """The law in per cent, as the paper has it."""
    shares = np.array([override]) / 100.0, np.array([load]) / 100.0
    return 100.0 * float(new_override(*shares, target / 100.0, 2.0, **form)[0])


@pytest.mark.parametrize(
    ("form", "override", "load", "expected"),
    [
        # exp(-5/60^2 30^2) = 0.286505 and exp(-10/0.4 0.15^2) = 0.569783
        (FIRST_FORM, 100.0, 30.0, 200 * (0.5 + 0.286505 - 0.286505 * 0.5)),
        (FIRST_FORM, 100.0, 75.0, 56.9783),
        (MODIFIED_FORM, 100.0, 30.0, 200 * (0.5 + 0.0286505 - 0.0286505 * 0.5)),
        (MODIFIED_FORM, 100.0, 75.0, (0.1 * 0.569783 + 0.9) * 75 + 25),
        # On target the override stays; without load the first form goes to 200 % at once, the modified a tenth of the way.
        (FIRST_FORM, 145.0, 60.0, 145.0),
        (MODIFIED_FORM, 145.0, 60.0, 145.0),
        (FIRST_FORM, 1.0, 0.0, 200.0),
        (MODIFIED_FORM, 100.0, 0.0, 110.0),
    ],
)
def test_equations(form: dict[str, float], override: float, load: float, expected: float) -> None:
    assert percent(override, load, 60.0, form) == pytest.approx(expected, rel=1e-5)
