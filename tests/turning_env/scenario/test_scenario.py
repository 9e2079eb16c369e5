"""What can be configured: refusal of nonsense, round trips, digests."""

import json
import math
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from tests.turning_env.playing import slightly_different, variants
from turning_env import IDS, PowerLaw, RoughTurningEnv, RoughTurningVectorEnv, Scenario, ScenarioError, presets
from turning_env.scenario.section import Section
from turning_env.scenario.sections import Control, Machine, Material, Tool

PRESETS = (
    *("batch_casting", "batch_forging", "batch_rolled", "batch_welded", "casting", "ck45", "forging", "forging_skin"),
    *("harder_lot", "override", "override_current", "paper", "rolled", "rough_turning", "rough_turning_current"),
    *("sensor_bias", "shift", "small_diameter", "surface", "welded", "worn_lot"),
)


def numeric_fields() -> Iterator[tuple[type[Section], str, Any]]:
    """Every quantity of a scenario with its declaration: section, name, field."""
    sections = [type(value) for value in dict(Scenario()).values() if isinstance(value, Section)]
    for section in [*sections, PowerLaw]:
        for name, field in section.model_fields.items():
            if field.annotation in (float, int):
                yield section, name, field


@pytest.fixture
def toml(tmp_path):
    """Load a scenario from TOML text."""

    def load(text: str | bytes) -> Scenario:
        path = tmp_path / "mine.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return Scenario.load(path)

    return load


def test_presets_are_found_and_named_after_their_files():
    assert presets() == PRESETS
    for preset in PRESETS:
        assert Scenario.load(preset).name == preset
    assert set(IDS.values()) <= set(PRESETS)


def test_the_main_preset_is_the_default():
    assert Scenario.load("rough_turning") == Scenario()
    assert Scenario.load("rough_turning").digest() == Scenario().digest()


def test_a_scenario_loads_as_itself():
    scenario = Scenario(name="mine")
    assert Scenario.load(scenario) is scenario


def test_a_file_states_only_what_differs(toml):
    scenario = toml("[limits]\npower = 9\n")
    assert scenario.limits.power == 9
    assert scenario.model_copy(update={"limits": Scenario().limits}).digest() == Scenario().digest()


def test_a_file_states_only_what_differs_from_its_base(toml):
    base = Scenario.load("override_current")
    scenario = toml("base = 'override_current'\n[material.power]\nfeed = 0.7\n[workpiece]\ndepth_profile = [1.5]\n")
    power = base.material.power.model_copy(update={"feed": 0.7})
    workpiece = base.workpiece.model_copy(update={"depth_profile": (1.5,)})
    material = base.material.model_copy(update={"power": power})
    assert scenario == base.model_copy(update={"name": "mine", "material": material, "workpiece": workpiece})
    assert tomllib.loads(scenario.to_toml()).keys() == Scenario.model_fields.keys()


def test_presets_based_on_one_another_in_a_circle_are_refused(toml, tmp_path, monkeypatch):
    monkeypatch.setattr("turning_env.scenario._PRESETS", tmp_path)
    for name, base in (("one", "two"), ("two", "three"), ("three", "one")):
        (tmp_path / f"{name}.toml").write_text(f"base = '{base}'\n")
    for load in (lambda: Scenario.load("one"), lambda: toml("base = 'one'\n")):
        with pytest.raises(ScenarioError, match="in a circle: one on two on three on one"):
            load()


@pytest.mark.parametrize("preset", PRESETS)
def test_round_trip_through_toml(preset, tmp_path):
    scenario = Scenario.load(preset)
    scenario.save(tmp_path / "copy.toml")
    assert Scenario.load(tmp_path / "copy.toml") == scenario
    assert Scenario.load(str(tmp_path / "copy.toml")).digest() == scenario.digest()


@pytest.mark.parametrize("failing", ["write_text", "replace"])
def test_saving_is_all_or_nothing(tmp_path, monkeypatch, failing):
    path = tmp_path / "mine.toml"
    Scenario(name="before").save(path)

    def fail(*_: Any, **__: Any) -> None:
        raise OSError("disk full")

    with monkeypatch.context() as patch:
        patch.setattr(Path, failing, fail)
        with pytest.raises(OSError, match="disk full"):
            Scenario(name="after").save(path)
    assert Scenario.load(path).name == "before"
    assert [entry.name for entry in tmp_path.iterdir()] == ["mine.toml"]


def test_digest_ignores_the_name_and_nothing_else():
    assert Scenario(name="other").digest() == Scenario().digest()
    digests = {name: scenario.digest() for name, scenario in variants(Scenario(), slightly_different)}
    assert len(digests) > 60
    assert len({Scenario().digest(), *digests.values()}) == 1 + len(digests)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[tol]\n", ["unknown key tol", "allowed are name, material, tool, machine"]),
        ("[tool]\nwear_criterium = 1\n", ["tool: unknown key wear_criterium", "allowed are wear_criterion, wear_rule"]),
        ("[material.wear]\ncoefficient = 1\nspeed = 2\n", ["material.wear: unknown key speed", "cutting_speed"]),
        ("[limits]\npower = -3\n", ["limits.power", "-3", "0.001 to 10000", "kW"]),
        ("[limits]\npower = nan\n", ["limits.power", "nan"]),
        ("[limits]\npower = inf\n", ["limits.power", "inf"]),
        ("[limits]\npower = '7'\n", ["limits.power", "'7'"]),
        ("[limits]\npower = true\n", ["limits.power", "True"]),
        ("[control]\nsub_steps = 1.5\n", ["control.sub_steps", "1.5"]),
        ("[control]\naction = 'steps'\n", ["control.action", "steps", "'incremental', 'set_point', 'override' or 'part'"]),
        ("[material.wear]\nfeed = 0.1\n", ["material.wear.coefficient", "required"]),
        ("tool = 3\n", ["tool", "3"]),
        ("[machine]\nfeed_min = 1\n", ["machine", "feed_min is 1.0", "below feed_max", "0.6"]),
        ("[control]\ninitial_feed = 5\n", ["control.initial_feed is 5.0", "0.06 to 0.6"]),
        ("[control]\ninterval = 3600\ntime_limit = 1\n", ["time_limit is 1.0 min", "3600.0 s"]),
        ("[material.wear]\ncoefficient = 1\n", ["wear.time is 0.0", "above 0"]),
        ("[material.wear]\ncoefficient = 1\ntime = 1\nwear = 1\n", ["wear.wear is 1.0", "only 0"]),
        ("[material.power]\ncoefficient = 1\ntime = 1\n", ["power.time is 1.0", "only 0"]),
        ("[mismatch]\ninitial_wear = 0.3\n", ["mismatch.initial_wear is 0.3", "below tool.wear_criterion, which is 0.3"]),
        ("base = 'forgings'\n", ["base: 'forgings' is not a preset; presets: batch_casting, "]),
        ("base = 3\n", ["base: 3 is not a preset"]),
        ("base = 'casting'\n[workpiece]\nlength = 3\n", ["workpiece: unknown key length"]),
        ("base = 'casting'\ntool = 3\n", ["tool", "3"]),
        ("name = '../up'\n", ["name: '../up' is not allowed", "1 to 64"]),
        ("not toml", ["is not TOML"]),
        (b"name = '\xff'", ["is not TOML"]),
    ],
)
def test_bad_files_are_refused_with_field_value_and_what_is_allowed(toml, text, said):
    with pytest.raises(ScenarioError) as refusal:
        toml(text)
    message = str(refusal.value)
    assert "mine.toml" in message
    for part in said:
        assert part in message


@pytest.mark.parametrize("name", ["a", "En-19", "v1.2_b", "-", "_", "x" * 64])
def test_names_that_name_a_folder_are_taken(name):
    assert Scenario(name=name).name == name


@pytest.mark.parametrize("name", ["", ".", "..", ".hidden", "a/b", "a\\b", "a b", "a\n", "\0", "Stück", "x" * 65])
def test_names_that_are_no_folder_s_are_refused(name):
    with pytest.raises(ValidationError) as refusal:
        Scenario(name=name)
    assert f"{name!r} is not allowed" in str(refusal.value)
    assert "1 to 64 of the characters A-Z, a-z, 0-9" in str(refusal.value)


def test_all_complaints_come_at_once(toml):
    with pytest.raises(ScenarioError, match=r"tool\.wear_criterion: .*; limits\.power: "):
        toml("[tool]\nwear_criterion = 9\n[limits]\npower = 0\n")


@pytest.mark.parametrize("section", [Scenario, Tool, Machine, Control, Material])
def test_constructors_refuse_unknown_keys_and_name_the_allowed_ones(section):
    with pytest.raises(ValidationError) as refusal:
        section(wear_criterium=1)
    assert f"unknown key wear_criterium; allowed are {', '.join(section.model_fields)}" in str(refusal.value)


@pytest.mark.parametrize(
    ("section", "name", "field"), [pytest.param(*row, id=f"{row[0].__name__}.{row[1]}") for row in numeric_fields()]
)
def test_every_quantity_has_unit_and_range_and_keeps_to_it(section, name, field):
    low, high = field.json_schema_extra["minimum"], field.json_schema_extra["maximum"]
    assert field.description.endswith(f"[{field.json_schema_extra['unit']}]")
    for outside in (math.nextafter(low, -math.inf), math.nextafter(high, math.inf)):
        value = math.floor(outside) if field.annotation is int and outside < low else outside
        value = math.ceil(outside) if field.annotation is int and outside > high else value
        with pytest.raises(ValidationError, match=name) as refusal:
            section(**({"coefficient": 1.0} if section is PowerLaw else {}) | {name: value})
        assert f"{low} to {high} {field.json_schema_extra['unit']}" in str(refusal.value)


def test_the_json_schema_carries_units_and_ranges():
    schema = json.loads(json.dumps(Scenario.model_json_schema()))
    wear_criterion = schema["$defs"]["Tool"]["properties"]["wear_criterion"]
    assert {"unit": "mm", "minimum": 0.01, "maximum": 5, "default": 0.3}.items() <= wear_criterion.items()
    for section in schema["$defs"].values():
        assert section["additionalProperties"] is False
        for name, entry in section["properties"].items():
            assert entry.get("type") not in ("number", "integer") or {"unit", "minimum", "maximum"} <= entry.keys(), name


def test_scenarios_cannot_be_changed_in_place():
    with pytest.raises(ValidationError, match="frozen"):
        Scenario().limits.power = 9.0  # type: ignore[misc]


@pytest.mark.parametrize("make", [Scenario.load, RoughTurningEnv, lambda source: RoughTurningVectorEnv(1, source)])
def test_unknown_presets_are_refused_with_those_there_are(make):
    with pytest.raises(ScenarioError, match=f"'forgings'; presets: {', '.join(PRESETS)}"):
        make("forgings")
    with pytest.raises(TypeError, match="not dict"):
        make({})


def test_a_file_without_a_name_is_called_as_the_file_is(tmp_path):
    path = tmp_path / "lathe_7.toml"
    path.write_text("[limits]\npower = 9.0\n")
    assert Scenario.load(path).name == "lathe_7"
    path.write_text('name = "seven"\n')
    assert Scenario.load(path).name == "seven"
