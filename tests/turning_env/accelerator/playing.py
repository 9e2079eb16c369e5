"""Plays of the accelerator and of the processor, to be compared."""

from typing import Any

import numpy as np

from tests.turning_env.playing import SHORT_LIVED, Record, changed, fixed_actions
from turning_env import RoughTurningVectorEnv, Scenario

CASES: dict[str, tuple[Any, int, int]] = {
    "ends": (changed(SHORT_LIVED, tool={"edge_strength": 700.0}, control={"sub_steps": 2, "time_limit": 0.2}), 3, 26),
    "two_blocks": (changed(Scenario(), control={"sub_steps": 1}), 33, 2),
    "many_nodes": (changed(Scenario(), workpiece={"depth_correlation_length": 0.5, "bar_length": 3.0}), 4, 3),
    **{preset: (preset, 2, 3) for preset in ("paper", "override", "surface", "shift", "forging_skin", "rough_turning_current")},
    "batch": (changed(Scenario.load("batch_casting"), control={"sub_steps": 5}), 2, 3),
}
"""By name: scenario, lanes and intervals. Few, as the simulator takes tens of milliseconds for every lane's interval."""
SEED = 21


def processor_plays(name: str) -> Record:
    """What the vector environment gives, row 0 being the reset."""
    scenario, lanes, count = CASES[name]
    env = RoughTurningVectorEnv(lanes, scenario)
    observations, infos = env.reset(seed=SEED)
    rows = [{"observation": observations, "reward": np.zeros(lanes), "terminated": np.zeros(lanes, bool)} | told(infos)]
    for actions in fixed_actions(count, lanes, scenario):
        observations, rewards, terminated, _, infos = env.step(actions)
        rows.append({"observation": observations, "reward": rewards, "terminated": terminated} | told(infos))
    return {key: np.stack([row[key] for row in rows]) for key in rows[0]}


def told(infos: dict[str, Any]) -> dict[str, Any]:
    """The infos without masks, all of them float64."""
    return {name: values.astype(np.float64) for name, values in infos.items() if not name.startswith("_")}


def accelerator_plays(name: str) -> Record:
    """What the accelerator gives, or its simulator."""
    from turning_env.accelerator import AcceleratedLathes

    scenario, lanes, count = CASES[name]
    lathes = AcceleratedLathes(lanes, scenario)
    rows: list[dict[str, Any]] = []

    def note() -> None:
        arrays = {"observation": lathes.observations, "reward": lathes.rewards, "terminated": lathes.ends}
        answers = {key: array.copy_to_host().copy() for key, array in arrays.items()}
        rows.append(answers | {"terminated": answers["terminated"][0]} | lathes.info())

    lathes.reset(SEED)
    note()
    for actions in fixed_actions(count, lanes, scenario):
        lathes.step(on_device(actions))
        note()
    lathes.check()
    return {key: np.stack([row[key] for row in rows]) for key in rows[0]}


def on_device(actions: Any) -> Any:
    """Actions in the memory of the accelerator, or its simulator."""
    from numba import cuda

    return cuda.to_device(np.ascontiguousarray(actions))
