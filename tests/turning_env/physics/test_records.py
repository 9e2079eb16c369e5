"""The records: rows of tables, parameters of one scenario and of a batch."""

import numpy as np
import pytest

from tests.turning_env.physics.one_env import ENV
from tests.turning_env.playing import changed
from turning_env import Scenario
from turning_env.physics.parameters import FURTHER_LAW_RECORD, PARAMETERS
from turning_env.physics.quantities import WIDTH
from turning_env.physics.records import (
    REPORT,
    SHARED_PARAMETERS,
    STATE,
    block_records,
    new_records,
    numbers_of,
    parameter_records,
    row_of,
)

FRESH = changed(
    Scenario(),
    material={"power": Scenario().material.power.model_dump() | {"wear": 1, "wear_growth": 2.0}},
)


@pytest.mark.parametrize("dtype", [STATE, REPORT])
def test_the_table_overlaps_the_fields_row_by_row(dtype):
    (record,) = new_records(dtype, 1)
    assert dtype["table"].shape[0] * WIDTH * 8 == dtype.itemsize
    for name in dtype.names[:-1]:
        if dtype[name].base == np.float64:
            record[name][...] = 7.5
            rows = 1 if dtype[name].shape == (WIDTH,) else dtype[name].shape[0]
            first = row_of(dtype, name)
            assert (record.table[first : first + rows] == 7.5).all()
            assert (record.table == 7.5).sum() == rows * WIDTH
            record[name][...] = 0.0


def test_all_environments_of_a_scenario_have_its_parameters():
    scenario = changed(Scenario(), workpiece={"depth_profile": (1.0, 2.0, 3.0)})
    records = parameter_records(scenario, 2 * WIDTH)
    assert len(records) == 2
    assert (records["feed_max"] == scenario.machine.feed_max).all()
    assert (records["force_law"]["feed"] == scenario.material.thrust_force.feed).all()
    # What a scenario has no value for stays 0.
    assert records["depth_profile"][1].tolist() == [1.0, 2.0, 3.0, *[0.0] * 61]
    assert records["depth_sections"].tolist() == [3, 3]


def test_the_nominal_model_is_the_scenarios_own_unless_another_is_given():
    mistaken = Scenario.model_validate(
        Scenario().model_dump() | {"nominal_model": {"material": FRESH.material.model_dump()}}
    )
    own = parameter_records(mistaken)[0]
    given = parameter_records(Scenario(), nominal=FRESH)[0]
    for records in (own, given):
        assert records.power_law.wear_growth[ENV] == 0.0
        assert records.nominal.power_law.wear_growth[ENV] == 2.0
        # One flag serves both models.
        assert records.fresh_edges_load
    assert not parameter_records(Scenario())[0].fresh_edges_load
    assert parameter_records(FRESH, nominal=Scenario())[0].fresh_edges_load


def test_numbers_in_which_environments_differ_come_first():
    records = parameter_records(Scenario())
    numbers = numbers_of(records)
    laws = {name for name in records.dtype.names if records.dtype[name].names}
    before = records["feed_max"][0, ENV]
    place = records.dtype.fields["feed_max"][1] // (8 * WIDTH)
    assert numbers[0, place, ENV] == before
    numbers[0, place, ENV] = 9.0
    assert records["feed_max"][0, ENV] == 9.0
    assert numbers.shape[::2] == (1, WIDTH)
    assert numbers.nbytes == min(records.dtype.fields[name][1] for name in SHARED_PARAMETERS)
    assert "nominal" in laws


def test_shared_parameters_are_flags_whole_numbers_and_arrays():
    shared = {"wear_rule", "sub_steps", "collapses", "depth_profile", "observation_layout"}
    assert shared < set(SHARED_PARAMETERS)
    own = {"feed_max", "wear_law", "sub_step", "edge_price"}
    assert own.isdisjoint(SHARED_PARAMETERS)
    further = next(line for line in PARAMETERS if line.name == "further_laws")
    assert further.dtype == FURTHER_LAW_RECORD
    assert not further.per_env


def test_a_block_has_a_record_of_each_kind():
    block = block_records(Scenario())
    assert (len(block.states), len(block.parameters), len(block.scratches)) == (1, 1, 1)
    assert not block.states[0].table.any()
