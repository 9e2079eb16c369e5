"""Info: a plain dict of every field."""

import json
import pickle

import gymnasium
import numpy as np

from tests.turning_env.playing import fixed_actions
from turning_env import RoughTurningEnv, RoughTurningVectorEnv
from turning_env.info import EVERY_FIELD, with_values
from turning_env.physics.records import REPORT_FIELDS, REPORT_FLAGS

VALUES = [0.5 * number for number in range(len(REPORT_FIELDS))]


def test_every_field_has_its_value_and_flags_are_bool():
    info = with_values(EVERY_FIELD, VALUES)
    expected = {name: bool(value) if name in REPORT_FLAGS else value for name, value in zip(REPORT_FIELDS, VALUES, strict=True)}
    assert list(info.items()) == list(expected.items())
    assert {type(info[name]) for name in REPORT_FLAGS} == {bool}
    assert {type(value) for name, value in info.items() if name not in REPORT_FLAGS} == {float}
    assert not any(with_values(EVERY_FIELD, [0.0] * len(VALUES))[name] for name in REPORT_FLAGS)


def test_it_is_a_plain_dict_of_its_own():
    info, other = with_values(EVERY_FIELD, VALUES), with_values(EVERY_FIELD, VALUES)
    assert type(info) is dict
    info["wear"] = -1.0
    info["episode"] = {}
    del info["power"]
    assert with_values(EVERY_FIELD, VALUES) == other
    assert json.loads(json.dumps(other)) == pickle.loads(pickle.dumps(other)) == {**other} == other


def test_a_step_s_info_is_that_of_a_lane():
    env, envs = RoughTurningEnv(), RoughTurningVectorEnv(1)
    infos = [(env.reset(seed=3)[1], envs.reset(seed=3)[1])]
    infos += [(env.step(action[0])[4], envs.step(action)[4]) for action in fixed_actions(30, 1)]
    assert any(info["cutting"] for info, _ in infos)
    for info, lane in infos:
        assert {name: (value, type(value)) for name, value in info.items()} == {
            name: (lane[name].item(), type(lane[name].item())) for name in REPORT_FIELDS
        }


def test_gymnasium_s_wrappers_find_what_they_expect():
    env = gymnasium.wrappers.RecordEpisodeStatistics(gymnasium.make("RoughTurning-v0", max_episode_steps=3))
    env.reset(seed=0)
    *_, info = [env.step(np.zeros(2, np.float32))[4] for _ in range(3)]
    assert info.keys() - {"TimeLimit.truncated"} == {*REPORT_FIELDS, "episode"}  # which some libraries have the limit add
    envs = gymnasium.vector.SyncVectorEnv([RoughTurningEnv, RoughTurningEnv])
    envs.reset(seed=0)
    assert envs.step(np.zeros((2, 2), np.float32))[4].keys() == {name for field in REPORT_FIELDS for name in (field, "_" + field)}
