"""Policies on the jobs of a family."""

import pickle

import numpy as np
import pytest

from tests.turning_env.test_family_env import BRIEF
from turning_env import Family
from turning_env.scoring.family import play_family, play_jobs, truthful
from turning_env.scoring.policy import Policy

FAMILY = Family.load(BRIEF)


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


@pytest.mark.parametrize("right", ["", "material.wear."])
def test_nominal_models_are_right_in_the_named_fields_and_the_process_is_the_same(right: str):
    family = pickle.loads(pickle.dumps(truthful(FAMILY, right)))
    told, usual = family.job(0, "unseen_jobs").scenario, FAMILY.job(0, "unseen_jobs").scenario
    assert told.material == usual.material
    assert told.nominal().material.wear == usual.material.wear != usual.nominal().material.wear
    power = usual.nominal().material.power if right else usual.material.power
    assert told.nominal().material.power == power
    assert (family.job(0, "unseen_jobs").context != FAMILY.job(0, "unseen_jobs").context).any()
