"""The self-tuning optimiser plays jobs of a family, alone and together, and prices its lot."""

import numpy as np
import pytest

from baselines.catalogue import spec
from baselines.models.edge_value import worth_of_lots
from baselines.models.kalman_steps import LOT
from baselines.self_tuning import SelfTuning
from turning_env import FamilyVectorEnv, Scenario
from turning_env.scenario.family import Family
from turning_env.scoring.family import play_family, play_jobs, truthful

SETTINGS = (1.0, 1.0, 1.0, 1.0, 0.4, 0.8)
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
    assert worth_of_lots(Scenario.load("shift"), 10.0, (50.0,))[0].time == 0.0  # an edge does not pay for itself
    assert (slow.life <= nominal.life).all()
    assert (nominal.life <= fast.life).all()
    policy = SelfTuning(Scenario.load("shift"), 3, *SETTINGS)
    policy.reset(np.ones(3, np.bool_))
    policy._filter.mean[:, LOT] += [-0.1, 0.0, 0.1]
    assert (np.diff(policy._price(np.full(3, 0.4))) > 0.0).all()


@pytest.mark.slow
def test_jobs_of_a_family_are_played_in_one_batch_or_one_by_one() -> None:
    fields = {"control.time_limit": 2.0, "sensors.inspects_edges": True, "material.power.coefficient": "0.3034 * hard"}
    hard = {"uniform": [0.8, 1.2], "unit": "-", "source": "test", "truth": {"log_normal": [1.1, 0.0]}}
    family = Family.load({"name": "short", "variables": {"hard": hard}, "fields": fields})
    for each in (family, truthful(family)):
        jobs = [each.job(number) for number in range(2)]
        together = play_family(each, "train", range(2), spec("self_tuning", [job.scenario for job in jobs]).make, "hidden")
        alone = play_jobs(each, "train", range(2), lambda job: spec("self_tuning", job.scenario).make)
        assert (together["steps"] > 60).all()
        for name, values in alone.items():
            np.testing.assert_array_equal(values, together[name])
    assert [bool(job.scenario.nominal_model) for job in (family.job(0), jobs[0])] == [True, False]


def test_a_rule_for_one_scenario_refuses_several() -> None:
    with pytest.raises(ValueError, match="one scenario at a time"):
        spec("fixed_tuned", [Scenario(), Scenario()])
