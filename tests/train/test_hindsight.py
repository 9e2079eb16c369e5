import numpy as np

from train.hindsight import FIELDS, HindsightVecEnv
from turning_env import Scenario

PATH, DEPTH, HARDNESS, USED_LIFE = range(len(FIELDS))


def test_an_interval_starts_where_the_one_before_has_ended() -> None:
    env = HindsightVecEnv(Scenario.model_validate({"tool": {"wear_criterion": 0.12}}), 8)
    env.seed(3)
    env.reset()
    last, ends = np.zeros((len(FIELDS), 8)), 0
    for _ in range(200):
        _, _, ended, _ = env.step(np.full((8, 2), 0.1, np.float32))
        np.testing.assert_array_equal(env.before, last)
        assert (env.after[PATH] >= env.before[PATH]).all()
        assert (env.after[USED_LIFE] >= env.before[USED_LIFE]).all()
        assert ((env.after[DEPTH] > 0) == (env.after[HARDNESS] > 0)).all()
        last = np.where(ended, 0.0, env.after)
        ends += ended.sum()
        assert not env.changed.any()
    assert ends > 8


def test_edges_that_are_changed_on_command_have_not_failed() -> None:
    env = HindsightVecEnv(Scenario.load("shift"), 2)
    env.seed(3)
    env.reset()
    for interval in range(1200):
        change = [1.0 if interval == 50 else -1.0, -1.0]
        env.step(np.stack([[0.02, 0.02], [0.02, 0.02], change], axis=1).astype(np.float32))
        if interval == 50:
            assert env.changed.tolist() == [True, False]
            assert not env.failed.any()
            assert env.after[USED_LIFE, 0] < env.before[USED_LIFE, 0]
        if env.failed.any():
            assert (env.changed >= env.failed).all()
            return
    raise AssertionError("no edge was worn out")
