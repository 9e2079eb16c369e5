"""Policies on the jobs of a family."""

import pickle

import numpy as np
import pytest

from tests.turning_env.test_family_env import BRIEF
from turning_env import Family
from turning_env.scenario.family import CHUNK
from turning_env.scoring.family import play_family, play_jobs, truthful
from turning_env.scoring.policy import Policy

FAMILY = Family.load(BRIEF)
JOBS = [FAMILY.job(number, "unseen_jobs") for number in range(2)]


class Still(Policy):
    """Changes nothing."""

    def act(self, observations):
        return np.full((len(observations), 3), [0.0, 0.0, -1.0], np.float32)


def test_a_policy_for_each_job_and_one_for_all_play_the_same_episodes():
    apart = play_jobs(FAMILY, "unseen_jobs", range(4), lambda job: lambda num_envs: Still())
    together = play_family(FAMILY, "unseen_jobs", range(4), lambda num_envs: Still())
    for name, values in apart.items():
        assert values.shape == (4,)
        assert np.array_equal(values, together[name]), name


def test_told_the_truth_nothing_is_wrong_but_the_process_is_the_same():
    told = truthful(FAMILY).job(0, "unseen_jobs").scenario
    assert told.nominal().material == told.material == JOBS[0].scenario.material


def test_told_the_wear_only_that_law_is_right():
    told, usual = truthful(FAMILY, "material.wear.").job(0, "unseen_jobs").scenario, JOBS[0].scenario
    assert told.material == usual.material
    assert told.nominal().material.wear == usual.material.wear != usual.nominal().material.wear
    assert told.nominal().material.power == usual.nominal().material.power != usual.material.power


def test_a_share_of_the_errors_remains_chunk_by_chunk():
    shop = Family.load("shop")
    family = pickle.loads(pickle.dumps(truthful(shop, errors=(1.0, 0.25))))
    assert family.error(np.array([0, CHUNK - 1, CHUNK, 2 * CHUNK])).tolist() == [1.0, 1.0, 0.25, 1.0]
    assert family.job(0).scenario.nominal() == shop.job(0).scenario.nominal()
    np.testing.assert_array_equal(family.job(0).context, shop.job(0).context)
    told, usual = family.job(CHUNK), shop.job(CHUNK)
    assert told.scenario.material == usual.scenario.material
    for law, field in (("power", "coefficient"), ("wear", "cutting_speed"), ("thrust_force", "wear")):
        true, nominal, less_wrong = (
            getattr(getattr(each.material, law), field)
            for each in (usual.scenario, usual.scenario.nominal(), told.scenario.nominal())
        )
        assert less_wrong - true == pytest.approx(0.25 * (nominal - true))
    assert np.abs(told.context - usual.context).max() > 0.01


@pytest.mark.parametrize("errors", [(), (0.5, 1.5), (-0.1,), (float("nan"),)])
def test_errors_are_shares(errors):
    with pytest.raises(ValueError, match="from 0 to 1"):
        truthful(FAMILY, errors=errors)
