"""A program's tool path as a workpiece: its time, its metal, the spindle's limit, and what is refused."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

pytest.importorskip("shapely")

from examples.adapt_programs import COLLECTION, path_of
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario, ScenarioError
from turning_env.programs.environment import ToolPath
from turning_env.programs.program import NcError

EVEN: dict[str, Any] = {
    "machine": {"feed_time_constant": 0.0, "spindle_time_constant": 0.0},
    "workpiece": dict.fromkeys(("depth_bar_spread", "depth_along_spread", "hardness_bar_spread", "hardness_along_spread"), 0.0),
}


def arguments(name: str) -> dict[str, Any]:
    return {"program": str(path_of(name)), "stock": COLLECTION[name]["stock"], "tools": COLLECTION[name].get("tools", {})}


def first_part(env: gymnasium.Env[Any, Any], action: np.ndarray[Any, Any]) -> tuple[float, float, dict[str, Any]]:
    """Return time [s] and removed metal [cm3] of the first part."""
    env.reset(seed=0)
    time = removed = 0.0
    while True:
        *_, info = env.step(action)
        if info["bar"] >= 1 or info["wear"] >= 0.3:
            return time, removed, info
        time += info["time"]
        removed += info["removed"]


@pytest.mark.parametrize("name", ["welle", "stepped_shaft"])
def test_the_programmed_values_take_the_programs_time(name: str) -> None:
    env = gymnasium.make("turning_env:RoughTurning-Program-v0", scenario=EVEN, **arguments(name))
    path = env.unwrapped.tool_path  # type: ignore[attr-defined]
    speed = float(np.median(path.speeds))
    machine = path.scenario.machine
    low, high = machine.cutting_speed_min, machine.cutting_speed_max
    action = np.array([0.0, 2.0 * (speed - low) / (high - low) - 1.0], np.float32)
    time, removed, _ = first_part(env, action)
    around = np.pi * path.diameter / 1000.0
    expected = float((path.lengths * around / (speed * path.feeds)).sum() * 60.0)
    assert time == pytest.approx(expected, rel=0.05)  # feeds change at the ends of steps
    workpiece = path.scenario.workpiece
    metal = np.pi * path.diameter * np.dot(workpiece.depth_profile, workpiece.section_lengths) / 1000.0
    assert removed == pytest.approx(metal, rel=0.03)


def test_the_spindle_limits_the_cutting_speed_at_small_diameters(tmp_path: Path) -> None:
    (tmp_path / "a.nc").write_text("G99 G50 S1000\nG96 S150 M3\nG0 X40. Z0.5\nG1 Z-30. F0.2\n")
    env = RoughTurningEnv(ToolPath(tmp_path / "a.nc", EVEN, "bar:43x80").scenario)
    env.reset(seed=0)
    for _ in range(5):
        *_, info = env.step(np.array([1.0, 0.0], np.float32))
    assert info["commanded_cutting_speed"] == pytest.approx(np.pi * 40.0)


def test_a_tool_path_is_a_scenario_of_every_batch() -> None:
    path = ToolPath(**arguments("abspanen"))
    assert Scenario.load(path.scenario.portable()).digest() == path.scenario.digest()
    envs = RoughTurningVectorEnv(3, path.scenario)
    envs.reset(seed=1)
    *_, infos = envs.step(np.zeros((3, 2), np.float32))
    alone = RoughTurningEnv(path.scenario)
    alone.reset(seed=1)
    *_, info = alone.step(np.zeros(2, np.float32))
    assert infos["power"][0] == info["power"]


def test_given_lengths_that_are_equal_change_nothing() -> None:
    base = Scenario.load("override")
    count = len(base.workpiece.depth_profile)
    lengths = (base.workpiece.bar_length / count,) * count
    infos = []
    for scenario in (base, {"base": "override", "workpiece": {"section_lengths": lengths}}):
        env = RoughTurningEnv(scenario)
        env.reset(seed=3)
        for _ in range(40):
            *_, info = env.step(np.ones(1, np.float32))
        infos.append(info)
    assert infos[0] == infos[1]


def test_the_environment_keeps_to_gymnasiums_rules() -> None:
    env = gymnasium.make("turning_env:RoughTurning-Program-v0", **arguments("welle"))
    check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=0)
    for wrong in ([0.0], [0.0, np.nan], 0.0, "ab"):
        with pytest.raises((TypeError, ValueError)):
            env.unwrapped.step(wrong)


@pytest.mark.parametrize(
    ("workpiece", "named"),
    [
        ({"depth_profile": [1.0, 2.0], "section_lengths": [300.0]}, "section_lengths"),
        ({"depth_profile": [1.0, 2.0], "section_lengths": [100.0, 100.0]}, "bar_length"),
        ({"depth_profile": [1.0, 2.0], "section_lengths": [400.0, -100.0]}, "above 0"),
        ({"depth_profile": [1.0, 0.0]}, "air"),
        ({"depth_profile": [1.0, 2.0], "section_speeds": [100.0]}, "section_speeds"),
    ],
)
def test_sections_that_disagree_are_refused(workpiece: dict[str, Any], named: str) -> None:
    with pytest.raises(ScenarioError, match=named):
        Scenario.load({"workpiece": workpiece})


@pytest.mark.parametrize(
    ("more", "named"),
    [({"scenario": "batch_casting"}, "part"), ({"tool": "T9"}, "T9"), ({"stock": "bar:20x10"}, "cuts nothing")],
)
def test_paths_that_cannot_be_played_are_refused(more: dict[str, Any], named: str) -> None:
    with pytest.raises(NcError, match=named):
        ToolPath(**(arguments("welle") | more))
