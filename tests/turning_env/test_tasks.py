"""Differences of the tasks from RoughTurning-v0: override, roughness, edge changes, parts, and the current as a sensor."""

import math

import numpy as np
import pytest

from tests.turning_env.playing import UNDISTURBED, changed, infos, play
from turning_env import RoughTurningEnv, Scenario, read

SPREADS = {
    f"{field}_{kind}_spread": 0.0 for field in ("hardness", "depth") for kind in ("bar", "along")
}
OVERRIDE = changed(
    Scenario.load("override"),
    workpiece=SPREADS | {"depth_ripple": 0.0},
    sensors={"power_noise": 0.0},
    tool={"wear_factor_spread": 0.0},
)
SURFACE = changed("surface", workpiece=SPREADS)
LASTING = {"edge_strength": 1e6, "edge_strength_spread": 0.0, "wear_factor_spread": 0.0}
SHIFT = changed("shift", workpiece=SPREADS, tool=LASTING)
BATCH = changed("batch_casting", tool=LASTING | {"wear_criterion": 5.0})


@pytest.mark.parametrize(("override", "feed"), [(-1.0, 0.004), (0.0, 0.4), (7.0, 0.8)])
def test_the_override_scales_the_programmed_feed(override, feed):
    info = infos(OVERRIDE, [[override]] * 200)[-1]
    assert info["commanded_feed"] == pytest.approx(feed)
    assert info["feed"] == pytest.approx(feed, rel=1e-3)
    assert info["spindle_speed"] == pytest.approx(710, rel=1e-3)


def test_roughness_follows_the_force_and_its_deviation_is_charged():
    told = infos(SURFACE, [[1 / 3]] * 1500)
    info = told[300]
    assert info["thrust_force"] == pytest.approx(2850 * 0.2, rel=1e-3)
    assert info["roughness"] == pytest.approx(0.2401 * math.exp(0.0034 * info["thrust_force"]))
    reference = told[299]["roughness_reference"]
    assert info["roughness_deviation"] == pytest.approx(
        0.01 * abs(info["roughness"] / reference - 1), rel=0.01
    )
    assert info["reward_roughness"] == pytest.approx(-10 * info["roughness_deviation"])


def test_the_reference_changes_in_fixed_periods_and_stays_in_its_range():
    told = infos(SURFACE, [[0.0]] * 1500)
    references = np.array([info["roughness_reference"] for info in told])
    changes = np.flatnonzero(np.diff(references)) + 1
    assert changes.tolist() == [
        374,
        749,
        1124,
        1499,
    ]  # told with the interval before: 3.75 s are 375 intervals
    assert told[-1]["truncated"]
    many = np.array(
        [infos(SURFACE, [[0.0]], seed)[0]["roughness_reference"] for seed in range(150)]
    )
    assert 1.0 <= many.min() < 1.05
    assert 3.0 < many.max() <= 3.1
    assert np.median(many) == pytest.approx(math.sqrt(1.0 * 3.1), rel=0.1)  # even on a log scale


def test_an_edge_is_changed_on_command_and_charged_whole():
    told = infos(SHIFT, [[0, 0, -1]] * 30 + [[0, 0, 0.01]] + [[0, 0, 0]] * 5)
    economics, change = SHIFT.economics, told[30]
    assert sum(info["edges_used"] for info in told[:31]) == pytest.approx(1.0 + change["used_life"])
    assert change["stopped_time"] == pytest.approx(60 * economics.edge_change_time)
    assert change["time"] == pytest.approx(60 * economics.edge_change_time + 1)
    assert change["reward_time"] == pytest.approx(-change["time"])
    assert change["reward_edge"] == pytest.approx(-60 * economics.edge_cost * change["edges_used"])
    assert told[29]["cutting_time"] > change["cutting_time"] == pytest.approx(1 / 60, rel=1e-6)
    assert told[-1]["stopped_time"] == 0


def test_a_worn_edge_is_changed_unannounced_which_takes_longer():
    soft = changed(SHIFT, tool={"wear_criterion": 0.12})
    told = infos(soft, [[1, 1, -1]] * 100)
    first = next(info for info in told if info["stopped_time"])
    assert first["stopped_time"] == pytest.approx(
        60 * (soft.economics.edge_change_time + soft.economics.unplanned_stop)
    )
    assert first["edges_broken"] == 0
    assert not first["terminated"]
    assert first["used_life"] == 0


def test_inspection_tells_the_wear_of_the_edge_that_was_taken_out():
    scenario = changed(SHIFT, sensors={"inspects_edges": True}, tool={"wear_criterion": 0.15})
    actions = np.tile([0.0, 0.0, -1.0], (700, 1))
    actions[20, -1] = 1.0
    record = play(RoughTurningEnv(scenario), 0, actions)
    told = read(record["observation"], scenario).removed_wear
    changes = np.flatnonzero(record["stopped_time"] > 0.0)
    assert changes[0] == 21
    assert len(changes) > 1  # the second edge is worn out
    assert (told[: changes[0]] == 0.0).all()
    assert told[changes[0]] == pytest.approx(record["wear"][changes[0] - 1], rel=1e-6)
    assert told[changes[1]] == pytest.approx(0.15, rel=0.02)
    with pytest.raises(ValueError, match="inspects_edges"):
        changed(Scenario(), sensors={"inspects_edges": True})


def part(passes, allowance, speed=0.0, feed=0.0):
    """The action that turns a part in so many passes with a path for an allowance [mm]."""
    number = 2.0 * (passes - 0.5) / BATCH.control.passes_max - 1.0
    return [number, allowance / BATCH.workpiece.depth_of_cut - 1.0] + [
        speed,
        feed,
    ] * BATCH.control.passes_max


@pytest.mark.parametrize(("passes", "allowance"), [(1, 0.0), (2, 3.0), (3, 10.0), (4, 5.0)])
def test_whatever_the_path_the_part_is_turned_whole(passes, allowance):
    told = infos(BATCH, [part(passes, allowance)] * 3, seed=5)
    expected = infos(BATCH, [part(1, 5.0)] * 3, seed=5)
    assert [info["removed"] for info in told] == pytest.approx(
        [info["removed"] for info in expected], rel=2e-3
    )
    assert [info["passes"] for info in told] == [passes] * 3
    # Every pass runs the whole way, in metal or not, and returns.
    velocity = told[0]["feed_velocity"]
    pitch = BATCH.workpiece.bar_length + BATCH.workpiece.approach
    assert told[0]["time"] == pytest.approx(
        60 * passes * (pitch / velocity + BATCH.machine.return_time)
    )


def test_the_probe_tells_the_mean_allowance_of_the_next_blank():
    uniform = changed(BATCH, workpiece={"depth_along_spread": 0.0})
    record = play(RoughTurningEnv(uniform), 3, np.array([part(1, 5.0)] * 19, np.float32))
    lengths = math.pi * uniform.workpiece.diameter * uniform.workpiece.bar_length / 1000
    assert record["probed_depth"][:-1] == pytest.approx(record["removed"][1:] / lengths, rel=1e-9)
    assert read(record["observation"], uniform).probed_depth == pytest.approx(
        record["probed_depth"], rel=1e-6
    )
    blind = changed(BATCH, sensors={"probe": False})
    assert RoughTurningEnv(blind).observation_space.shape == (11,)


@pytest.mark.parametrize("name", ["radial_force", "torque", "roughness"])
def test_the_largest_excess_over_a_further_limit_is_charged_as_that_of_the_force(name):
    loose = {
        other: {"coefficient": 1e-9, "feed": 1.0}
        for other in ("radial_force", "torque", "roughness")
    }
    law = {"coefficient": 3.0, "feed": 0.5, "depth_of_cut": 0.8, "reference_depth_of_cut": 1.0}
    free = changed(UNDISTURBED, limits={"thrust_force": 1e5})
    bound = changed(free, limits=loose | {name: law | {"most": 1.5}})
    (alone,), (charged,) = (infos(scenario, [[0.0, 0.0]]) for scenario in (free, bound))
    assert alone["cost_force"] == 0.0
    assert charged["cost_force"] == pytest.approx(
        3.0 * charged["feed"] ** 0.5 * 2.5**0.8 / 1.5 - 1.0, rel=1e-6
    )
    assert charged["severe_overload_time"] == pytest.approx(charged["engaged_time"])
    for same in ("thrust_force", "power", "wear", "removed", "cost_power"):
        assert charged[same] == alone[same]
