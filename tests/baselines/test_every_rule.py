"""Properties of every rule of the catalogue."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from baselines.catalogue import RULES, names, playable
from baselines.rule import Parameters, Rule
from tests.turning_env.playing import changed
from train.tune_rules import middle
from turning_env import IDS, RoughTurningVectorEnv, Scenario, presets
from turning_env.observation import bounds
from turning_env.physics.quantities import OBS
from turning_env.policy import Policy

SCENARIOS = {name: Scenario.load(name).nominal() for name in presets()}
# Force and power grow from that of a fresh edge, which needs no wear.
SCENARIOS["fresh_share"] = Scenario.load(
    {
        "base": "rough_turning",
        "material": {
            "thrust_force": {"coefficient": 5962.0, "wear": 1.0, "wear_growth": 4.2},
            "power": {"coefficient": 0.1275, "wear": 1.0, "wear_growth": 0.83},
        },
    }
)
SHOWN = ("rough_turning", "fresh_share", "shift", "paper", "override", "surface", "batch_casting")
# Edges live on in these observations.
CUTTING_TIMES = np.linspace(0.0, 3.0, 12, dtype=np.float32)


def plays() -> Iterator[Any]:
    """Yield the names of every rule and of the presets that it plays."""
    for name, rule in RULES.items():
        for preset in SHOWN:
            # The optimisers price the edge's life when they are built, which takes a second where
            # edges are changed.
            slow = rule.tuned_on is not None and preset == "shift"
            if rule.plays(SCENARIOS[preset]):
                yield pytest.param(name, preset, marks=[pytest.mark.slow] if slow else [])


PLAYED = list(plays())


def parameters(rule: Rule) -> Parameters:
    """Return the fixed parameters of a rule, and the middle of its ranges."""
    values = dict(rule.fixed)
    for name, range_of_values in rule.ranges.items():
        values[name] = middle(range_of_values)
    return values


def unusual_observations(scenario: Scenario, num_envs: int) -> NDArray[np.float32]:
    """Return random observations with extreme ones among them, shape (12, num_envs, entries)."""
    low, high = bounds(scenario)
    random = np.random.default_rng(7)
    seen = random.uniform(low, high, (12, num_envs, len(low))).astype(np.float32)
    # The ends of all entries, in turns.
    seen[:, 0] = low
    seen[:, 1] = high
    seen[:, 2] = low
    seen[:, 3] = high
    if scenario.control.action != "part":
        seen[:, 4:6, OBS.power] = low[OBS.power]  # no load
        seen[:, 6:8, OBS.cutting_time] = CUTTING_TIMES[:, np.newaxis]
    return seen


@pytest.mark.parametrize(("name", "preset"), PLAYED)
def test_actions_are_finite_for_any_observation(name: str, preset: str) -> None:
    scenario = SCENARIOS[preset]
    num_envs = 16
    rule = playable(name, scenario)
    policy = rule.controller(scenario, num_envs, **parameters(rule))
    policy.reset(np.ones(num_envs, np.bool_))
    shape = RoughTurningVectorEnv(num_envs, scenario).action_space.shape
    # Warnings count as errors throughout this suite.
    with np.errstate(divide="raise", invalid="raise"):
        for observations in unusual_observations(scenario, num_envs):
            actions = policy.act(observations)
            assert actions.shape == shape
            assert actions.dtype == np.float32
            assert np.abs(actions).max() <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("name", "preset"), PLAYED)
def test_environments_do_not_influence_one_another_and_a_reset_forgets_everything(
    name: str, preset: str
) -> None:
    scenario = changed(SCENARIOS[preset], limits={"power": 5.0})
    rule = playable(name, scenario)
    env = RoughTurningVectorEnv(3, scenario)

    def fresh(num_envs: int) -> Policy:
        policy = rule.controller(scenario, num_envs, **parameters(rule))
        policy.reset(np.ones(num_envs, np.bool_))
        return policy

    batch = fresh(3)
    single = fresh(1)  # of the last environment
    after_reset = fresh(1)  # of the second environment after its reset
    observations, _ = env.reset(seed=5)
    for step in range(12):
        if step == 8:
            batch.reset(np.array([False, True, False]))
        actions = batch.act(observations)
        np.testing.assert_array_equal(single.act(observations[2:]), actions[2:])
        if step >= 8:
            np.testing.assert_array_equal(after_reset.act(observations[1:2]), actions[1:2])
        observations, *_ = env.step(actions)


def test_every_task_has_random_actions_no_action_and_one_best_constant_action() -> None:
    for preset in IDS.values():
        played = set(names(SCENARIOS[preset]))
        assert {"random", "zero_action"} <= played
        assert len(played & {"fixed_tuned", "override_tuned", "parts_fixed_tuned"}) == 1


@pytest.mark.parametrize(
    ("law", "preset", "unable"),
    [
        ("power", "override", ["omative", "constant_power_lead"]),
        ("power", "rough_turning", ["omative_with_speed", "grid_search", "rescaled_grid_search"]),
        ("thrust_force", "override", ["current_limit"]),
        (
            "thrust_force",
            "surface",
            ["model_feed", "constant_force_network", "constant_force_lead"],
        ),
    ],
)
def test_rules_that_invert_a_law_play_only_where_it_grows_with_feed(
    law: str, preset: str, unable: list[str]
) -> None:
    scenario = SCENARIOS[preset]
    falling = getattr(scenario.material, law).model_copy(update={"feed": -0.1})
    material = scenario.material.model_copy(update={law: falling})
    changed_scenario = scenario.model_copy(update={"material": material})
    for name in unable:
        assert RULES[name].plays(scenario), name
        assert not RULES[name].plays(changed_scenario), name
