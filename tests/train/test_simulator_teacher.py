"""The simulator's lessons are changes of what the environment charges, in expectation."""

from typing import Any

import numpy as np
import pytest

from tests.turning_env.playing import changed
from tests.turning_env.test_family_env import BRIEF_FAMILY
from train.simulator_teacher import (
    FEED,
    LOG_PROBE,
    SPEED,
    UNUSED_LIFE,
    WORN_FROM,
    TrialVecEnv,
    at_life,
    job_of,
)
from turning_env import Scenario
from turning_env.vector_env import info_at_end_of_step

NUM_ENVS = 64
SEED = 11
# A job that ends before its edge charges life at the flat price, as the reward does.
FLAT = changed(
    "rough_turning",
    workpiece={"bars": 50},
    tool={"edge_strength": 1e6, "edge_strength_spread": 0.0},
)
TERMS: dict[str, dict[str, Any]] = {
    "reward_time": {
        "economics": {"overload_price": 0.0, "edge_cost": 0.0, "edge_change_time": 0.0}
    },
    "reward_edge": {"economics": {"overload_price": 0.0, "edge_cost": 100.0}},
    "reward_overload": {"limits": {"power": 4.0}},
}
"""Changes of ``FLAT`` by which a term of the reward decides, by the term."""


class RecordingVecEnv(TrialVecEnv):
    """Environments that keep the infos of the last step."""

    infos: dict[str, Any]

    def training_rewards(self, rewards: Any, infos: dict[str, Any]) -> Any:
        self.infos = infos
        return super().training_rewards(rewards, infos)

    def term(self, name: str) -> Any:
        """Return a value of the last step, shape (num_envs,)."""
        return info_at_end_of_step(self.infos, name)


def scenario_of(env: TrialVecEnv) -> Scenario:
    scenario: Scenario = env.get_attr("scenario")[0]
    return scenario


def in_the_cut(scenario: Any, num_envs: int = NUM_ENVS, steps: int = 12) -> RecordingVecEnv:
    """Return environments after a few steps at a rising feed, some of them overloaded."""
    env = RecordingVecEnv(scenario, num_envs)
    env.seed(SEED)
    env.reset()
    actions = np.zeros((num_envs, *(env.action_space.shape or ())), np.float32)
    if scenario_of(env).control.action == "override":
        actions[:, 0] = np.linspace(-0.5, 0.5, num_envs)
    else:
        actions[:, 0] = 0.2
        actions[:, 1] = np.linspace(-0.05, 0.12, num_envs)
    if scenario_of(env).control.edge_changes == "commanded":
        actions[:, -1] = -1.0
    for _ in range(steps):
        env.step(actions)
    return env


def charged_in_reality(scenario: Scenario, actions: Any, terms: Any = None) -> Any:
    """Return the cost of a real step per mm, by terms of the reward, and all but metal if None."""
    env = in_the_cut(scenario)
    start = env.term("path").copy()
    env.step(actions.astype(np.float32))
    distance = env.term("path") - start
    if terms is None:
        terms = ["reward_time", "reward_edge", "reward_overload", "reward_breakage"]
    return -sum(env.term(name) for name in terms) / distance, distance


@pytest.mark.parametrize("term", TERMS)
@pytest.mark.parametrize("entry", [0, 1])
def test_a_gradient_is_the_change_of_the_charge_of_real_steps(term: str, entry: int) -> None:
    scenario = changed(FLAT, **TERMS[term])
    actions = np.zeros((NUM_ENVS, 2), np.float32)
    env = in_the_cut(scenario)
    gradient = env.lesson(actions).gradient[:, entry]

    step = [scenario.control.cutting_speed_step, scenario.control.feed_step][entry]
    probe = np.zeros((NUM_ENVS, 2))
    probe[:, entry] = LOG_PROBE / step
    higher, _ = charged_in_reality(scenario, actions + probe)
    lower, _ = charged_in_reality(scenario, actions - probe)
    _, distance = charged_in_reality(scenario, actions)
    expected = -distance * (higher - lower) / (2.0 * LOG_PROBE)
    inside = np.abs(expected) < 40.0  # larger ones are limited
    np.testing.assert_allclose(gradient[inside], expected[inside], rtol=1e-3, atol=2e-3)
    assert inside.mean() > 0.8
    assert np.abs(expected[inside]).max() > 0.1
    # The term decides: without it, the change is another one.
    higher_term, _ = charged_in_reality(scenario, actions + probe, terms=[term])
    lower_term, _ = charged_in_reality(scenario, actions - probe, terms=[term])
    of_term = -distance * (higher_term - lower_term) / (2.0 * LOG_PROBE)
    assert np.abs(of_term[inside]).max() > 0.5 * np.abs(expected[inside]).max()


def test_roughness_is_charged_as_in_a_real_step() -> None:
    env = in_the_cut("surface")
    actions = np.zeros((NUM_ENVS, 1))
    charge = env.charge(actions)
    time_price = float(job_of(Scenario.load("surface"))["time_price"])
    env.step(actions.astype(np.float32))
    roughness = -env.term("reward_roughness")
    assert roughness.max() > 0.0
    least = roughness + time_price * env.term("time") - env.term("reward_overload")
    assert (charge.cost[~charge.failed] >= least[~charge.failed] - 1e-9).all()


@pytest.mark.slow
def test_expected_stops_are_the_mean_of_those_that_happen() -> None:
    num_envs = 4096
    swarf = {"tangle_rate": 10.0, "chip_feed_min": 0.9, "chip_feed_max": 1.0}
    tangling = changed("shift", swarf=swarf)
    env = in_the_cut(tangling, num_envs, steps=3)
    actions = np.zeros((num_envs, 3), np.float32)
    actions[:, 2] = -1.0
    expected = env.charge(actions.astype(float)).events.mean()
    env.step(actions)
    time_price = float(job_of(tangling)["time_price"])
    stops = time_price * env.term("stopped_time").mean()
    assert stops > 1.0
    assert expected == pytest.approx(stops, rel=0.1)


@pytest.mark.parametrize(("window", "sign"), [((0.05, 0.95), -1.0), ((1.05, 2.0), 1.0)])
def test_a_feed_near_the_end_of_the_window_is_drawn_inside(
    window: tuple[float, float], sign: float
) -> None:
    # The ends of the window are beyond the reach of small changes.
    env = in_the_cut("shift", steps=3)
    feed = float(env.term("feed")[0])
    ends = {"chip_feed_min": window[0] * feed, "chip_feed_max": window[1] * feed}
    actions = np.tile(np.array([0.0, 0.0, -1.0], np.float32), (NUM_ENVS, 1))
    lessons = []
    for rate in (0.0, 20.0):
        tangling = changed("shift", swarf={"tangle_rate": rate, **ends})
        lessons.append(in_the_cut(tangling, steps=3).lesson(actions).gradient[0, FEED])
    assert sign * (lessons[1] - lessons[0]) > 1.0


def test_an_edge_is_charged_one_stop_while_it_wears_out() -> None:
    scenario = Scenario.load("shift")
    wear = 0.99 * scenario.tool.wear_criterion
    unbreakable = {"edge_strength": 1e6, "edge_strength_spread": 0.0}
    stop = {"unplanned_stop": 1000.0}
    scenario = changed(scenario, tool=unbreakable, economics=stop)
    dear = in_the_cut(changed(scenario, mismatch={"initial_wear": wear}), steps=3)
    job = job_of(scenario)
    earned = np.zeros(NUM_ENVS)
    going = np.ones(NUM_ENVS, np.bool_)
    start = dear.term("used_life").copy()
    actions = np.zeros((NUM_ENVS, 3))
    actions[:, 2] = -1.0
    for _ in range(400):
        charge = dear.charge(actions)
        earned += np.where(going, charge.going_on, 0.0)
        dear.step(actions.astype(np.float32))
        going &= ~charge.failed
        if not going.any():
            break
    assert not going.any()
    # The rest is the price of the last of its life.
    share = (1.0 - np.maximum(start, WORN_FROM)) / (1.0 - WORN_FROM)
    rest = earned + share * float(job["stop_unplanned"])
    assert (np.abs(rest) < 0.05 * float(job["stop_unplanned"])).all()


STRENGTH = {"tool": {"edge_strength": 800.0, "edge_strength_spread": 0.3}}
CHIPPING = {"edge_failure": {"chipping_rate": 300.0, "chipping_load_exponent": 1.0}}


@pytest.mark.slow
@pytest.mark.parametrize("failure", [STRENGTH, CHIPPING], ids=["strength", "chipping"])
def test_expected_breakages_are_the_mean_of_those_that_happen(failure: dict[str, Any]) -> None:
    num_envs = 4096
    breaking = changed("shift", **failure)
    sound = changed("shift", tool={"edge_strength": 1e6, "edge_strength_spread": 0.0})
    env = in_the_cut(breaking, num_envs, steps=6)
    never_broken = in_the_cut(sound, num_envs, steps=6)
    # Edges that have not broken yet are where those are that cannot break.
    survivors = env.term("path") == never_broken.term("path")
    assert survivors.mean() > 0.3
    # A much higher feed.
    actions = np.tile([0.0, 1.0, -1.0], (num_envs, 1))
    charge = env.charge(actions)
    expected = charge.cost - never_broken.charge(actions).cost
    job = job_of(breaking)
    breakage = float(job["breakage"] + job["remaining_value"][0])
    env.step(actions.astype(np.float32))
    broken = env.term("broken")[survivors].mean()
    assert broken > 0.02
    # Where an edge breaks, the cost says nothing.
    probability = expected[survivors & ~charge.failed].mean() / breakage
    assert probability == pytest.approx(broken, rel=0.25)


def test_a_whole_edge_pays_for_itself_at_the_prices_of_life_and_time() -> None:
    scenario = Scenario.load("shift")
    job = job_of(scenario)
    economics = scenario.economics
    price = 60.0 * (economics.edge_cost + job["time_price"] * economics.edge_change_time)
    price /= 1.0 - UNUSED_LIFE
    assert job["remaining_value"][0] == pytest.approx(price, rel=0.03)
    nodes = np.array([job["life_price"]])
    assert at_life(nodes, np.array([0.5])) == pytest.approx(nodes[0, 20])
    assert at_life(nodes, np.array([1.5])) == pytest.approx(nodes[0, -1])


@pytest.mark.slow
def test_lessons_change_no_trajectory_and_follow_the_jobs() -> None:
    taught = TrialVecEnv(BRIEF_FAMILY, NUM_ENVS)
    plain = TrialVecEnv(BRIEF_FAMILY, NUM_ENVS)
    taught.seed(SEED)
    plain.seed(SEED)
    np.testing.assert_array_equal(taught.reset(), plain.reset())
    random = np.random.default_rng(0)
    ends = 0
    for _ in range(60):
        actions = random.uniform(-1.0, 0.8, (NUM_ENVS, 3)).astype(np.float32)
        lesson = taught.lesson(actions)
        assert np.isfinite(lesson.gradient).all()
        assert np.isfinite(lesson.going_on).all()
        observations, rewards, ended, _ = taught.step(actions)
        expected_observations, expected_rewards, *_ = plain.step(actions)
        np.testing.assert_array_equal(observations, expected_observations)
        np.testing.assert_array_equal(rewards, expected_rewards)
        ends += ended.sum()
    assert ends > NUM_ENVS


def test_a_worn_edge_earns_less_than_a_fresh_one_even_where_it_is_changed() -> None:
    scenario = Scenario.load("shift")
    wear = 0.97 * scenario.tool.wear_criterion
    worn = in_the_cut(changed(scenario, mismatch={"initial_wear": wear}), steps=3)
    fresh = in_the_cut(scenario, steps=3)
    actions = np.tile(np.array([0.0, 0.0, 1.0], np.float32), (NUM_ENVS, 1))
    earned_worn = worn.lesson(actions).going_on
    earned_fresh = fresh.lesson(actions).going_on
    assert np.median(earned_worn) < np.median(earned_fresh)
    assert np.median(earned_fresh) > 0.0


def test_a_fresh_edge_that_collapses_teaches_a_lower_speed_and_no_change() -> None:
    # At a kelvin every edge collapses in its first step, at any speed within reach.
    collapsing = changed("shift", edge_failure={"collapse_temperature": 1.0})
    env = in_the_cut(collapsing, steps=3)
    actions = np.tile(np.array([0.0, 0.0, -1.0], np.float32), (NUM_ENVS, 1))
    lesson = env.lesson(actions)
    assert lesson.failed.any()
    assert (lesson.gradient[lesson.failed, SPEED] < 0.0).all()
    assert (lesson.going_on[lesson.failed] == 0.0).all()


def test_chipping_that_threatens_any_edge_is_no_reason_to_change_it() -> None:
    actions = np.tile(np.array([0.0, 0.0, -1.0]), (NUM_ENVS, 1))
    sound = in_the_cut(Scenario.load("shift"), steps=1).charge(actions)
    chipping = in_the_cut(changed("shift", **CHIPPING), steps=1).charge(actions)
    still_whole = ~sound.failed & ~chipping.failed
    assert (chipping.cost > sound.cost)[still_whole].any()
    np.testing.assert_array_equal(chipping.going_on[still_whole], sound.going_on[still_whole])
