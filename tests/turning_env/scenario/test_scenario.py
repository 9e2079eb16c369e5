"""Scenario files: what is read, refused, written and identified."""

import pytest

from tests.turning_env.playing import slightly_different, variants
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario, ScenarioError, presets

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
    digests = {
        name: scenario.digest() for name, scenario in variants(Scenario(), slightly_different)
    }
    assert len(digests) > 60
    assert len({Scenario().digest(), *digests.values()}) == 1 + len(digests)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("[quux]\n", ["unknown key quux; list all with: python -m turning_env schema"]),
        (
            "[tool]\nwear_criterium = 1\n",
            ["tool: unknown key wear_criterium; did you mean wear_criterion?"],
        ),
        ("[limits]\npower = -3\n", ["limits.power", "-3", "0.001 to 10000", "kW"]),
        ("[limits]\npower = nan\n", ["limits.power", "nan"]),
        ("[control]\nsub_steps = 1.5\n", ["control.sub_steps", "1.5"]),
        (
            "[control]\naction = 'steps'\n",
            ["control.action", "steps", "'incremental', 'set_point', 'override' or 'part'"],
        ),
        ("[material.wear]\nfeed = 0.1\n", ["material.wear.coefficient", "required"]),
        ("[machine]\nfeed_min = 1\n", ["machine", "feed_min is 1.0", "not exceed feed_max", "0.6"]),
        ("[control]\ninitial_feed = 5\n", ["control.initial_feed is 5.0", "0.06 to 0.6"]),
        ("[control]\ninterval = 3600\ntime_limit = 1\n", ["time_limit is 1.0 min", "3600.0 s"]),
        ("[material.wear]\ncoefficient = 1\n", ["wear.time is 0.0", "above 0"]),
        ("[material.wear]\ntime = 0.01\ncoefficient = 1e12\n", ["material.wear comes to 1e"]),
        (
            f"[material.thrust_force]\n{BEYOND}[material.power]\n{BEYOND}",
            ["thrust_force comes to 1e", "power comes to 1e", "within"],
        ),
        ("[workpiece]\ndepth_profile = [1, 2]\nsection_lengths = [300]\n", ["section_lengths"]),
        ("[workpiece]\ndepth_profile = [1, 2]\nsection_lengths = [100, 100]\n", ["bar_length"]),
        ("[workpiece]\ndepth_profile = [1, 0]\n", ["air"]),
        ("[workpiece]\ndepth_profile = [1, 2]\nsection_speeds = [100]\n", ["section_speeds"]),
        (
            "[mismatch]\ninitial_wear = 0.3\n",
            ["mismatch.initial_wear is 0.3", "below tool.wear_criterion, which is 0.3"],
        ),
        (
            "base = 'forgings'\n",
            ["base: 'forgings' is neither a preset nor a TOML file; did you mean forging"],
        ),
        ("base = 'none.toml'\n", ["mine.toml: base: no preset and no file is called", "none.toml"]),
        (
            "[limits]\npower = 0,5\n",
            ["is not TOML", "line 2", 'numbers have a decimal point: "0.5"'],
        ),
        ("name = '../up'\n", ["name: '../up' is not allowed", "1 to 64"]),
        (
            "[tool]\nwear_criterion = 9\n[limits]\npower = 0\n",
            ["tool.wear_criterion: ", "; limits.power: "],
        ),
    ],
)
def test_bad_files_are_refused_with_field_value_and_what_is_allowed(toml, text, parts):
    with pytest.raises(ScenarioError) as refusal:
        toml(text)
    message = str(refusal.value)
    assert "mine.toml" in message
    for part in parts:
        assert part in message


def test_a_file_may_be_based_on_files(toml, tmp_path):
    (tmp_path / "shop").mkdir()
    (tmp_path / "shop" / "lathe.toml").write_text("base = '../steel.toml'\n[limits]\npower = 9\n")
    (tmp_path / "steel.toml").write_text("base = 'ck45'\n[limits]\npower = 8\nthrust_force = 900\n")
    scenario = toml("base = 'shop/lathe.toml'\n[tool]\nwear_criterion = 0.2\n")
    assert (scenario.name, scenario.material) == ("mine", Scenario.load("ck45").material)
    assert (scenario.limits.power, scenario.limits.thrust_force, scenario.tool.wear_criterion) == (
        9.0,
        900.0,
        0.2,
    )
    (tmp_path / "steel.toml").write_text("base = 'shop/lathe.toml'\n")
    with pytest.raises(ScenarioError, match=r"mine.toml is based on itself, or nested too deep"):
        toml("base = 'shop/lathe.toml'\n")
    (tmp_path / "steel.toml").write_text("[limits]\npower = -1\n")
    with pytest.raises(
        ScenarioError,
        match=r"mine.toml: base: .*lathe.toml: base: .*steel.toml: limits.power: -1.0 is outside",
    ):
        toml("base = 'shop/lathe.toml'\n")


def test_a_dict_states_only_what_differs_from_its_base():
    scenario = Scenario.load({"base": "forging", "limits": {"power": 9}})
    assert scenario.differences() == Scenario.load("forging").differences() | {
        "limits": {"power": 9.0}
    }
    assert scenario.name == "custom"
    assert Scenario.load({}).digest() == Scenario().digest()
    assert Scenario.load(
        {"name": "mine", "workpiece": {"depth_profile": [1.0, 2.0]}}
    ).workpiece.depth_profile == (1.0, 2.0)
    with pytest.raises(ScenarioError, match=r"unknown key limit; did you mean limits\?"):
        Scenario.load({"limit": {"power": 9}})


HOSTILE_KEY = "\\u001b[2J\\u009b7m\\r\\nall is well"


HOSTILE_LINES = (
    f'"{HOSTILE_KEY}" = 1',
    f'limits."{HOSTILE_KEY}" = 1',
    f'base = "{HOSTILE_KEY}"',
    f'workpiece.depth_profile."{HOSTILE_KEY}" = 1',
)


@pytest.mark.parametrize("text", HOSTILE_LINES, ids=["section", "field", "base", "inside a value"])
def test_an_error_cannot_command_a_terminal(text, tmp_path):
    (tmp_path / "hostile.toml").write_text(text)
    with pytest.raises(ScenarioError) as refusal:
        Scenario.load(tmp_path / "hostile.toml")
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
    assert (scenario.name, scenario.limits.power) == (name, 9.0)
    assert RoughTurningEnv(path).scenario == scenario


@pytest.mark.parametrize(
    "make", [Scenario.load, RoughTurningEnv, lambda source: RoughTurningVectorEnv(1, source)]
)
def test_unknown_presets_are_refused(make):
    with pytest.raises(ScenarioError, match=r"'forgings'; did you mean forging( or \w+)*\?"):
        make("forgings")
    with pytest.raises(TypeError, match="not int"):
        make(3)
