"""Shared parts of the environment's tests.

Scenarios made for testing, fixed actions, and records of what an environment says.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, get_args

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.typing import NDArray
from pydantic.fields import FieldInfo

from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.physics.quantities import action_size
from turning_env.scenario.section import Section

Record = dict[str, NDArray[Any]]
STEPS = 80
"""Steps in which many environments are compared with single ones."""


def changed(scenario: Any, **sections: dict[str, Any]) -> Scenario:
    """Return a scenario with some values replaced, which are validated.

    Example: ``changed("paper", tool={"wear_criterion": 0.1})``.
    """
    values = Scenario.load(scenario).model_dump()
    for section, replaced in sections.items():
        values[section] |= replaced
    return Scenario.model_validate(values)


SHORT_LIVED = changed(
    Scenario(), tool={"wear_criterion": 0.11, "edge_strength": 1000.0}, control={"time_limit": 0.5}
)
"""Episodes of at most 30 steps, which end in all three ways: worn, broken and out of time."""

FAILING: dict[str, dict[str, Any]] = {
    "edge_failure": {
        "collapse_temperature": 850.0,
        "tertiary_wear": 0.1,
        "tertiary_rate": 30.0,
        "chipping_rate": 300.0,
        "chipping_load_exponent": 2.0,
        "chipping_wear_exponent": 1.5,
    },
    "swarf": {
        "tangle_rate": 20.0,
        "tangle_time": 0.1,
        "chip_feed_min": 0.2,
        "chip_feed_max": 0.4,
    },
    "workpiece": {"support": "tailstock", "bar_length": 100.0, "diameter": 15.0},
}
"""Sections with many effects within a few steps: edges collapse and chip, wear speeds up, chips
tangle, and bars bend."""

NO_SPREAD = {
    "hardness_bar_spread": 0.0,
    "hardness_along_spread": 0.0,
    "depth_bar_spread": 0.0,
    "depth_along_spread": 0.0,
}
"""Values of a workpiece for bars that are all of one hardness and depth."""

UNDISTURBED = changed("paper", tool={"wear_rule": "equivalent_time", "edge_strength": 1e6})
"""A lathe with one metal and one depth, without lags, noise or air, whose edge does not break.

Actions are set points, and a step takes a minute.
"""


HOT_SPINDLE = changed(
    "shift",
    spindle={
        "base_speed": 450.0,
        "max_speed": 600.0,
        "idle_torque": 6.0,
        "reading": "torque",
        "short_time_load": 1.4,
        "thermal_time_constant": 0.3,
    },
    machine={"rated_power": 3.0},
    limits={"power": 3.0},
    tool={"wear_criterion": 0.12},
)
"""A spindle with all that it can have, soon hot, and edge changes in which it cools."""


def variants(
    section: Any, others: Callable[[Any, FieldInfo], Iterable[Any]], prefix: str = ""
) -> Iterator[tuple[str, Any]]:
    """Yield copies in which one value differs, each with the dotted name of that value.

    ``others`` gives the other values that a value and its field may have. The copies are not
    validated. The name and the nominal model are left as they are.
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
    """Return another value close by; of a choice, all others; of a list, one that is longer."""
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
    """Return actions of shape (count, num_envs, action size) by formula.

    They are slow waves that sweep the ranges, and reach beyond -1..1.
    """
    scenario = Scenario.load(scenario)
    phase = np.arange(count)[:, np.newaxis] + 17.0 * np.arange(num_envs)
    waves = []
    for number in range(action_size(scenario)):
        angle = (0.05 + 0.06 * number) * phase + 0.3 + 0.5 * number
        waves.append(1.2 * np.sin(angle))
    if scenario.control.edge_changes == "commanded":
        waves[-1] -= 1.1  # an edge is changed now and then
    return np.stack(waves, axis=2).astype(np.float32)


def assert_plays_as_single_environments(
    scenario: Any,
    mode: AutoresetMode = AutoresetMode.NEXT_STEP,
    num_envs: int = 3,
    steps: int = STEPS,
) -> None:
    """Fail unless many environments give the bits of single ones, through several episodes."""
    envs = RoughTurningVectorEnv(num_envs, scenario, mode)
    singles = SyncVectorEnv([lambda: RoughTurningEnv(scenario)] * num_envs, autoreset_mode=mode)
    assert_same_answers(envs.reset(seed=2**63), singles.reset(seed=2**63))
    for actions in fixed_actions(steps, num_envs, scenario):
        answers = envs.step(actions)
        assert_same_answers(answers, singles.step(actions))
        ended = answers[2] | answers[3]
        if mode is AutoresetMode.DISABLED and ended.any():
            started = envs.reset(options={"reset_mask": ended.copy()})
            expected = singles.reset(options={"reset_mask": ended.copy()})
            assert_same_answers(started, expected)
    assert_same_answers(envs.reset(), singles.reset())


def assert_same_answers(answers: Any, expected_answers: Any) -> None:
    """Fail unless two resets or steps give the same bits."""
    *arrays, infos = answers
    *expected_arrays, expected_infos = expected_answers
    for array, expected in zip(arrays, expected_arrays, strict=True):
        assert array.dtype == expected.dtype
        assert array.shape == expected.shape
        assert array.tobytes() == expected.tobytes()
    _assert_same_infos(infos, expected_infos)


def _assert_same_infos(infos: dict[str, Any], expected_infos: dict[str, Any]) -> None:
    """Fail unless keys, masks and types are the same, and the bits that the masks choose."""
    assert infos.keys() == expected_infos.keys()
    for key, expected in expected_infos.items():
        if isinstance(expected, dict):
            _assert_same_infos(infos[key], expected)
            continue
        assert infos[key].dtype == expected.dtype, key
        mask = slice(None) if key.startswith("_") else expected_infos["_" + key]
        chosen = infos[key][mask]
        expected_chosen = expected[mask]
        if expected.dtype == object:
            chosen = np.stack(list(chosen))
            expected_chosen = np.stack(list(expected_chosen))
        assert chosen.tobytes() == expected_chosen.tobytes(), key


def play(env: RoughTurningEnv, seed: int | None, actions: NDArray[np.float32]) -> Record:
    """Return everything that the single environment says: a row for the reset and every action.

    Where an episode has ended, the next action is ignored and the next episode starts, as with
    NEXT_STEP autoreset.
    """
    rows: list[dict[str, Any]] = []

    def note(
        observation: Any, reward: float, terminated: bool, truncated: bool, info: dict[str, Any]
    ) -> None:
        row = {
            "observation": observation,
            "reward": reward,
            "terminated": terminated,
            "truncated": truncated,
        }
        rows.append(row | info)

    def start(seed: int | None) -> None:
        observation, info = env.reset(seed=seed)
        note(observation, 0.0, terminated=False, truncated=False, info=info)

    start(seed)
    for action in actions:
        if rows[-1]["terminated"] or rows[-1]["truncated"]:
            start(None)
        else:
            note(*env.step(action))
    return {key: np.array([row[key] for row in rows]) for key in rows[0]}


def infos(source: Any, actions: Iterable[Any], seed: int = 0) -> list[dict[str, Any]]:
    """Return the infos of the steps of an environment or a scenario, until the episode ends.

    Each also holds the reward, terminated and truncated.
    """
    env = source if isinstance(source, gymnasium.Env) else RoughTurningEnv(source)
    env.reset(seed=seed)
    steps = []
    for action in actions:
        _, reward, terminated, truncated, info = env.step(action)
        outcome = {"reward": reward, "terminated": terminated, "truncated": truncated}
        steps.append(info | outcome)
        if terminated or truncated:
            break
    return steps


def assert_same_bytes(record: Record, expected: Record) -> None:
    """Fail unless both records hold the same keys, types and bits."""
    assert record.keys() == expected.keys()
    for key, values in record.items():
        assert values.dtype == expected[key].dtype, key
        assert values.tobytes() == expected[key].tobytes(), key
