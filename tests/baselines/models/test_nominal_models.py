"""Nominal models side by side, and which environments play another job."""

from types import SimpleNamespace

import numpy as np
import pytest

from baselines.models.nominal_models import NominalModels, new_jobs, scenario_of, values_of
from tests.turning_env.playing import changed
from turning_env import FamilyVectorEnv, RoughTurningEnv, Scenario

OTHER = changed(Scenario(), limits={"power": 5.0}, machine={"feed_max": 0.5})


def test_each_environment_has_the_numbers_of_its_model() -> None:
    models = NominalModels([Scenario(), OTHER])
    assert models.entries == 11
    assert np.ravel(models.scenario.limits.power).tolist() == [Scenario().limits.power, 5.0]
    models.set(0, values_of(OTHER))
    assert np.ravel(models.scenario.limits.power).tolist() == [5.0, 5.0]
    assert np.ravel(models.scenario.machine.feed_max).tolist() == [0.5, 0.5]
    # The others keep theirs.
    models.set(1, values_of(changed(OTHER, limits={"power": 4.0})))
    assert np.ravel(models.scenario.limits.power).tolist() == [5.0, 4.0]


def test_choices_stay_those_that_all_environments_share() -> None:
    models = NominalModels([Scenario(), OTHER])
    models.set(0, values_of(changed(OTHER, spindle={"short_time_load": 1.2})))
    assert models.scenario.spindle.short_time_load == Scenario().spindle.short_time_load
    assert models.scenario.control.edge_changes == Scenario().control.edge_changes


def test_one_environment_has_a_model_of_its_own() -> None:
    models = NominalModels([OTHER])
    assert models.entries == 11
    assert np.ravel(models.scenario.limits.power).tolist() == [5.0]


def test_values_have_dotted_names() -> None:
    values = values_of(OTHER)
    assert values["limits.power"] == 5.0
    assert not [name for name in values if name.startswith("nominal_model")]
    assert "name" not in values


def test_the_scenario_is_that_below_the_wrappers() -> None:
    env = RoughTurningEnv(OTHER)
    assert scenario_of(env, "a loop") is env.scenario
    stranger = SimpleNamespace(unwrapped="CartPole")
    with pytest.raises(ValueError, match=r"a loop needs a RoughTurning environment.*CartPole"):
        scenario_of(stranger, "a loop")


@pytest.mark.parametrize(
    ("infos", "changed_envs", "present"),
    [
        pytest.param({"job": np.array([4, 9, 6])}, [1], [4, 9, 6], id="one of three"),
        pytest.param({"job": np.array([4, 5, 6])}, [], [4, 5, 6], id="none"),
        pytest.param(
            {"job": np.array([7, 8, 9]), "_job": np.array([True, False, True])},
            [0, 2],
            [7, 5, 9],
            id="a reset of some",
        ),
    ],
)
def test_jobs_that_have_changed_are_named(
    infos: dict[str, np.ndarray], changed_envs: list[int], present: list[int]
) -> None:
    jobs = np.array([4, 5, 6])
    assert new_jobs(FamilyVectorEnv(3), infos, jobs) == changed_envs
    assert jobs.tolist() == present


def test_an_environment_of_one_scenario_has_no_jobs() -> None:
    jobs = np.array([-1])
    assert new_jobs(RoughTurningEnv(), {}, jobs) == []
