"""Control with a lead for the lags.

It settles faster than the law without, and needs no exact model of the load.
"""

import numpy as np
import pytest

from baselines.catalogue import spec
from leaderboard.play import play
from leaderboard.seeds import tuning_seeds
from tests.turning_env.playing import changed
from turning_env import RoughTurningVectorEnv, Scenario

SEEDS = tuning_seeds(4)
STEADY = {"hardness_along_spread": 0.0, "hardness_bar_spread": 0.0, "depth_bar_spread": 0.0}


def mean_return(name: str, scenario: Scenario, like: Scenario) -> float:
    """Return the mean return [s] of a rule that was tuned on the scenario ``like``."""
    return float(play(spec(name, scenario, like).make, scenario, SEEDS)["return"].mean())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("preset", "with_lead", "without"),
    [
        ("surface", "constant_force_lead", "constant_force"),
        ("override", "constant_power_lead", "omative"),
    ],
)
def test_the_lead_returns_more_than_the_law_without(
    preset: str, with_lead: str, without: str
) -> None:
    scenario = Scenario.load(preset)
    assert mean_return(with_lead, scenario, scenario) > mean_return(without, scenario, scenario)


@pytest.mark.slow
def test_harder_metal_than_nominal_is_estimated() -> None:
    surface = Scenario.load("surface")
    harder = changed(surface, mismatch={"hardness_factor": 1.3})
    expected = mean_return("constant_force_lead", surface, surface)
    assert mean_return("constant_force_lead", harder, surface) == pytest.approx(expected, abs=1.5)


@pytest.mark.slow
def test_roughness_settles_within_a_third_of_a_second_and_stays() -> None:
    """The servo's lag alone needs 0.4 s to come within 5 %: three time constants of 0.13 s."""
    surface = Scenario.load("surface")
    steady = changed(surface, workpiece=STEADY, sensors={"force_noise": 0.0})
    env = RoughTurningVectorEnv(1, steady)
    policy = spec("constant_force_lead", steady, surface).make(1)
    policy.reset(np.ones(1, np.bool_))
    observations, _ = env.reset(seed=SEEDS[0])

    deviations = []
    for _ in range(1499):
        observations, _, _, _, info = env.step(policy.act(observations))
        deviations.append(abs(info["roughness"][0] / info["roughness_reference"][0] - 1.0))

    steps_per_period = round(surface.surface.reference_time / surface.control.interval)
    settling = round(0.33 / surface.control.interval)
    for period in range(1, 4):
        start = period * steps_per_period
        assert max(deviations[start + settling : start + steps_per_period - 1]) < 0.05
