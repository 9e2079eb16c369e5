"""Shared parts of the environment's tests: scenarios made for testing, fixed actions, and the record of a play."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, get_args

import gymnasium
import numpy as np
from numpy.typing import NDArray
from pydantic.fields import FieldInfo

from turning_env import RoughTurningEnv, Scenario
from turning_env.physics.quantities import action_size
from turning_env.scenario.section import Section

Record = dict[str, NDArray[Any]]


def changed(scenario: Any, **sections: dict[str, Any]) -> Scenario:
    """Return a scenario with some values replaced, validated anew: ``changed("paper", tool={"wear_criterion": 0.1})``."""
    values = Scenario.load(scenario).model_dump()
    for section, replaced in sections.items():
        values[section] |= replaced
    return Scenario.model_validate(values)


SHORT_LIVED = changed(
    Scenario(), tool={"wear_criterion": 0.11, "edge_strength": 1000.0}, control={"time_limit": 0.5}
)
"""Episodes of at most 30 intervals, which end in all three ways: worn, broken and out of time."""

FAILING: dict[str, dict[str, Any]] = {
    "edge_failure": {
        **{"collapse_temperature": 850.0, "tertiary_wear": 0.1, "tertiary_rate": 30.0},
        **{"chipping_rate": 300.0, "chipping_load_exponent": 2.0, "chipping_wear_exponent": 1.5},
    },
    "swarf": {"tangle_rate": 20.0, "tangle_time": 0.1, "chip_feed_min": 0.2, "chip_feed_max": 0.4},
    "workpiece": {"support": "tailstock", "bar_length": 100.0, "diameter": 15.0},
}
"""Sections with which edges collapse and chip, wear speeds up, chips tangle and bars bend within a few steps."""

UNDISTURBED = changed("paper", tool={"wear_rule": "equivalent_time", "edge_strength": 1e6})
"""A lathe with one metal, one depth, no lags, no noise, no air, an edge that does not break; actions are set points."""


HOT_SPINDLE = changed(
    Scenario.load("shift"),
    spindle={"base_speed": 450.0, "max_speed": 600.0, "idle_torque": 6.0, "reading": "torque"}
    | {"short_time_load": 1.4, "thermal_time_constant": 0.3},
    machine={"rated_power": 3.0},
    limits={"power": 3.0},
    tool={"wear_criterion": 0.12},
)
"""A spindle with all that it can have, soon hot, and edge changes in which it cools."""


def variants(
    section: Any, others: Callable[[Any, FieldInfo], Iterable[Any]], prefix: str = ""
) -> Iterator[tuple[str, Any]]:
    """Copies in which one value differs, with its dotted name: ``others`` gives what else a value and its field may be.

    The copies are not validated. The name and the nominal model are left as they are.
    """
    for name, field in type(section).model_fields.items():
        value = getattr(section, name)
        if isinstance(value, Section):
            for inner_name, inner in variants(value, others, f"{prefix}{name}."):
                yield inner_name, section.model_copy(update={name: inner})
        elif name not in ("name", "nominal_model"):
            for other in others(value, field):
                yield prefix + name, section.model_copy(update={name: other})


def slightly_different(value: Any, field: FieldInfo) -> list[Any]:
    """Another value close by; of a choice, every other; of a list, one longer."""
    if isinstance(value, str):
        return [choice for choice in get_args(field.annotation) if choice != value]
    if isinstance(value, bool):
        return [not value]
    if isinstance(value, tuple):
        return [(*value, 1.0)]
    return [value + 1 if value == int(value) else value * 1.01]


def fixed_actions(
    count: int, num_envs: int, scenario: Any = "rough_turning"
) -> NDArray[np.float32]:
    """Actions of shape (count, num_envs, action size) by formula: slow waves that sweep the ranges, and reach beyond -1..1."""
    scenario = Scenario.load(scenario)
    phase = np.arange(count)[:, None] + 17.0 * np.arange(num_envs)
    numbers = range(action_size(scenario))
    waves = [
        1.2 * np.sin((0.05 + 0.06 * number) * phase + 0.3 + 0.5 * number) for number in numbers
    ]
    if scenario.control.edge_changes == "commanded":
        waves[-1] -= 1.1  # an edge is changed now and then
    return np.stack(waves, axis=2).astype(np.float32)


def play(env: RoughTurningEnv, seed: int | None, actions: NDArray[np.float32]) -> Record:
    """Everything that the single environment says: one row for the reset, then one for every action.

    Where an episode has ended, the next action is ignored and the next episode starts, as with NEXT_STEP autoreset.
    """
    rows: list[dict[str, Any]] = []

    def note(
        observation: Any, reward: float, terminated: bool, truncated: bool, info: dict[str, Any]
    ) -> None:
        rows.append(
            {
                "observation": observation,
                "reward": reward,
                "terminated": terminated,
                "truncated": truncated,
                **info,
            }
        )

    def start(seed: int | None) -> None:
        observation, info = env.reset(seed=seed)
        note(observation, 0.0, False, False, info)

    start(seed)
    for action in actions:
        if rows[-1]["terminated"] or rows[-1]["truncated"]:
            start(None)
        else:
            note(*env.step(action))
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def infos(source: Any, actions: Iterable[Any], seed: int = 0) -> list[dict[str, Any]]:
    """Return the infos of the steps of an environment or a scenario, with what else a step returns, until the episode ends."""
    env, found = source if isinstance(source, gymnasium.Env) else RoughTurningEnv(source), []
    env.reset(seed=seed)
    for action in actions:
        _, reward, terminated, truncated, info = env.step(action)
        found.append(info | {"reward": reward, "terminated": terminated, "truncated": truncated})
        if terminated or truncated:
            break
    return found


def assert_same_bytes(ours: Record, theirs: Record) -> None:
    """Both records hold the same keys, types and bits."""
    assert ours.keys() == theirs.keys()
    for key, values in ours.items():
        assert values.dtype == theirs[key].dtype, key
        assert values.tobytes() == theirs[key].tobytes(), key
