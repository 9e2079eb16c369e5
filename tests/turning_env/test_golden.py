"""Golden trajectories: one per id, as recorded when its version was released.

A failure means that an id no longer gives the trajectories that its version promises: register a new version. After
that, or for a new id, write the files with ``python -m tests.turning_env.test_golden``.
"""

import json
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from tests.turning_env.playing import fixed_actions, play
from turning_env import IDS

FOLDER = Path(__file__).parents[1] / "golden"
SEED = 2024
INTERVALS = 400
EVERY = 20


def trajectory(env_id: str) -> dict[str, Any]:
    """Every ``EVERY``-th row of a play, and all rows at which an episode ends."""
    env = gymnasium.make(env_id).unwrapped
    record = play(env, SEED, fixed_actions(INTERVALS, 1, env.scenario)[:, 0])
    rows = np.flatnonzero((np.arange(INTERVALS + 1) % EVERY == 0) | record["terminated"] | record["truncated"])
    return {
        "id": env_id,
        "seed": SEED,
        "scenario": env.scenario.digest(),
        "rows": rows.tolist(),
    } | {key: values[rows].tolist() for key, values in record.items()}


@pytest.mark.parametrize("env_id", IDS)
def test_trajectory_is_as_released(env_id):
    golden = json.loads((FOLDER / f"{env_id}.json").read_text("utf-8"))
    present = trajectory(env_id)
    # Keys may be added to info without a new version; none may go or change.
    for key, expected in golden.items():
        if isinstance(expected, list):
            # float32 holds no more than seven digits, and may be rounded the other way.
            tolerance = 2e-7 if key == "observation" else 1e-9
            assert np.array(present[key]) == pytest.approx(np.array(expected), rel=tolerance, abs=tolerance), key
        else:
            assert present[key] == expected, key


def test_every_golden_file_has_an_id():
    assert {path.stem for path in FOLDER.glob("RoughTurning-*.json")} == set(IDS)


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for released in IDS:
        lines = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in trajectory(released).items()]
        (FOLDER / f"{released}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")
