"""Families whose nominal models are true in some fields."""

import pickle

import pytest

from baselines.models.schedule import FORMS
from baselines.oracles.truthful import Truthful
from tests.turning_env.test_family_env import BRIEF_FAMILY as FAMILY
from turning_env import Family

SPLIT = "unseen_jobs"


@pytest.mark.slow
@pytest.mark.parametrize("true_fields", ["", "material.wear."], ids=["all laws", "wear law"])
def test_nominal_models_are_true_in_the_named_fields_and_the_process_is_the_same(
    true_fields: str,
) -> None:
    # Workers receive the family pickled.
    truthful = pickle.loads(pickle.dumps(Truthful.of(FAMILY, true_fields)))
    job = truthful.job(0, SPLIT)
    usual = FAMILY.job(0, SPLIT)
    true_material = usual.scenario.material
    usual_nominal = usual.scenario.nominal().material
    nominal = job.scenario.nominal().material
    assert job.scenario.material == true_material
    assert nominal.wear == true_material.wear != usual_nominal.wear
    expected_power = usual_nominal.power if true_fields else true_material.power
    assert nominal.power == expected_power
    assert (job.context != usual.context).any()


def test_nominal_models_with_true_forms_have_nothing_else_that_is_true() -> None:
    family = Family.load("unmodelled")
    true = family.job(0).scenario
    usual_nominal = true.nominal()
    nominal = Truthful.of(family, FORMS).job(0).scenario.nominal()
    assert nominal.edge_failure == true.edge_failure != usual_nominal.edge_failure
    assert nominal.machine.chatter == true.machine.chatter > 0.0
    assert nominal.material == usual_nominal.material != true.material
