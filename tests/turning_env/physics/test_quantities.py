"""The table of quantities, and what follows from it: records, resets, info, observations and the tables of the specification."""

import numpy as np
import pytest

from tests.turning_env.playing import fixed_actions, slightly_different, variants
from turning_env import RoughTurningEnv, Scenario, presets
from turning_env.info import INFO_KEYS
from turning_env.physics import quantities
from turning_env.physics.quantities import OBS, OBSERVATION, layout, observation_table
from turning_env.physics.records import PARAMETERS, parameter_records

# Read by what scores policies, and by what reads observations, not by the transition.
ELSEWHERE = {"limits.overload_allowance", "machine.rated_power"}


def test_no_configured_value_is_dead():
    nominal = parameter_records(Scenario()).tobytes()
    dead = {
        name for name, scenario in variants(Scenario(), slightly_different) if parameter_records(scenario).tobytes() == nominal
    }
    assert dead == ELSEWHERE


@pytest.mark.parametrize("preset", presets())
def test_a_parameter_that_is_a_field_of_the_scenario_is_taken_over(preset):
    scenario = Scenario.load(preset)
    record = parameter_records(scenario)[0]
    taken_over = {parameter.name for parameter in quantities.PARAMETERS if parameter.value is None}
    fields = [(name, value) for key, section in scenario if key not in ("name", "material") for name, value in section]
    assert {name: value for name, value in fields if name in taken_over} == {name: record[name] for name in taken_over}
    assert len([name for name, _ in fields if name in taken_over]) == len(taken_over)


@pytest.mark.parametrize("group", ["STATE", "WORK", "REPORT", "PARAMETERS", "OBSERVATION"])
def test_every_quantity_is_declared_once(group):
    names = [quantity.name for quantity in getattr(quantities, group)]
    assert len(names) == len(set(names))
    assert set(PARAMETERS.names) == {parameter.name for parameter in quantities.PARAMETERS}


@pytest.mark.parametrize("preset", presets())
def test_nothing_reported_is_left_of_the_step_before(preset):
    """Sums start with 0 at every step, and values at the end are written anew."""
    actions = fixed_actions(4, 1, preset)[:, 0]
    env, spoilt = RoughTurningEnv(preset), RoughTurningEnv(preset)
    for one in (env, spoilt):
        one.reset(seed=3)
    for action in actions:
        for name in ("report", "work"):
            for field in spoilt._batch._scratches[0].dtype[name].names:
                spoilt._batch._scratches[0][name][field] = 7.0
        assert spoilt.step(action)[1:] == env.step(action)[1:]


@pytest.mark.parametrize("preset", presets())
def test_layout_bounds_and_observations_agree(preset):
    env = RoughTurningEnv(preset)
    names = layout(env.scenario)
    entries = [OBSERVATION[getattr(OBS, name)] for name in names]
    assert env.observation_space.shape == (len(names),)
    assert env.observation_space.low.tolist() == [entry.low for entry in entries]
    assert env.observation_space.high.tolist() == [entry.high for entry in entries]
    assert list(names[: OBS.cutting + 1]) == [entry.name for entry in OBSERVATION[: OBS.cutting + 1]]
    observation, info = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    assert tuple(info) == INFO_KEYS


def test_both_optional_entries_have_places_of_their_own():
    assert layout(Scenario.load("surface"))[-1] == "roughness_reference"
    assert layout(Scenario.load("batch_casting"))[-1] == "probed_depth"
    batch = Scenario.load("batch_casting")
    both = batch.model_copy(update={"control": batch.control.model_copy(update={"aim": "roughness"})})
    assert layout(both)[-2:] == ("roughness_reference", "probed_depth")
    observation, _ = RoughTurningEnv(both).reset(seed=0)
    assert observation.shape == (13,)
    assert np.isfinite(observation).all()


def test_the_specification_has_the_table_of_the_observation():
    specification = "\n".join(line.strip() for line in (RoughTurningEnv.__doc__ or "").splitlines())
    assert observation_table(layout(Scenario())) in specification


def test_the_specification_names_every_entry_of_info():
    specification = RoughTurningEnv.__doc__ or ""
    assert [name for name in INFO_KEYS if f"`{name}`" not in specification and f"| {name} " not in specification] == []
