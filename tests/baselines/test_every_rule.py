"""Properties of every rule of the catalogue."""

import numpy as np
import pytest

from baselines.catalogue import RULES, names, playable
from baselines.rule import Parameters, Rule
from baselines.tune import middle
from tests.turning_env.playing import changed
from turning_env import IDS, RoughTurningVectorEnv, Scenario, presets
from turning_env.observation import bounds
from turning_env.scoring.policy import Policy

SCENARIOS = {name: Scenario.load(name).nominal() for name in presets()}
SHOWN = ("rough_turning", "shift", "paper", "override", "surface", "batch_casting")
PLAYED = [
    # The optimisers price the edge's life when they are built, which takes a second where edges are changed.
    pytest.param(
        name, preset, marks=[pytest.mark.slow] if rule.tuned_on and preset == "shift" else []
    )
    for name, rule in RULES.items()
    for preset in SHOWN
    if rule.plays(SCENARIOS[preset])
]


def parameters(rule: Rule) -> Parameters:
    return rule.fixed | {name: middle(values) for name, values in rule.ranges.items()}


@pytest.mark.parametrize(("name", "preset"), PLAYED)
def test_actions_are_finite_for_any_observation(name: str, preset: str) -> None:
    """Warnings count as errors throughout this suite."""
    scenario, num_envs = SCENARIOS[preset], 16
    rule, (low, high) = playable(name, scenario), bounds(scenario)
    seen = np.random.default_rng(7).uniform(low, high, (12, num_envs, len(low))).astype(np.float32)
    seen[:, :4] = np.where(
        np.arange(4)[:, np.newaxis] % 2, low, high
    )  # the ends of all entries, in turns
    if scenario.control.action != "part":
        seen[:, 4:6, 0] = low[0]  # no load
        seen[:, 6:8, 6] = np.linspace(0.0, 3.0, 12, dtype=np.float32)[
            :, np.newaxis
        ]  # edges that live on
    policy = rule.controller(scenario, num_envs, **parameters(rule))
    policy.reset(np.ones(num_envs, np.bool_))
    shape = RoughTurningVectorEnv(num_envs, scenario).action_space.shape
    with np.errstate(divide="raise", invalid="raise"):
        for observations in seen:
            actions = policy.act(observations)
            assert (actions.shape, actions.dtype) == (shape, np.float32)
            assert np.all(np.abs(actions) <= 1.0)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "preset"), PLAYED)
def test_environments_do_not_influence_one_another_and_a_reset_forgets_everything(
    name: str, preset: str
) -> None:
    scenario = changed(SCENARIOS[preset], limits={"power": 5.0})
    rule, env = playable(name, scenario), RoughTurningVectorEnv(3, scenario)

    def fresh(num_envs: int) -> Policy:
        policy = rule.controller(scenario, num_envs, **parameters(rule))
        policy.reset(np.ones(num_envs, np.bool_))
        return policy

    batch, single, anew = fresh(3), fresh(1), fresh(1)
    observations, _ = env.reset(seed=5)
    for step in range(12):
        if step == 8:
            batch.reset(np.array([False, True, False]))
        actions = batch.act(observations)
        np.testing.assert_array_equal(single.act(observations[2:]), actions[2:])
        if step >= 8:
            np.testing.assert_array_equal(anew.act(observations[1:2]), actions[1:2])
        observations, *_ = env.step(actions)


def test_every_task_has_random_actions_no_action_and_one_best_constant_action() -> None:
    for preset in IDS.values():
        played = names(SCENARIOS[preset])
        assert {"random", "zero_action"} <= set(played)
        assert (
            sum(name in ("fixed_tuned", "override_tuned", "parts_fixed_tuned") for name in played)
            == 1
        )


def test_rules_that_invert_a_law_play_only_where_it_grows_with_feed() -> None:
    for law, preset, unable in (
        ("power", "override", ["omative", "constant_power_lead"]),
        ("power", "rough_turning", ["omative_with_speed", "grid_search", "rescaled_grid_search"]),
        ("thrust_force", "override", ["current_limit"]),
        (
            "thrust_force",
            "surface",
            ["model_feed", "constant_force_network", "constant_force_lead"],
        ),
    ):
        material = SCENARIOS[preset].material
        falling = getattr(material, law).model_copy(update={"feed": -0.1})
        scenario = SCENARIOS[preset].model_copy(
            update={"material": material.model_copy(update={law: falling})}
        )
        for name in unable:
            assert RULES[name].plays(SCENARIOS[preset]), name
            assert not RULES[name].plays(scenario), name
