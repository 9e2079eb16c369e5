import numpy as np
import pytest

from baselines.fuzzy_override import FIRST_FORM, MODIFIED_FORM, RULES, new_override
from tests.baselines.observing import observe, override_of
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


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("target", [0.05, 0.6, 0.99, 1.0, 1.5])
def test_it_stays_within_its_range_and_heeds_the_load_at_any_target(target: float, form: dict[str, float]) -> None:
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        new = new_override(OVERRIDES, LOADS, target, 2.0, **form)
    assert np.all((new >= 0.0) & (new <= 2.0))
    excess = LOADS - target
    assert np.all(new[excess < 0.0] >= OVERRIDES[excess < 0.0])
    lowered = (excess > 0.01) & (OVERRIDES - form["d"] > 0.01)
    assert np.all(new[lowered] < OVERRIDES[lowered])


def test_the_policy_is_the_law_with_the_target_of_60_percent() -> None:
    overrides, loads = np.array([1.0, 1.45, 0.74, 2.0]), np.array([0.25, 0.6001, 0.75, 1.25])
    for name, form in (("fuzzy_override", FIRST_FORM), ("modified_fuzzy_override", MODIFIED_FORM)):
        policy = RULES[name].build(OVERRIDE, 4, RULES[name].fixed)
        asked = override_of(policy.act(observe(OVERRIDE, load=loads, override=overrides)), OVERRIDE)
        np.testing.assert_allclose(asked, np.maximum(new_override(overrides, loads, 0.6, 2.0, **form), 0.01), rtol=1e-4)
