"""The self-tuning optimiser plays jobs of a family, alone and together."""

import numpy as np
import pytest

from baselines import law_errors
from baselines.catalogue import spec
from baselines.models.schedule import FORMS, schedule
from baselines.predictive import SPEED_MARGIN
from baselines.self_tuning import SelfTuning
from leaderboard.family import Truthful
from turning_env import FamilyVectorEnv
from turning_env.scenario.family import Family
from turning_env.scoring.play import play, play_family

SETTINGS = {"severity": 1.0, "caution": 1.0, "wear_caution": 1.0}
JOBS = [Family.load("shop").job(number).scenario.nominal() for number in range(2)]


@pytest.mark.slow
def test_jobs_played_together_are_those_played_alone() -> None:
    env, together = FamilyVectorEnv(2, context="hidden"), SelfTuning(JOBS, 2, **SETTINGS)
    alone = [SelfTuning(job, 1, **SETTINGS) for job in JOBS]
    observations, _ = env.reset(seed=0)
    for policy in (together, *alone):
        policy.reset(np.ones(2 if policy is together else 1, np.bool_))
    for step in range(60):
        actions = together.act(observations)
        for i, policy in enumerate(alone):
            np.testing.assert_array_equal(policy.act(observations[i : i + 1])[0], actions[i])
        if step % 20 == 19:
            actions[:, -1] = 1.0
        observations, *_ = env.step(actions)


@pytest.mark.slow
def test_jobs_of_a_family_are_played_in_one_batch_or_one_by_one() -> None:
    fields = {
        "control.time_limit": 2.0,
        "sensors.inspects_edges": True,
        "material.power.coefficient": "0.3034 * hard",
    }
    hard = {
        "uniform": [0.8, 1.2],
        "unit": "-",
        "source": "test",
        "truth": {"log_normal": [1.1, 0.0]},
    }
    family = Family.load({"name": "short", "variables": {"hard": hard}, "fields": fields})
    for each in (family, Truthful.of(family)):
        jobs = [each.job(number) for number in range(2)]
        together = play_family(
            each,
            "train",
            range(2),
            spec("self_tuning", [job.scenario for job in jobs]).make,
            "hidden",
        )
        alone = [
            play(spec("self_tuning", job.scenario).make, job.scenario, [seed])
            for seed, job in enumerate(jobs)
        ]
        assert (together["steps"] > 60).all()
        for name, values in together.items():
            np.testing.assert_array_equal([played[name][0] for played in alone], values)
    assert [bool(job.scenario.nominal_model) for job in (family.job(0), jobs[0])] == [True, False]


@pytest.mark.slow
def test_a_rule_that_is_told_the_forms_of_a_lathe_keeps_to_their_schedule() -> None:
    told = Truthful.of(Family.load("unmodelled"), FORMS)
    models = [told.job(seed).scenario.nominal() for seed in (1, 2)]
    env, policy = FamilyVectorEnv(2, told, context="hidden"), SelfTuning(models, 2, **SETTINGS)
    observations, _ = env.reset(seed=1)
    policy.reset(np.ones(2, np.bool_))
    for _ in range(60):
        observations, *_, infos = env.step(policy.act(observations))
    fastest = SPEED_MARGIN * np.array([schedule(model).cutting_speed.max() for model in models])
    assert (infos["commanded_cutting_speed"] <= fastest * (1.0 + 1e-6)).all()
    assert (fastest < [model.machine.cutting_speed_max for model in models]).all()


def test_the_errors_that_ship_are_those_of_training_jobs():
    shipped, errors = law_errors.read(), law_errors.errors_of(Family.load("shop").draw("train", 0))
    spread = np.sqrt(np.diag(shipped.covariance))
    assert np.abs((errors.mean(axis=0) - shipped.mean) / spread).max() < 0.2
    assert np.abs(errors.std(axis=0) / spread - 1.0).max() < 0.2
