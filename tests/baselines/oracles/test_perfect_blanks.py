import numpy as np
import pytest

from baselines import catalogue
from baselines.oracles import perfect_blanks
from baselines.oracles.perfect_blanks import PerfectBlanks, covers
from leaderboard.play import play
from leaderboard.seeds import tuning_seeds
from tests.turning_env.playing import changed
from turning_env import Scenario

BATCH = Scenario.load("batch_casting")
SEEDS = tuning_seeds(4)


def test_knowing_the_blanks_is_worth_more_than_probing_them() -> None:
    brief = changed(BATCH, workpiece={"bars": 5})
    probed = play(catalogue.spec("parts_mt", brief, tuned_on=BATCH).make, brief, SEEDS)
    known = play(lambda num_envs: PerfectBlanks(brief, SEEDS), brief, SEEDS, tell=True)
    assert (known["return"] > probed["return"]).all()


def test_a_plan_costs_what_the_lathe_charges(monkeypatch: pytest.MonkeyPatch) -> None:
    # The edge does not end, so the stop to change it is not in the price of its life.
    brief = changed(
        BATCH,
        workpiece={"bars": 1},
        economics={"edge_change_time": 0.0, "unplanned_stop": 0.0},
    )
    plans = []
    best_plan = perfect_blanks.best_plan

    def noted(*arguments: object) -> perfect_blanks.BlankPlan:
        plans.append(best_plan(*arguments))
        return plans[-1]

    monkeypatch.setattr(perfect_blanks, "best_plan", noted)
    episodes = play(lambda num_envs: PerfectBlanks(brief, SEEDS), brief, SEEDS, tell=True)
    planned = 60.0 * np.array([plan.cost for plan in plans[: len(SEEDS)]])
    charged = episodes["reward_metal"] - episodes["return"]
    assert planned == pytest.approx(charged, rel=0.02)


def test_it_says_what_it_covers() -> None:
    presets = ("batch_casting", "rough_turning", "shift")
    covered = {preset for preset in presets if covers(Scenario.load(preset))}
    assert covered == {"batch_casting"}
    assert not covers(Scenario.load("batch_p20"))
