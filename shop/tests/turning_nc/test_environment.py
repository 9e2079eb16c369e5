"""A program's tool path as a workpiece: its time, its metal, and the spindle's limit."""

from itertools import chain, product, repeat
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

pytest.importorskip("shapely")

from turning_nc.environment import ToolPath
from turning_nc.words import NcError

from shop.examples.adapt_programs import COLLECTION, path_of
from tests.turning_env.playing import infos
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.action import set_point_action

EVEN: dict[str, Any] = {
    "machine": {"feed_time_constant": 0.0, "spindle_time_constant": 0.0},
    "workpiece": {
        "depth_bar_spread": 0.0,
        "depth_along_spread": 0.0,
        "hardness_bar_spread": 0.0,
        "hardness_along_spread": 0.0,
    },
}


def arguments(name: str) -> dict[str, Any]:
    """Return the arguments of ``ToolPath`` for a program of the collection."""
    entry = COLLECTION[name]
    return {
        "program": str(path_of(name)),
        "stock": entry["stock"],
        "tools": entry.get("tools", {}),
    }


@pytest.mark.parametrize("name", ["welle", "stepped_shaft"])
def test_the_programmed_values_take_the_programs_time_and_remove_its_metal(name: str) -> None:
    env = gymnasium.make(
        "turning_nc:RoughTurning-Program-v1", scenario=EVEN, parts=1, **arguments(name)
    )
    path = env.unwrapped.tool_path  # type: ignore[attr-defined]
    machine = path.scenario.machine
    workpiece = path.scenario.workpiece
    speed = float(np.median(path.speeds))
    speed_action = set_point_action(speed, machine.cutting_speed_min, machine.cutting_speed_max)
    # A feed override of 0 is the programmed feed.
    steps = infos(env, repeat(np.array([0.0, speed_action], np.float32)))
    around = np.pi * path.diameter / 1000.0
    minutes = (path.lengths * around / (speed * path.feeds)).sum()
    metal = around * np.dot(workpiece.depth_profile, workpiece.section_lengths)
    assert sum(info["time"] for info in steps) == pytest.approx(60.0 * minutes, rel=0.05)
    assert sum(info["removed"] for info in steps) == pytest.approx(metal, rel=0.03)


TAPER = """G99 G50 S3000
G96 S120 M3
G0 X72. Z1.
G1 X80. Z-40. F0.2
G0 X84. Z1.
G0 X64.
G1 X80. Z-40.
"""
# Edges last some parts, and times are in proportion.
SHORT: dict[str, Any] = {
    "base": "practitioner",
    "mismatch": {"wear_factor": 2.0},
    "economics": {
        "edge_cost": 0.3,
        "edge_change_time": 0.2,
        "unplanned_stop": 0.3,
        "breakage_downtime": 1.0,
    },
}
PROGRAMMED = (0.0, -1.0 / 15.0)  # 120 m/min at the programmed feed
IDLE = (-1.0, -1.0)  # lowest feed and speed
FASTEST = (1.0, 1.0)  # highest feed and speed, which break edges
SUMMED = ("reward", "reward_metal", "removed", "time", "edges_broken")


class Episode(NamedTuple):
    """Sums over the steps of an episode."""

    reward: float
    reward_metal: float
    removed: float
    time: float
    edges_broken: float
    is_finished: bool

    @property
    def cost(self) -> float:
        """Cost per removed metal."""
        return (self.reward_metal - self.reward) / self.removed


def play(env: gymnasium.Env, seed: int, *actions: tuple[float, float]) -> Episode:
    """Play an episode, in which the last action is repeated."""
    steps = infos(env, chain(actions, repeat(actions[-1])), seed)
    sums = {name: sum(info[name] for info in steps) for name in SUMMED}
    return Episode(**sums, is_finished=steps[-1]["finished"])


@pytest.mark.parametrize("seed", [1, 2])
def test_the_cheapest_policy_returns_most_and_idlers_least(tmp_path: Path, seed: int) -> None:
    (tmp_path / "taper.nc").write_text(TAPER)
    env = gymnasium.make(
        "turning_nc:RoughTurning-Program-v1",
        program=tmp_path / "taper.nc",
        scenario=SHORT,
        stock="bar:80x60",
        parts=4,
    )
    programmed_time = 240.0 * env.unwrapped.tool_path.minutes  # type: ignore[attr-defined]
    programmed = play(env, seed, PROGRAMMED)
    idle = play(env, seed, IDLE)
    fastest = play(env, seed, FASTEST)
    late = play(env, seed, *[IDLE] * 30, PROGRAMMED)
    settings = np.linspace(-1.0, 1.0, 7)
    constant = [play(env, seed, action) for action in product(settings, settings)]

    # All that finish remove the same metal, so that the cheapest return most.
    finished = [episode for episode in [*constant, programmed] if episode.is_finished]
    assert len(finished) > 40
    removed = [episode.removed for episode in finished]
    assert max(removed) == pytest.approx(min(removed), rel=0.01)
    for cheap, dear in product(finished, finished):
        # The metal differs by 1 %, because sub-steps end elsewhere.
        if dear.cost > 1.01 * cheap.cost:
            assert dear.reward < cheap.reward

    assert programmed.reward_metal == pytest.approx(programmed_time, rel=0.05)
    assert fastest.edges_broken > programmed.edges_broken
    assert idle.time == pytest.approx(10.0 * programmed_time, abs=1.0)
    for worse in (idle, fastest, late):
        assert worse.reward < programmed.reward
    assert idle.reward < min(episode.reward for episode in finished)


def test_the_spindle_limits_the_cutting_speed_at_small_diameters(tmp_path: Path) -> None:
    program = tmp_path / "a.nc"
    program.write_text("G99 G50 S1000\nG96 S150 M3\nG0 X40. Z0.5\nG1 Z-30. F0.2\n")
    path = ToolPath(program, EVEN, stock="bar:43x80")
    steps = infos(path.scenario, [(1.0, 0.0)] * 5)
    assert steps[-1]["commanded_cutting_speed"] == pytest.approx(np.pi * 40.0)


def test_a_tool_path_is_a_scenario_of_every_batch() -> None:
    scenario = ToolPath(**arguments("abspanen")).scenario
    assert Scenario.load(scenario.portable()).digest() == scenario.digest()
    envs = RoughTurningVectorEnv(3, scenario)
    envs.reset(seed=1)
    *_, info = envs.step(np.zeros((3, 2), np.float32))
    single = infos(scenario, np.zeros((1, 2)), seed=1)[0]
    assert info["power"][0] == single["power"]


def test_the_environment_keeps_to_gymnasiums_rules() -> None:
    env = gymnasium.make("turning_nc:RoughTurning-Program-v1", **arguments("welle"))
    check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize("action", [[0.0], [0.0, np.nan], 0.0, "ab"])
def test_malformed_actions_are_refused(action: Any) -> None:
    env = gymnasium.make("turning_nc:RoughTurning-Program-v1", **arguments("welle"))
    env.reset(seed=0)
    with pytest.raises((TypeError, ValueError)):
        env.unwrapped.step(action)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        pytest.param({"scenario": "batch_casting"}, "part", id="scenario of parts"),
        pytest.param({"tool": "T9"}, "T9", id="unknown tool"),
        pytest.param({"stock": "bar:20x10"}, "cuts nothing", id="small stock"),
        pytest.param({"parts": 0}, "parts", id="no parts"),
    ],
)
def test_paths_that_cannot_be_played_are_refused(changes: dict[str, Any], named: str) -> None:
    with pytest.raises(NcError, match=named):
        ToolPath(**(arguments("welle") | changes))
