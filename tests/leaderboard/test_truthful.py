"""Policies on the jobs of a family."""

import pickle

import pytest

from leaderboard.family import Truthful
from tests.turning_env.test_family_env import BRIEF
from turning_env import Family

FAMILY = Family.load(BRIEF)


@pytest.mark.parametrize("right", ["", "material.wear."])
def test_nominal_models_are_right_in_the_named_fields_and_the_process_is_the_same(right: str):
    family = pickle.loads(pickle.dumps(Truthful.of(FAMILY, right)))
    told, usual = family.job(0, "unseen_jobs").scenario, FAMILY.job(0, "unseen_jobs").scenario
    assert told.material == usual.material
    assert told.nominal().material.wear == usual.material.wear != usual.nominal().material.wear
    power = usual.nominal().material.power if right else usual.material.power
    assert told.nominal().material.power == power
    assert (family.job(0, "unseen_jobs").context != FAMILY.job(0, "unseen_jobs").context).any()


def test_nominal_models_with_true_forms_have_nothing_else_that_is_true():
    family = Family.load("unmodelled")
    told, usual = (
        Truthful.of(family, ("edge_failure.", "machine.chatter")).job(0).scenario,
        family.job(0).scenario,
    )
    assert told.nominal().edge_failure == usual.edge_failure != usual.nominal().edge_failure
    assert told.nominal().machine.chatter == usual.machine.chatter > 0.0
    assert told.nominal().material == usual.nominal().material != usual.material
