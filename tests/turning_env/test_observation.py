"""Observations, and readings recovered from them."""

from contextlib import suppress
from functools import cache

import numpy as np
import pytest
from pydantic import ValidationError

from tests.turning_env.playing import NO_SPREAD, changed, fixed_actions, play
from turning_env import IDS, Family, RoughTurningEnv, Scenario, read
from turning_env.batch.driver import start_episodes
from turning_env.physics.quantities import OBS, OBSERVATION, REPORT, WIDTH, Entry, layout
from turning_env.physics.records import block_records
from turning_env.scenario.family import families
from turning_env.scenario.sections import Sensors


@cache
def scenarios() -> list[Scenario]:
    """Return scenarios that together have every entry.

    They are those of ids and families, and the default one with each further sensor.
    """
    loaded = [Scenario.load(preset) for preset in IDS.values()]
    loaded += [Family.load(name).job(0).scenario for name in families()]
    loaded.append(changed(Scenario(), spindle={"short_time_load": 1.5}))
    for name, field in Sensors.model_fields.items():
        if field.annotation is bool:
            with suppress(ValidationError):  # a probe needs parts
                loaded.append(changed(Scenario(), sensors={name: True}))
    return loaded


@pytest.mark.parametrize("entry", OBSERVATION, ids=lambda entry: entry.name)
def test_every_entry_of_the_table_is_written(entry: Entry) -> None:
    having = [scenario for scenario in scenarios() if entry.present(scenario)]
    assert having, f"no scenario has {entry.name}: add one to scenarios()"
    scenario = having[0]
    states, parameters, scratches = block_records(scenario)
    # Whatever nobody writes stays NaN, also if its value would never change.
    scratches["work"]["observation"] = np.nan
    observations = np.zeros((WIDTH, len(layout(scenario))), np.float32)
    table = np.zeros((len(REPORT), WIDTH))
    chosen = np.ones(WIDTH, np.bool_)
    start_episodes(states, parameters, scratches, chosen, observations, table)
    place = layout(scenario).index(entry.name)
    written = np.isfinite(observations[:, place])
    assert written.all(), f"nothing writes OBS.{entry.name}: see turning_env/observation.py"


def test_reading_turns_observations_back_into_physical_units():
    record = play(RoughTurningEnv(), 3, fixed_actions(300, 1)[:, 0])
    reading = read(record["observation"], Scenario())
    for name in (
        "cutting_speed",
        "feed",
        "commanded_cutting_speed",
        "commanded_feed",
        "cutting_time",
    ):
        assert getattr(reading, name) == pytest.approx(record[name], rel=1e-5, abs=1e-5), name
    measured_force = record["measured_thrust_force"]
    assert reading.power == pytest.approx(record["measured_power"], rel=1e-5, abs=1e-5)
    assert reading.thrust_force == pytest.approx(measured_force, rel=1e-5, abs=1e-3)
    assert np.array_equal(reading.cutting, record["cutting"])


def test_true_wear_hardness_and_depth_show_in_power_and_force_alone():
    varied = changed(Scenario(), tool={"edge_strength": 1e6, "wear_criterion": 5})
    uniform = changed(varied, tool={"wear_factor_spread": 0}, workpiece=NO_SPREAD)
    actions = fixed_actions(100, 1)[:, 0]
    record = play(RoughTurningEnv(varied), 4, actions)
    uniform_record = play(RoughTurningEnv(uniform), 4, actions)
    assert record["wear"][-1] != pytest.approx(uniform_record["wear"][-1], rel=0.01)
    differing = (record["observation"] != uniform_record["observation"]).any(axis=0)
    assert np.flatnonzero(differing).tolist() == [
        OBS.power,
        OBS.thrust_force,
        OBS.power_ratio,
        OBS.force_ratio,
    ]


OBSERVES_ALL = changed(Scenario(), sensors={"observes_all": True})


@pytest.fixture(scope="module")
def observed_all():
    """The record of a lathe that observes all, in air and in metal."""
    return play(RoughTurningEnv(OBSERVES_ALL), 4, fixed_actions(100, 1)[:, 0])


def shown(record, name):
    """Return an entry of the observations of a record, shape (steps,)."""
    entry = layout(OBSERVES_ALL).index(name)
    return record["observation"][:, entry].astype(float)


def test_a_lathe_that_observes_all_is_otherwise_the_same(observed_all):
    plain_record = play(RoughTurningEnv(), 4, fixed_actions(100, 1)[:, 0])
    entries = plain_record["observation"].shape[1]
    assert np.array_equal(observed_all["observation"][:, :entries], plain_record["observation"])


def test_hardness_and_depth_are_observed_in_metal_if_asked_for(observed_all):
    in_metal = observed_all["cutting"]
    assert 0 < in_metal.sum() < len(in_metal)
    nominal_depth = OBSERVES_ALL.workpiece.depth_of_cut
    ratios = {
        "hardness": observed_all["hardness"],
        "depth_of_cut": observed_all["depth_of_cut"] / nominal_depth,
    }
    for name, ratio in ratios.items():
        entry = shown(observed_all, name)
        expected = 5 * (ratio - 1)
        assert entry[in_metal] == pytest.approx(expected[in_metal], abs=1e-5)
        assert not entry[~in_metal].any()


def test_the_state_of_the_edge_is_observed_if_asked_for(observed_all):
    wear = observed_all["wear"] / OBSERVES_ALL.tool.wear_criterion
    wear_factor = observed_all["wear_factor"]
    strength = observed_all["edge_strength"] / OBSERVES_ALL.limits.thrust_force
    assert shown(observed_all, "wear") == pytest.approx(wear, abs=1e-6)
    assert shown(observed_all, "wear_factor") == pytest.approx(5 * (wear_factor - 1), abs=1e-5)
    assert shown(observed_all, "edge_strength") == pytest.approx(5 * (strength - 1), abs=1e-5)
