"""The search of the loop's numbers on a family's training jobs."""

import numpy as np
import pytest

from baselines.load_loop import JOB_SCALE, JOB_START, JobNumbers
from tests.turning_env.test_family_env import BRIEF_FAMILY
from train import tune, tune_loop
from train.tune_loop import Budget, mean_returns, numbers_of, search
from turning_env import FamilyVectorEnv

BUDGET = Budget(generations=2, candidates=4, jobs=2, episode_steps=30)


def test_a_search_starts_at_the_rule_as_set_by_hand():
    size = len(JobNumbers._fields)
    np.testing.assert_array_equal(numbers_of(np.zeros(size)), JOB_START)
    one_up = numbers_of(np.eye(size)[3])
    assert one_up.plan_share == pytest.approx(JOB_START.plan_share + JOB_SCALE.plan_share)
    assert one_up.speed == JOB_START.speed


def test_candidates_play_the_same_jobs():
    env = FamilyVectorEnv(6, BRIEF_FAMILY, context="hidden", autoreset_mode="SameStep")
    start = np.zeros(len(JobNumbers._fields))
    idle = start.copy()
    idle[JobNumbers._fields.index("target")] = -50.0  # a load of nearly nothing
    returns = mean_returns(env, [start, idle, start], 5, BUDGET)
    assert returns[0] == returns[2]
    assert returns[0] > returns[1] + 5.0


def test_a_seed_determines_the_result():
    found = search(BRIEF_FAMILY, BUDGET, seed=3)
    assert found == search(BRIEF_FAMILY, BUDGET, seed=3)
    assert found != search(BRIEF_FAMILY, BUDGET, seed=4)


def test_the_command_prints_every_number(monkeypatch, capsys):
    monkeypatch.setattr(tune_loop, "search", lambda family, budget, seed: JOB_START)
    assert tune.main(["loop", "--family", "shop", "--jobs", "3"]) == 0
    printed = capsys.readouterr().out
    for name in JobNumbers._fields:
        assert f"{name}=" in printed


def test_an_unknown_family_is_named(capsys):
    assert tune.main(["loop", "--family", "nonsense"]) == 2
    assert "nonsense" in capsys.readouterr().err
