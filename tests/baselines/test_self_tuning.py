"""The self-tuning optimiser plays jobs of a family, one by one and in a batch."""

import numpy as np
import pytest

from baselines import law_errors
from baselines.catalogue import spec
from baselines.models.schedule import FORMS, schedule
from baselines.oracles.truthful import Truthful
from baselines.predictive import SPEED_MARGIN
from baselines.self_tuning import SelfTuning
from leaderboard.play import play, play_family
from turning_env import FamilyVectorEnv
from turning_env.scenario.family import Family

SETTINGS = {"severity": 1.0, "caution": 1.0, "wear_caution": 1.0}
JOBS = [Family.load("shop").job(number).scenario.nominal() for number in range(2)]


@pytest.mark.slow
def test_a_batch_of_jobs_acts_as_its_jobs_one_by_one() -> None:
    env = FamilyVectorEnv(2, context="hidden")
    batch = SelfTuning(JOBS, 2, **SETTINGS)
    batch.reset(np.ones(2, np.bool_))
    singles = [SelfTuning(job, 1, **SETTINGS) for job in JOBS]
    for policy in singles:
        policy.reset(np.ones(1, np.bool_))
    observations, _ = env.reset(seed=0)
    for step in range(60):
        actions = batch.act(observations)
        for index, policy in enumerate(singles):
            single_action = policy.act(observations[[index]])[0]
            np.testing.assert_array_equal(single_action, actions[index])
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
    for played_family in (family, Truthful.of(family)):
        jobs = [played_family.job(number) for number in range(2)]
        make = spec("self_tuning", [job.scenario for job in jobs]).make
        batch = play_family(
            played_family, "train", seeds=range(2), make_policy=make, context="hidden"
        )
        singles = []
        for seed, job in enumerate(jobs):
            singles.append(play(spec("self_tuning", job.scenario).make, job.scenario, [seed]))
        assert (batch["steps"] > 60).all()
        for name, values in batch.items():
            np.testing.assert_array_equal([single[name][0] for single in singles], values)
    # Where the nominal laws are the true ones, a job has no nominal model beside them.
    assert family.job(0).scenario.nominal_model
    assert not jobs[0].scenario.nominal_model


@pytest.mark.slow
def test_a_rule_with_the_true_forms_of_a_lathe_keeps_to_their_schedule() -> None:
    family = Truthful.of(Family.load("unmodelled"), FORMS)
    models = [family.job(seed).scenario.nominal() for seed in (1, 2)]
    env = FamilyVectorEnv(2, family, context="hidden")
    policy = SelfTuning(models, 2, **SETTINGS)
    observations, _ = env.reset(seed=1)
    policy.reset(np.ones(2, np.bool_))
    for _ in range(60):
        observations, *_, infos = env.step(policy.act(observations))
    for index, model in enumerate(models):
        fastest = SPEED_MARGIN * schedule(model).cutting_speed.max()
        assert infos["commanded_cutting_speed"][index] <= fastest * (1.0 + 1e-6)
        # So the schedule limits the speed, not the machine.
        assert fastest < model.machine.cutting_speed_max


def test_the_errors_that_ship_are_those_of_training_jobs():
    shipped = law_errors.read()
    errors = law_errors.errors_of(Family.load("shop").draw("train", 0))
    spread = np.sqrt(np.diag(shipped.covariance))
    difference = (errors.mean(axis=0) - shipped.mean) / spread
    ratio = errors.std(axis=0) / spread
    assert np.abs(difference).max() < 0.2
    assert np.abs(ratio - 1.0).max() < 0.2
