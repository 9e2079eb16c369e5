"""Differences of the tasks from RoughTurning-v0.

They are override, roughness, edge changes, parts, and the current as a sensor.
"""

import math
import pydoc

import numpy as np
import pytest

from tests.turning_env.playing import NO_SPREAD, UNDISTURBED, changed, infos, play
from turning_env import FAMILY_ID, IDS, RoughTurningEnv, Scenario, read, tasks

OVERRIDE = changed(
    "override",
    workpiece=NO_SPREAD | {"depth_ripple": 0.0},
    sensors={"power_noise": 0.0},
    tool={"wear_factor_spread": 0.0},
)
SURFACE = changed("surface", workpiece=NO_SPREAD)
LASTING = {"edge_strength": 1e6, "edge_strength_spread": 0.0, "wear_factor_spread": 0.0}
SHIFT = changed("shift", workpiece=NO_SPREAD, tool=LASTING)
ALWAYS_TANGLING = {
    "tangle_rate": 20.0,
    "tangle_time": 0.1,
    "chip_feed_min": 0.5,
    "chip_feed_max": 0.6,
}
BATCH = changed("batch_casting", tool=LASTING | {"wear_criterion": 5.0})


@pytest.mark.parametrize(
    ("override", "feed"),
    [
        pytest.param(-1.0, 0.004, id="lowest"),
        pytest.param(0.0, 0.4, id="as programmed"),
        pytest.param(7.0, 0.8, id="clipped to the highest"),
    ],
)
def test_the_override_scales_the_programmed_feed(override, feed):
    info = infos(OVERRIDE, [[override]] * 200)[-1]
    assert info["commanded_feed"] == pytest.approx(feed)
    assert info["feed"] == pytest.approx(feed, rel=1e-3)
    assert info["spindle_speed"] == pytest.approx(710, rel=1e-3)


def test_roughness_follows_the_force():
    info = infos(SURFACE, [[1 / 3]] * 300)[-1]
    force = info["thrust_force"]
    assert force == pytest.approx(2850 * 0.2, rel=1e-3)
    assert info["roughness"] == pytest.approx(0.2401 * math.exp(0.0034 * force))


def test_the_deviation_of_roughness_from_its_reference_is_charged():
    before, info = infos(SURFACE, [[1 / 3]] * 301)[-2:]
    # A step compares with the reference that was known at its start.
    relative = abs(info["roughness"] / before["roughness_reference"] - 1)
    deviation = relative * SURFACE.control.interval
    assert info["roughness_deviation"] == pytest.approx(deviation, rel=0.01)
    assert info["reward_roughness"] == pytest.approx(-10 * info["roughness_deviation"])


def test_the_reference_changes_in_fixed_periods():
    steps = infos(SURFACE, [[0.0]] * 1500)
    references = np.array([info["roughness_reference"] for info in steps])
    changes = np.flatnonzero(np.diff(references)) + 1
    # A period of 3.75 s is 375 steps; its reference is known from the end of the step before.
    assert changes.tolist() == [374, 749, 1124, 1499]
    assert steps[-1]["truncated"]


@pytest.mark.slow
def test_references_are_even_on_a_log_scale_over_their_range():
    references = []
    for seed in range(150):
        (info,) = infos(SURFACE, [[0.0]], seed)
        references.append(info["roughness_reference"])
    assert 1.0 <= min(references) < 1.05
    assert 3.0 < max(references) <= 3.1
    assert np.median(references) == pytest.approx(math.sqrt(1.0 * 3.1), rel=0.1)


@pytest.fixture(scope="module")
def edge_change():
    """The infos of 30 steps, of a step that begins with an edge change, and of 5 more."""
    keep = [0, 0, -1]
    change = [0, 0, 0.01]
    return infos(SHIFT, [keep] * 30 + [change] + [keep] * 5)


def test_an_edge_is_changed_on_command(edge_change):
    before = edge_change[29]
    change = edge_change[30]
    after = edge_change[-1]
    # A step of a second follows the change.
    change_time = 60 * SHIFT.economics.edge_change_time
    assert change["stopped_time"] == pytest.approx(change_time)
    assert change["time"] == pytest.approx(change_time + 1)
    assert change["cutting_time"] == pytest.approx(1 / 60, rel=1e-6)
    assert before["cutting_time"] > change["cutting_time"]
    assert after["stopped_time"] == 0


def test_an_edge_that_is_changed_is_charged_whole(edge_change):
    change = edge_change[30]
    edges_used = sum(info["edges_used"] for info in edge_change[:31])
    assert edges_used == pytest.approx(1.0 + change["used_life"])
    edge_price = 60 * SHIFT.economics.edge_cost
    assert change["reward_edge"] == pytest.approx(-edge_price * change["edges_used"])
    assert change["reward_time"] == pytest.approx(-change["time"])


def test_a_worn_edge_is_changed_without_a_command_which_takes_longer():
    soft = changed(SHIFT, tool={"wear_criterion": 0.12})
    economics = soft.economics
    stops = [info for info in infos(soft, [[1, 1, -1]] * 100) if info["stopped_time"]]
    stop_time = economics.edge_change_time + economics.unplanned_stop
    first = stops[0]
    assert first["stopped_time"] == pytest.approx(60 * stop_time)
    assert first["edges_broken"] == 0
    assert not first["terminated"]
    assert first["used_life"] == 0


def test_inspection_measures_the_wear_of_the_edge_that_was_taken_out():
    scenario = changed(SHIFT, sensors={"inspects_edges": True}, tool={"wear_criterion": 0.15})
    actions = np.tile([0.0, 0.0, -1.0], (700, 1))
    actions[20, -1] = 1.0
    record = play(RoughTurningEnv(scenario), 0, actions)
    wear = record["wear"]
    removed_wear = read(record["observation"], scenario).removed_wear
    first_change, second_change, *_ = np.flatnonzero(record["stopped_time"] > 0.0)
    # The first edge is changed on command, the second wears out.
    assert first_change == 21
    assert not removed_wear[:first_change].any()
    assert removed_wear[first_change] == pytest.approx(wear[first_change - 1], rel=1e-6)
    assert removed_wear[second_change] == pytest.approx(0.15, rel=0.02)


def test_stops_for_tangled_chips_are_counted():
    scenario = changed(SHIFT, sensors={"counts_tangles": True}, swarf=ALWAYS_TANGLING)
    record = play(RoughTurningEnv(scenario), 0, np.tile([0.0, 0.0, -1.0], (200, 1)))
    tangles = read(record["observation"], scenario).tangles
    assert tangles[0] == 0.0
    assert tangles.max() >= 1.0
    # Nothing else stops the machine in this time.
    stop = 60.0 * scenario.swarf.tangle_time
    np.testing.assert_allclose(record["stopped_time"], stop * tangles)


def test_edges_cannot_be_inspected_if_none_is_changed():
    with pytest.raises(ValueError, match="inspects_edges"):
        changed(Scenario(), sensors={"inspects_edges": True})


def part(passes, allowance):
    """Return the action that turns a part in some passes with a path for an allowance [mm]."""
    control = BATCH.control
    passes_action = 2.0 * (passes - 0.5) / control.passes_max - 1.0
    allowance_action = allowance / BATCH.workpiece.depth_of_cut - 1.0
    speeds_and_feeds = [0.0, 0.0] * control.passes_max
    return [passes_action, allowance_action, *speeds_and_feeds]


@pytest.mark.parametrize(
    ("passes", "allowance"),
    [
        pytest.param(1, 0.0, id="one pass on the contour"),
        pytest.param(2, 3.0, id="two passes, small allowance"),
        pytest.param(3, 10.0, id="three passes, large allowance"),
        pytest.param(4, 5.0, id="four passes"),
    ],
)
def test_whatever_the_path_the_part_is_turned_whole(passes, allowance):
    steps = infos(BATCH, [part(passes, allowance)] * 3, seed=5)
    expected_steps = infos(BATCH, [part(1, 5.0)] * 3, seed=5)
    removed = [info["removed"] for info in steps]
    expected = [info["removed"] for info in expected_steps]
    assert removed == pytest.approx(expected, rel=2e-3)
    assert [info["passes"] for info in steps] == [passes] * 3
    # Every pass runs the whole way, in metal or not, and returns.
    pitch = BATCH.workpiece.bar_length + BATCH.workpiece.approach
    minutes_per_pass = pitch / steps[0]["feed_velocity"] + BATCH.machine.return_time
    assert steps[0]["time"] == pytest.approx(60 * passes * minutes_per_pass)


def test_the_probe_measures_the_mean_allowance_of_the_next_blank():
    uniform = changed(BATCH, workpiece={"depth_along_spread": 0.0})
    workpiece = uniform.workpiece
    actions = np.array([part(1, 5.0)] * 19, np.float32)
    record = play(RoughTurningEnv(uniform), 3, actions)
    probed_depth = record["probed_depth"]
    area = math.pi * workpiece.diameter * workpiece.bar_length / 1000  # [cm3/mm]
    depth_of_next = record["removed"][1:] / area
    assert probed_depth[:-1] == pytest.approx(depth_of_next, rel=1e-9)
    reading = read(record["observation"], uniform)
    assert reading.probed_depth == pytest.approx(probed_depth, rel=1e-6)


def test_without_a_probe_observations_have_no_entry_for_it():
    blind = changed(BATCH, sensors={"probe": False})
    assert RoughTurningEnv(blind).observation_space.shape == (11,)


LOOSE = {"coefficient": 1e-9, "feed": 1.0}
BINDING = {
    "coefficient": 3.0,
    "feed": 0.5,
    "depth_of_cut": 0.8,
    "reference_depth_of_cut": 1.0,
    "most": 1.5,
}


@pytest.mark.parametrize("name", ["radial_force", "torque", "roughness"])
def test_the_largest_excess_over_a_further_limit_is_charged_as_that_of_the_force(name):
    free = changed(UNDISTURBED, limits={"thrust_force": 1e5})
    limits = {"radial_force": LOOSE, "torque": LOOSE, "roughness": LOOSE}
    limited = changed(free, limits=limits | {name: BINDING})
    (without,) = infos(free, [[0.0, 0.0]])
    (info,) = infos(limited, [[0.0, 0.0]])
    # The law of BINDING at the depth of 2.5 mm.
    response = 3.0 * info["feed"] ** 0.5 * 2.5**0.8
    excess = response / BINDING["most"] - 1.0
    assert without["excess_force"] == 0.0
    assert info["excess_force"] == pytest.approx(excess, rel=1e-6)
    assert info["severe_overload_time"] == pytest.approx(info["engaged_time"])
    for unchanged in ("thrust_force", "power", "wear", "removed", "excess_power"):
        assert info[unchanged] == without[unchanged]


def test_help_lists_every_id_and_no_method() -> None:
    text = pydoc.plain(pydoc.render_doc(tasks))
    for env_id in (*IDS, FAMILY_ID):
        assert env_id in text, f"name {env_id} in the docstring of turning_env/tasks.py"
    assert "reset(" not in text
