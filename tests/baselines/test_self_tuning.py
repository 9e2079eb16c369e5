"""The self-tuning optimiser plays jobs of a family, alone and together, and prices its lot."""

import numpy as np
import pytest

from baselines.models.edge_value import worth_of_lots
from baselines.self_tuning import SelfTuning
from turning_env import FamilyVectorEnv, Scenario
from turning_env.scenario.family import Family
from turning_env.scoring.family import play_family

SETTINGS = (1.0, 1.0, 1.0, 0.4, 0.8)
JOBS = [Family.load("shop").job(number).scenario.nominal() for number in range(2)]


@pytest.mark.slow
def test_jobs_played_together_are_those_played_alone() -> None:
    env, together = FamilyVectorEnv(2, context="hidden"), SelfTuning(JOBS, 2, *SETTINGS)
    alone = [SelfTuning(job, 1, *SETTINGS) for job in JOBS]
    observations, _ = env.reset(seed=0)
    for policy in (together, *alone):
        policy.reset(np.ones(len(policy._filter.mean), np.bool_))
    for step in range(60):
        actions = together.act(observations)
        for i, policy in enumerate(alone):
            np.testing.assert_array_equal(policy.act(observations[i : i + 1])[0], actions[i])
        if step % 20 == 19:
            actions[:, -1] = 1.0
        observations, *_ = env.step(actions)


@pytest.mark.slow
def test_a_slower_lot_makes_time_dearer() -> None:
    slow, nominal, fast = worth_of_lots(Scenario.load("shift"), 10.0, (0.5, 1.0, 2.0))
    assert slow.time > nominal.time > fast.time
    assert (slow.life <= nominal.life).all()
    assert (nominal.life <= fast.life).all()
    policy = SelfTuning(Scenario.load("shift"), 3, *SETTINGS)
    policy.reset(np.ones(3, np.bool_))
    policy._filter.mean[:, 5] += [-0.1, 0.0, 0.1]
    assert (np.diff(policy._price(np.full(3, 0.4))) > 0.0).all()


@pytest.mark.slow
def test_it_plays_a_family_whose_context_is_hidden() -> None:
    short = {"name": "short", "variables": {}, "fields": {"control.time_limit": 2.0, "sensors.inspects_edges": True}}
    family = Family.load(short)
    jobs = [family.job(number) for number in range(2)]
    scenarios = [job.scenario.nominal() for job in jobs]
    episodes = play_family(family, jobs, lambda num_envs: SelfTuning(scenarios, num_envs, *SETTINGS), 1, "hidden")
    assert (episodes["steps"] > 60).all()
