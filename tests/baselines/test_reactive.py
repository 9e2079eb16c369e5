"""The rule whose limits react to what becomes of its edges."""

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from baselines import reactive
from baselines.catalogue import names
from baselines.reactive import START_SHARE, TUNED, WINDOW_ALONE, Reactions, Reactive
from baselines.self_tuning import RULES
from turning_env import Family, FamilyVectorEnv
from turning_env.physics.quantities import OBS

FAMILY = Family.load("unmodelled")
FIXED: Any = RULES["self_tuning"].fixed
REACTIONS = Reactions(
    speed=-0.3,
    change_at=0.8,
    slower=0.2,
    sooner=0.5,
    fast_wear=1.0,
    faster=0.4,
    bolder=0.1,
    span=0.2,
)


def rule(*jobs: int) -> Reactive:
    """Return the rule on training jobs."""
    models = [FAMILY.job(job).scenario.nominal() for job in jobs]
    return Reactive(models, len(jobs), REACTIONS, **FIXED)


def observations(*jobs: int) -> Any:
    """Return the first observations of training jobs."""
    env = FamilyVectorEnv(
        len(jobs), FAMILY, context="hidden", autoreset_mode=AutoresetMode.DISABLED
    )
    first, _ = env.reset(seed=list(jobs))
    return first


def log_speed_after(removed_wear: float, nominal_wear: float) -> tuple[float, float]:
    """Return the log of the highest speed, and the used life at the change, after an edge.

    Both wears are over the criterion.
    """
    policy = rule(3)
    observation = observations(3)
    observation[:, OBS.cutting_time] = np.log(1.0 + 5.0)
    observation[:, OBS.nominal_wear] = nominal_wear
    policy.act(observation)
    observation[:, OBS.cutting_time] = 0.0
    observation[:, OBS.nominal_wear] = 0.0
    # ``removed_wear`` and ``tangles`` are the last two entries.
    observation[:, -2] = removed_wear
    policy.act(observation)
    log_speed = np.log(policy.top_speed[0] / START_SHARE)
    return float(log_speed), float(policy.change_at[0])


def test_a_broken_edge_lowers_the_speed_and_brings_the_change_forward() -> None:
    model = FAMILY.job(3).scenario.nominal()
    log_speed, change_at = log_speed_after(removed_wear=0.3, nominal_wear=0.3)
    assert log_speed == pytest.approx(-0.5)
    used_life = 0.3 ** (1.0 / model.material.wear.time)
    assert change_at == pytest.approx(max(0.5 * used_life, 0.1), rel=1e-5)


def test_an_edge_that_wore_fast_raises_the_speed() -> None:
    log_speed, change_at = log_speed_after(removed_wear=1.0, nominal_wear=0.2)
    assert log_speed == pytest.approx(0.1)
    assert change_at == 0.8


def test_an_edge_that_wore_out_as_expected_raises_the_speed_a_little() -> None:
    log_speed, change_at = log_speed_after(removed_wear=1.0, nominal_wear=1.0)
    assert log_speed == pytest.approx(-0.2)
    assert change_at == 0.8


@pytest.mark.slow
def test_a_batch_acts_as_its_environments_alone() -> None:
    env = FamilyVectorEnv(
        2,
        FAMILY,
        context="hidden",
        autoreset_mode=AutoresetMode.DISABLED,
    )
    seen, _ = env.reset(seed=[5, 9])
    batch = rule(5, 9)
    singles = [rule(5), rule(9)]
    for _ in range(60):
        actions = batch.act(seen)
        for index, single in enumerate(singles):
            np.testing.assert_array_equal(single.act(seen[[index]])[0], actions[index])
        seen, *_ = env.step(actions)


@pytest.mark.parametrize(("name", "numbers"), [("chip_window", WINDOW_ALONE), ("reactive", TUNED)])
def test_the_catalogue_has_the_numbers_that_were_found(name: str, numbers: Reactions) -> None:
    scenario = FAMILY.job(5).scenario
    assert name in names(scenario)
    uncounted = scenario.model_copy(
        update={"sensors": scenario.sensors.model_copy(update={"counts_tangles": False})}
    )
    assert name not in names(uncounted)

    listed: Any = reactive.RULES[name]
    in_catalogue = listed.controller(scenario.nominal(), 1, **listed.fixed)
    by_numbers = Reactive(scenario.nominal(), 1, numbers, **FIXED)
    env = FamilyVectorEnv(
        1,
        FAMILY,
        context="hidden",
        autoreset_mode=AutoresetMode.DISABLED,
    )
    seen, _ = env.reset(seed=[5])
    for _ in range(40):
        actions = in_catalogue.act(seen)
        np.testing.assert_array_equal(actions, by_numbers.act(seen))
        seen, *_ = env.step(actions)
