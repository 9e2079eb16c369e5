"""A program's tool path as a workpiece: its time, its metal, and the spindle's limit."""

from itertools import chain, product, repeat
from pathlib import Path
from typing import Any

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

EVEN: dict[str, Any] = {
    "machine": {"feed_time_constant": 0.0, "spindle_time_constant": 0.0},
    "workpiece": dict.fromkeys(
        ("depth_bar_spread", "depth_along_spread", "hardness_bar_spread", "hardness_along_spread"),
        0.0,
    ),
}


def arguments(name: str) -> dict[str, Any]:
    return {
        "program": str(path_of(name)),
        "stock": COLLECTION[name]["stock"],
        "tools": COLLECTION[name].get("tools", {}),
    }


@pytest.mark.parametrize("name", ["welle", "stepped_shaft"])
def test_the_programmed_values_take_the_programs_time_and_remove_its_metal(name: str) -> None:
    env = gymnasium.make(
        "turning_nc:RoughTurning-Program-v1", scenario=EVEN, parts=1, **arguments(name)
    )
    path = env.unwrapped.tool_path  # type: ignore[attr-defined]
    speed, machine, workpiece = (
        float(np.median(path.speeds)),
        path.scenario.machine,
        path.scenario.workpiece,
    )
    low, high = machine.cutting_speed_min, machine.cutting_speed_max
    steps = infos(
        env, repeat(np.array([0.0, 2.0 * (speed - low) / (high - low) - 1.0], np.float32))
    )
    time, removed = (sum(info[name] for info in steps) for name in ("time", "removed"))
    around = np.pi * path.diameter / 1000.0
    assert time == pytest.approx(
        (path.lengths * around / (speed * path.feeds)).sum() * 60.0, rel=0.05
    )
    assert removed == pytest.approx(
        around * np.dot(workpiece.depth_profile, workpiece.section_lengths), rel=0.03
    )


TAPER = """G99 G50 S3000
G96 S120 M3
G0 X72. Z1.
G1 X80. Z-40. F0.2
G0 X84. Z1.
G0 X64.
G1 X80. Z-40.
"""
SHORT: dict[str, Any] = {  # edges that last some parts, and times in proportion
    "base": "practitioner",
    "mismatch": {"wear_factor": 2.0},
    "economics": {
        "edge_cost": 0.3,
        "edge_change_time": 0.2,
        "unplanned_stop": 0.3,
        "breakage_downtime": 1.0,
    },
}
PROGRAMMED, IDLE, FASTEST = (0.0, -1.0 / 15.0), (-1.0, -1.0), (1.0, 1.0)
"""Actions: 120 m/min at the programmed feed; lowest and highest feed and speed.

The highest break edges.
"""


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

    def play(*actions: tuple[float, float]) -> dict[str, float]:
        """Return the sums of an episode; the last action is repeated."""
        steps = infos(env, chain(actions, repeat(actions[-1])), seed)
        sums = {
            name: sum(info[name] for info in steps)
            for name in ("reward", "removed", "reward_metal", "time", "edges_broken")
        }
        return sums | {
            "finished": steps[-1]["finished"],
            "cost": (sums["reward_metal"] - sums["reward"]) / sums["removed"],
        }

    programmed, idle, fastest = play(PROGRAMMED), play(IDLE), play(FASTEST)
    constant = [
        play((feed, speed))
        for feed in np.linspace(-1.0, 1.0, 7)
        for speed in np.linspace(-1.0, 1.0, 7)
    ]
    finished = [episode for episode in [*constant, programmed] if episode["finished"]]
    assert len(finished) > 40
    assert max(episode["removed"] for episode in finished) == pytest.approx(
        min(episode["removed"] for episode in finished), rel=0.01
    )
    for cheap, dear in product(finished, finished):
        if (
            dear["cost"] > 1.01 * cheap["cost"]
        ):  # the removed metal differs by as much, because sub-steps end elsewhere
            assert dear["reward"] < cheap["reward"]
    assert programmed["reward_metal"] == pytest.approx(programmed_time, rel=0.05)
    assert fastest["edges_broken"] > programmed["edges_broken"]
    assert idle["time"] == pytest.approx(10.0 * programmed_time, abs=1.0)
    assert (
        max(episode["reward"] for episode in (idle, fastest, play(*[IDLE] * 30, PROGRAMMED)))
        < programmed["reward"]
    )
    assert idle["reward"] < min(episode["reward"] for episode in finished)


def test_the_spindle_limits_the_cutting_speed_at_small_diameters(tmp_path: Path) -> None:
    (tmp_path / "a.nc").write_text("G99 G50 S1000\nG96 S150 M3\nG0 X40. Z0.5\nG1 Z-30. F0.2\n")
    steps = infos(ToolPath(tmp_path / "a.nc", EVEN, "bar:43x80").scenario, [(1.0, 0.0)] * 5)
    assert steps[-1]["commanded_cutting_speed"] == pytest.approx(np.pi * 40.0)


def test_a_tool_path_is_a_scenario_of_every_batch() -> None:
    path = ToolPath(**arguments("abspanen"))
    assert Scenario.load(path.scenario.portable()).digest() == path.scenario.digest()
    envs = RoughTurningVectorEnv(3, path.scenario)
    envs.reset(seed=1)
    *_, together = envs.step(np.zeros((3, 2), np.float32))
    assert together["power"][0] == infos(path.scenario, np.zeros((1, 2)), 1)[0]["power"]


def test_the_environment_keeps_to_gymnasiums_rules() -> None:
    env = gymnasium.make("turning_nc:RoughTurning-Program-v1", **arguments("welle"))
    check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=0)
    for wrong in ([0.0], [0.0, np.nan], 0.0, "ab"):
        with pytest.raises((TypeError, ValueError)):
            env.unwrapped.step(wrong)


@pytest.mark.parametrize(
    ("more", "named"),
    [
        ({"scenario": "batch_casting"}, "part"),
        ({"tool": "T9"}, "T9"),
        ({"stock": "bar:20x10"}, "cuts nothing"),
        ({"parts": 0}, "parts"),
    ],
)
def test_paths_that_cannot_be_played_are_refused(more: dict[str, Any], named: str) -> None:
    with pytest.raises(NcError, match=named):
        ToolPath(**(arguments("welle") | more))
