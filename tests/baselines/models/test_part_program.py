import numpy as np
import pytest

from baselines import fuzzy_override, load_override, omative, tmac
from baselines.models.part_program import PartProgram, on_override, on_speed_and_feed, target_load
from baselines.rule import Range, Rule
from tests.baselines.observing import observe, override_of
from tests.turning_env.playing import changed
from turning_env import RoughTurningVectorEnv, Scenario, presets, read
from turning_env.observation import bounds

OVERRIDE = Scenario.load("override")
RULES = fuzzy_override.RULES | load_override.RULES | tmac.RULES | omative.RULES
PLAYED = [(name, preset) for name in RULES for preset in presets() if RULES[name].plays(Scenario.load(preset))]


def middle(rule: Rule) -> dict[str, float]:
    return {
        name: 0.5 * (value.low + value.high) if isinstance(value, Range) else value for name, value in rule.parameters.items()
    }


def test_what_is_commanded_comes_back_as_the_present_override() -> None:
    env = RoughTurningVectorEnv(5, OVERRIDE)
    observations, _ = env.reset(seed=0)
    program = PartProgram(OVERRIDE, {})
    overrides = np.array([0.01, 0.1, 0.74, 1.28, 2.0])
    observations, *_ = env.step(program.act(read(observations, OVERRIDE), overrides))
    np.testing.assert_allclose(program.override(read(observations, OVERRIDE)), overrides, rtol=1e-5)


def test_an_override_beyond_its_range_is_clipped() -> None:
    program = PartProgram(OVERRIDE, {})
    actions = program.act(read(observe(OVERRIDE, load=[0.0, 0.0]), OVERRIDE), np.array([-1.0, 9.0]))
    np.testing.assert_allclose(override_of(actions, OVERRIDE), [0.01, 2.0], rtol=1e-5)  # 1 % is the machine's lowest feed


@pytest.mark.parametrize("preset", ["rough_turning", "paper", "shift"])
def test_a_program_of_its_own_sets_speed_and_feed(preset: str) -> None:
    scenario = Scenario.load(preset)
    env = RoughTurningVectorEnv(1, scenario)
    observations, infos = env.reset(seed=0)
    program = PartProgram(scenario, {"cutting_speed": 160.0, "feed": 0.2})
    for _ in range(4):
        actions = program.act(read(observations, scenario), np.array([1.5]))
        observations, _, _, _, infos = env.step(actions)
    assert infos["commanded_cutting_speed"][0] == pytest.approx(160.0, rel=1e-5)
    assert infos["commanded_feed"][0] == pytest.approx(0.3, rel=1e-5)
    assert infos["edges_used"][0] < 0.5


def test_a_program_is_kept_within_the_machine() -> None:
    program = PartProgram(OVERRIDE, {"cutting_speed": 500.0, "feed": 5.0})
    assert (program.cutting_speed, program.feed) == (180.0, 0.8)


def test_the_target_is_a_share_of_the_power_limit() -> None:
    assert target_load(OVERRIDE, 1.0) == pytest.approx(0.6)
    assert target_load(Scenario(), 0.75) == pytest.approx(0.7)


def test_controls_of_load_play_where_metal_is_removed_by_feed() -> None:
    parts, surface = Scenario.load("batch_casting"), Scenario.load("surface")
    assert on_override(OVERRIDE)
    assert on_speed_and_feed(Scenario())
    assert not any(plays(scenario) for plays in (on_override, on_speed_and_feed) for scenario in (parts, surface))
    assert [name for name in RULES if RULES[name].plays(surface)] == ["programmed_feed"]
    assert not [name for name in RULES if RULES[name].plays(parts)]


@pytest.mark.parametrize("scenario", [OVERRIDE, Scenario()])
def test_each_control_is_there_once(scenario: Scenario) -> None:
    controls = [name.removesuffix("_with_speed") for name in RULES if RULES[name].plays(scenario)]
    assert sorted(controls) == sorted(name for name in RULES if not name.endswith("_with_speed"))
    assert all(len(rule.ranges) <= 3 for rule in RULES.values())


@pytest.mark.parametrize(("name", "preset"), PLAYED)
def test_whatever_is_seen_is_answered(name: str, preset: str) -> None:
    scenario = Scenario.load(preset)
    low, high = bounds(scenario)
    lanes = 64
    seen = np.random.default_rng(7).uniform(low, high, (40, lanes, len(low))).astype(np.float32)
    seen[:, :8] = np.where(np.arange(8)[:, None] % 2, low, high)  # some lanes at the ends of all entries, in turns
    seen[:, 8:16, 0] = low[0]  # no load
    seen[:, 16:32, 6] = np.linspace(0.0, 3.0, 40, dtype=np.float32)[:, None]  # edges that live on
    policy = RULES[name].build(scenario, lanes, middle(RULES[name]))
    policy.reset(np.ones(lanes, np.bool_))
    actions = RoughTurningVectorEnv(lanes, scenario).action_space.shape
    with np.errstate(divide="raise", over="raise", invalid="raise"):
        for observations in seen:
            answer = policy.act(observations)
            assert answer.shape == actions
            assert answer.dtype == np.float32
            assert np.all(np.abs(answer) <= 1.0)


@pytest.mark.parametrize(("name", "preset"), PLAYED)
def test_lanes_do_not_know_of_each_other(name: str, preset: str) -> None:
    scenario = changed(Scenario.load(preset), limits={"power": 5.0})
    env = RoughTurningVectorEnv(3, scenario)
    together, alone = (RULES[name].build(scenario, lanes, middle(RULES[name])) for lanes in (3, 1))
    observations, _ = env.reset(seed=5)
    for step in range(30):
        if step == 20:
            together.reset(np.array([False, True, False]))
        actions = together.act(observations)
        np.testing.assert_array_equal(alone.act(observations[2:]), actions[2:])
        observations, *_ = env.step(actions)
