"""Golden trajectories: one per id in full, and a short one of every preset that differs.

They guard ``turning_env.physics.MODEL_VERSION``. If one fails, either undo the change, or raise the
version there and write the files again: ``python -m tests.turning_env.test_golden``.
"""

import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from tests.turning_env.playing import FAILING, HOT_SPINDLE, changed, fixed_actions, play
from turning_env import ALL_IDS, IDS, MODEL_VERSION, SPLITS, RoughTurningEnv, Scenario

FOLDER = Path(__file__).parents[1] / "golden"
SHORT = FOLDER / "short" / "trajectories.json"
SEED = 2024
STEPS = 400
EVERY = 20
"""Steps from one stored row to the next."""
ADVICE = (
    f"the model has changed: raise MODEL_VERSION ({MODEL_VERSION}) in "
    f"turning_env/physics/__init__.py, and {__doc__}"
)
RECORD = "record it with python -m tests.turning_env.test_golden, which writes the files again"

RIPPLE = {"depth_ripple": 0.1, "depth_profile": [1.5, 3.0]}
SKIN = {
    "skin_thickness": 0.5,
    "skin_hardness": 1.4,
    "skin_wear": 1.5,
    "hardness_factor": 1.1,
    "wear_factor": 1.2,
    "initial_wear": 0.05,
    "force_bias": 0.1,
}
OTHER_PRESETS = ("override_current", "override_torque", "practitioner", "rough_turning_current")
PRESETS = sorted({*IDS.values(), *SPLITS, *OTHER_PRESETS})
SCENARIOS = {
    "clock_time": changed(
        "rough_turning",
        tool={"wear_rule": "clock_time", "wear_criterion": 0.12},
        machine={"chip_lag": 1.5},
    ),
    "skin": changed("shift", mismatch=SKIN, workpiece=RIPPLE),
    "breaking": changed("rough_turning", tool={"edge_strength": 700.0}),
    "breaking_shift": changed(
        "shift", tool={"edge_strength": 800.0}, economics={"unplanned_stop": 1.0}
    ),
    "worn_shift": changed("shift", tool={"wear_criterion": 0.1}, control={"time_limit": 20.0}),
    "worn_batch": changed("batch_casting", tool={"wear_criterion": 0.1, "wear_rule": "clock_time"}),
    "overload": changed(
        "rough_turning", limits={"thrust_force": 500.0, "power": 2.0, "overload_tolerance": 0.3}
    ),
    "job": changed(
        "rough_turning", workpiece={"bars": 2, "bar_length": 20.0}, tool={"edge_strength": 1e6}
    ),
    "hot_spindle": HOT_SPINDLE,
    "surface_current": changed(
        "surface",
        sensors={"force": "servo_current", "force_noise": 0.1},
        surface={"reference_time": 0.1},
    ),
    "failing_shift": changed("shift", **FAILING),
    "failing_batch": changed("batch_casting", **FAILING),
}
SCENARIOS |= {preset: Scenario.load(preset) for preset in PRESETS}


def trajectory(env: RoughTurningEnv, steps: int, every: int) -> dict[str, Any]:
    """Return every ``every``-th row of a play, and all rows at which an episode ends."""
    record = play(env, SEED, fixed_actions(steps, 1, env.scenario)[:, 0])
    is_stored = np.arange(steps + 1) % every == 0
    rows = np.flatnonzero(is_stored | record["terminated"] | record["truncated"])
    stored: dict[str, Any] = {"rows": rows.tolist()}
    for key, values in record.items():
        stored[key] = values[rows].tolist()
    return stored


def assert_same(present: dict[str, Any], golden: dict[str, Any]) -> None:
    """Keys may be added to info without a new version; none may go or change."""
    for key, expected in golden.items():
        # float32 holds no more than seven digits, and may be rounded the other way.
        tolerance = 2e-7 if key == "observation" else 1e-9
        values = np.array(present[key], float)
        expected_values = np.array(expected, float)
        same = np.allclose(
            values,
            expected_values,
            rtol=tolerance,
            atol=tolerance,
        )
        assert same, f"{key}: {ADVICE}"


def short_trajectory(name: str) -> dict[str, Any]:
    """Return some rows of 8 parts, or of 60 steps; 200 reach the second bar."""
    scenario = SCENARIOS[name]
    if scenario.control.action == "part":
        steps = 8
    elif name == "skin":
        steps = 200
    else:
        steps = 60
    return trajectory(RoughTurningEnv(scenario), steps, max(1, steps // 8))


@pytest.mark.parametrize("name", SCENARIOS)
def test_short_trajectory_is_as_released(name):
    released = json.loads(SHORT.read_text("utf-8"))
    assert name in released, f"{name} has no golden trajectory: {RECORD}"
    golden = released[name]
    assert_same(short_trajectory(name), golden)


@pytest.mark.parametrize("env_id", ALL_IDS)
def test_trajectory_is_as_released(env_id):
    path = FOLDER / f"{env_id}.json"
    assert path.exists(), f"{env_id} has no golden trajectory: {RECORD}"
    golden = json.loads(path.read_text("utf-8"))
    assert golden.pop("id") == env_id
    assert golden.pop("seed") == SEED
    del golden["scenario"]
    env = gymnasium.make(env_id).unwrapped
    assert_same(trajectory(env, STEPS, EVERY), golden)


def test_every_golden_file_has_an_id():
    assert {path.stem for path in FOLDER.glob("RoughTurning-*.json")} == set(ALL_IDS)
    assert set(json.loads(SHORT.read_text("utf-8"))) == set(SCENARIOS)


def write_json(path: Path, values: dict[str, Any]) -> None:
    """Write a line for each key."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in values.items()]
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")


def write_golden_files() -> None:
    for env_id in ALL_IDS:
        env = gymnasium.make(env_id).unwrapped
        identity = {"id": env_id, "seed": SEED, "scenario": env.scenario.digest()}
        write_json(FOLDER / f"{env_id}.json", identity | trajectory(env, STEPS, EVERY))
    write_json(SHORT, {name: short_trajectory(name) for name in SCENARIOS})


if __name__ == "__main__":
    write_golden_files()
