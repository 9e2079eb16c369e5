"""Scenario files: what is read, refused, written and identified."""

import re
from operator import attrgetter

import pytest

from tests.turning_env.playing import slightly_different, variants
from turning_env import (
    Family,
    RoughTurningEnv,
    RoughTurningVectorEnv,
    Scenario,
    ScenarioError,
    presets,
)
from turning_env.physics.quantities import layout
from turning_env.scenario.scenario import nested

BEYOND = "coefficient = 1e12\ncutting_speed = 10\nwear = -10\n"
"""A law whose numbers cannot be represented within a machine's ranges."""


@pytest.fixture
def toml(tmp_path):
    """Load a scenario from TOML text."""

    def load(text: str | bytes) -> Scenario:
        path = tmp_path / "mine.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return Scenario.load(path)

    return load


@pytest.mark.parametrize("preset", presets())
def test_round_trip_through_toml(preset, tmp_path):
    scenario = Scenario.load(preset)
    assert scenario.name == preset
    scenario.save(tmp_path / "copy.toml")
    assert Scenario.load(tmp_path / "copy.toml") == scenario
    assert Scenario.load(str(tmp_path / "copy.toml")).digest() == scenario.digest()


def test_digest_ignores_the_name_and_nothing_else():
    assert Scenario(name="other").digest() == Scenario().digest()
    digests = {}
    for name, scenario in variants(Scenario(), slightly_different):
        digests[name] = scenario.digest()
    assert len(digests) > 60
    assert len({Scenario().digest(), *digests.values()}) == 1 + len(digests)


def test_a_nominal_model_cannot_have_other_observations_than_its_scenario():
    refused = set()
    for name, scenario in variants(Scenario(), slightly_different):
        if layout(scenario) != layout(Scenario()):
            refused.add(name)
            nominal_model = nested([(name, attrgetter(name)(scenario))])
            with pytest.raises(ScenarioError, match=f"the control always knows {name}"):
                Scenario.load({"nominal_model": nominal_model})
    assert {"control.aim", "spindle.short_time_load", "sensors.observes_all"} <= refused


REFUSED = {
    "unknown section": (
        "[quux]\n",
        ["mine.toml: unknown key quux; list all with: python -m turning_env show --schema"],
    ),
    "unknown field": (
        "[tool]\nwear_criterium = 1\n",
        ["tool: unknown key wear_criterium; did you mean wear_criterion?"],
    ),
    "out of range": (
        "[limits]\npower = -3\n",
        ["limits.power", "-3", "0.001 to 10000", "kW"],
    ),
    "not a number": (
        "[limits]\npower = nan\n",
        ["limits.power", "nan"],
    ),
    "not a whole number": (
        "[control]\nsub_steps = 1.5\n",
        ["control.sub_steps", "1.5"],
    ),
    "no such choice": (
        "[control]\naction = 'steps'\n",
        ["control.action", "steps", "'incremental', 'set_point', 'override' or 'part'"],
    ),
    "missing coefficient": (
        "[material.wear]\nfeed = 0.1\n",
        ["material.wear.coefficient", "required"],
    ),
    "lowest above highest": (
        "[machine]\nfeed_min = 1\n",
        ["machine", "feed_min is 1.0", "not exceed feed_max", "0.6"],
    ),
    "start outside the machine": (
        "[control]\ninitial_feed = 5\n",
        ["control.initial_feed is 5.0", "0.06 to 0.6"],
    ),
    "episode shorter than a step": (
        "[control]\ninterval = 3600\ntime_limit = 1\n",
        ["time_limit is 1.0 min", "3600.0 s"],
    ),
    "wear without time": (
        "[material.wear]\ncoefficient = 1\n",
        ["wear.time is 0.0", "above 0"],
    ),
    "wear too fast": (
        "[material.wear]\ntime = 0.01\ncoefficient = 1e12\n",
        ["material.wear comes to 1e"],
    ),
    "responses too large": (
        f"[material.thrust_force]\n{BEYOND}[material.power]\n{BEYOND}",
        ["thrust_force comes to 1e", "power comes to 1e", "within"],
    ),
    "too few section lengths": (
        "[workpiece]\ndepth_profile = [1, 2]\nsection_lengths = [300]\n",
        ["section_lengths"],
    ),
    "section lengths of another bar": (
        "[workpiece]\ndepth_profile = [1, 2]\nsection_lengths = [100, 100]\n",
        ["bar_length"],
    ),
    "air without lengths": (
        "[workpiece]\ndepth_profile = [1, 0]\n",
        ["air"],
    ),
    "too few section speeds": (
        "[workpiece]\ndepth_profile = [1, 2]\nsection_speeds = [100]\n",
        ["section_speeds"],
    ),
    "edges worn out from the start": (
        "[mismatch]\ninitial_wear = 0.3\n",
        ["mismatch.initial_wear is 0.3", "below tool.wear_criterion, which is 0.3"],
    ),
    "unknown base": (
        "base = 'forgings'\n",
        ["base: 'forgings' is neither a preset nor a TOML file; did you mean forging"],
    ),
    "missing base": (
        "base = 'none.toml'\n",
        ["mine.toml: base: no preset and no file is called", "none.toml"],
    ),
    "decimal comma": (
        "[limits]\npower = 0,5\n",
        ["is not TOML", "line 2", 'numbers have a decimal point: "0.5"'],
    ),
    "name of another folder": (
        "name = '../up'\n",
        ["name: '../up' is not allowed", "1 to 64"],
    ),
    "two faults": (
        "[tool]\nwear_criterion = 9\n[limits]\npower = 0\n",
        ["tool.wear_criterion: ", "; limits.power: "],
    ),
}
"""Texts of files, and parts of the message that refuses them."""


@pytest.mark.parametrize("case", REFUSED)
def test_bad_files_are_refused_with_field_value_and_what_is_allowed(toml, case):
    text, parts = REFUSED[case]
    with pytest.raises(ScenarioError) as refusal:
        toml(text)
    message = str(refusal.value)
    assert "mine.toml" in message
    for part in parts:
        assert part in message


@pytest.fixture
def chain(toml, tmp_path):
    """Load a file based on ``shop/lathe.toml``, which is based on a ``steel.toml`` of some text."""
    (tmp_path / "shop").mkdir()
    (tmp_path / "shop" / "lathe.toml").write_text("base = '../steel.toml'\n[limits]\npower = 9\n")

    def load(steel: str) -> Scenario:
        (tmp_path / "steel.toml").write_text(steel)
        return toml("base = 'shop/lathe.toml'\n[tool]\nwear_criterion = 0.2\n")

    return load


def test_a_file_may_be_based_on_files(chain):
    scenario = chain("base = 'ck45'\n[limits]\npower = 8\nthrust_force = 900\n")
    assert scenario.name == "mine"
    assert scenario.material == Scenario.load("ck45").material
    assert scenario.limits.power == 9.0
    assert scenario.limits.thrust_force == 900.0
    assert scenario.tool.wear_criterion == 0.2


def test_a_file_may_not_be_based_on_itself(chain):
    with pytest.raises(ScenarioError, match=r"mine.toml is based on itself, or nested too deep"):
        chain("base = 'shop/lathe.toml'\n")


def test_a_fault_of_a_base_is_named_with_all_files_on_the_way(chain):
    message = r"mine.toml: base: .*lathe.toml: base: .*steel.toml: limits.power: -1.0 is outside"
    with pytest.raises(ScenarioError, match=message):
        chain("[limits]\npower = -1\n")


def test_equality_does_not_count_the_file(toml):
    scenario = toml("base = 'forging'\nname = 'forging'\n")
    assert scenario.file is not None
    assert Scenario.load("forging").file is None
    assert scenario == Scenario.load("forging")
    assert hash(scenario) == hash(Scenario.load("forging"))
    assert scenario.model_copy(update={"name": "copy"}).file == scenario.file


def test_a_dict_states_only_what_differs_from_its_base():
    scenario = Scenario.load({"base": "forging", "limits": {"power": 9}})
    forging = Scenario.load("forging")
    assert scenario.name == "custom"
    assert scenario.differences() == forging.differences() | {"limits": {"power": 9.0}}
    assert Scenario.load({}).digest() == Scenario().digest()


def test_a_list_of_a_dict_becomes_a_tuple():
    scenario = Scenario.load({"workpiece": {"depth_profile": [1.0, 2.0]}})
    assert scenario.workpiece.depth_profile == (1.0, 2.0)


def test_an_unknown_key_of_a_dict_is_refused():
    with pytest.raises(ScenarioError, match=r"unknown key limit; did you mean limits\?"):
        Scenario.load({"limit": {"power": 9}})


HOSTILE_KEY = "\\u001b[2J\\u009b7m\\r\\nall is well"
HOSTILE_LINES = {
    "section": f'"{HOSTILE_KEY}" = 1',
    "field": f'limits."{HOSTILE_KEY}" = 1',
    "base": f'base = "{HOSTILE_KEY}"',
    "inside a value": f'workpiece.depth_profile."{HOSTILE_KEY}" = 1',
}


@pytest.mark.parametrize("place", HOSTILE_LINES)
def test_an_error_cannot_command_a_terminal(toml, place):
    with pytest.raises(ScenarioError) as refusal:
        toml(HOSTILE_LINES[place])
    assert str(refusal.value).isprintable()
    assert r"\x1b[2J" in str(refusal.value)


@pytest.mark.parametrize(
    ("file_name", "name"),
    [("Maß (2).toml", "Ma___2_"), (".a.toml", "_a"), (70 * "x" + ".toml", 64 * "x")],
)
def test_any_file_name_and_a_byte_order_mark_will_do(file_name, name, tmp_path):
    path = tmp_path / file_name
    path.write_bytes(b"\xef\xbb\xbf[limits]\r\npower = 9\r\n")
    scenario = Scenario.load(path)
    assert scenario.name == name
    assert scenario.limits.power == 9.0
    assert RoughTurningEnv(path).scenario == scenario


@pytest.mark.parametrize(
    "make", [Scenario.load, RoughTurningEnv, lambda source: RoughTurningVectorEnv(1, source)]
)
def test_unknown_presets_are_refused(make):
    with pytest.raises(ScenarioError, match=r"'forgings'; did you mean forging( or \w+)*\?"):
        make("forgings")
    with pytest.raises(TypeError, match="not int"):
        make(3)


def test_a_family_is_no_scenario():
    with pytest.raises(ScenarioError, match='Family-v1", family="shop"'):
        Scenario.load("shop")


@pytest.mark.parametrize("preset", ["h13_romi", "vicomtech"])
def test_presets_of_measured_sets_need_force_from_a_fresh_edge(preset):
    material = Scenario.load(preset).material
    for law in (material.thrust_force, material.power):
        fresh = law(350.0, feed=0.1, depth_of_cut=0.5, wear=0.0)
        worn = law(350.0, feed=0.1, depth_of_cut=0.5, wear=0.3)
        assert 0.3 * worn < fresh < worn


@pytest.mark.parametrize(
    ("preset", "cutting_speed", "depth", "measured_life"),
    [("h13_romi", 350.0, 0.5, 39.8), ("vicomtech", 450.0, 1.7, 2.8)],
)
def test_presets_of_measured_sets_wear_as_their_edges(preset, cutting_speed, depth, measured_life):
    wear = Scenario.load(preset).material.wear
    at_the_end = wear(
        cutting_speed,
        feed=0.1,
        depth_of_cut=depth,
        time=measured_life,
    )
    assert at_the_end == pytest.approx(0.3, rel=0.01)


@pytest.mark.parametrize("load", [Scenario.load, Family.load])
def test_a_toml_file_has_a_largest_size(load, tmp_path):
    path = tmp_path / "large.toml"
    path.write_text("# " + "x" * 1_000_000)
    with pytest.raises(ScenarioError, match=r"large\.toml.* is larger than 1000000 bytes"):
        load(path)


@pytest.mark.parametrize(
    "text",
    [
        "".join(f"key{n} = 1\n" for n in range(5_000)),
        "[limits]\n" + "".join(f"key{n} = 1\n" for n in range(5_000)),
        "[workpiece]\ndepth_profile = [" + "'a'," * 5_000 + "]\n",
        "[nominal_model.limits]\n" + "".join(f"key{n} = 1\n" for n in range(5_000)),
    ],
    ids=["keys", "keys of a section", "values", "keys of the nominal model"],
)
def test_an_error_shows_the_first_few_faults(text, tmp_path):
    path = tmp_path / "many.toml"
    path.write_text(text)
    with pytest.raises(ScenarioError) as refusal:
        Scenario.load(path)
    message = str(refusal.value)
    assert message.endswith("; and more")
    assert len(set(re.findall(r"key\d+|depth_profile\.\d+", message))) == 10
    assert len(message) < 5_000


def test_an_error_does_not_quote_a_long_key(tmp_path):
    path = tmp_path / "long.toml"
    path.write_text("k" * 500_000 + " = 1\n")
    with pytest.raises(ScenarioError, match=r"unknown key kkk.*\.\.\.; ") as refusal:
        Scenario.load(path)
    assert len(str(refusal.value)) < 1_000
