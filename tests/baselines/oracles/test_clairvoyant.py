from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from baselines.oracles import clairvoyant
from baselines.oracles.clairvoyant import TOLERANCE, Grid, bounds, covers
from baselines.oracles.perfect_state import PerfectState
from turning_env import IDS, RoughTurningVectorEnv, Scenario
from turning_env.scoring.play import play
from turning_env.scoring.seeds import tuning_seeds

BASE = Scenario.load("rough_turning")
SEEDS = tuning_seeds(3)
COARSE = Grid(10.0, 60, 8)


@pytest.fixture(scope="module")
def bound() -> NDArray[np.float64]:
    return bounds(BASE, SEEDS)


def allowed(bound: Any, machine_time: Any) -> Any:
    """What may be earned [s] in view of the steps of the bound's grids."""
    return bound + TOLERANCE * machine_time


@pytest.mark.slow
def test_knowing_the_present_earns_less_than_knowing_all_but_not_much_less(bound: NDArray[np.float64]) -> None:
    episodes = play(lambda num_envs: PerfectState(BASE, num_envs), BASE, SEEDS, tell=True)
    assert (episodes["return"] <= bound).all()
    assert (bound - episodes["return"] < 0.15 * episodes["time"]).all()


def told_actions(seed: int) -> tuple[NDArray[np.float64], float]:
    """The actions, shape (steps, 2), of the controller that knows the present, and what they earn [s]."""
    env, guide = RoughTurningVectorEnv(1, BASE, AutoresetMode.NEXT_STEP), PerfectState(BASE, 1)
    observations, infos = env.reset(seed=[seed])
    guide.reset(np.ones(1, np.bool_))
    actions, earned, ended = [], 0.0, False
    while not ended:
        guide.tell(infos)
        actions.append(guide.act(observations)[0].astype(np.float64))
        observations, rewards, terminated, truncated, infos = env.step(actions[-1][np.newaxis])
        earned += float(rewards[0])
        ended = bool(terminated[0] | truncated[0])
    return np.array(actions), earned


def best_replay(seed: int, actions: NDArray[np.float64], rounds: int) -> tuple[float, float]:
    """(return, machine time) [s] of the best that a search finds by changing a sequence of actions on one seed."""
    num_envs, most = 128, len(actions) + 200
    random = np.random.default_rng(seed)
    env = RoughTurningVectorEnv(num_envs, BASE, AutoresetMode.NEXT_STEP)
    actions = np.concatenate([actions, np.zeros((200, 2))])
    found = (-np.inf, 0.0)
    for _ in range(rounds):
        env.reset(seed=[seed] * num_envs)
        # One change per environment, of a few steps, taken back after them: later commands stay as before.
        changed = np.tile(actions, (num_envs, 1, 1))
        for index, start in enumerate(random.integers(0, most - 12, num_envs)):
            change, axis = random.normal(0.0, 0.15), random.integers(2)
            changed[index, start, axis] += change
            changed[index, start + random.integers(1, 12), axis] -= change
        changed[0] = actions
        changed = np.clip(changed, -1.0, 1.0)
        returns, times, running = np.zeros(num_envs), np.zeros(num_envs), np.ones(num_envs, np.bool_)
        for step in range(most):
            _, rewards, terminated, truncated, infos = env.step(changed[:, step])
            returns += running * rewards
            times += running * infos["time"]
            running &= ~(terminated | truncated)
        assert not running.any()
        top = int(np.argmax(returns))
        found = max(found, (float(returns[top]), float(times[top])))
        actions = changed[top]
    return found


@pytest.mark.slow
def test_no_replayed_sequence_of_actions_that_a_search_finds_earns_more(bound: NDArray[np.float64]) -> None:
    actions, told = told_actions(SEEDS[0])
    returned, time = best_replay(SEEDS[0], actions, 8)
    assert returned > told  # the search does find something
    assert returned <= allowed(bound[0], time)


@pytest.mark.slow
def test_finer_grids_move_it_by_less_than_its_tolerance(bound: NDArray[np.float64]) -> None:
    finer = bounds(BASE, SEEDS[:1], clairvoyant.GRID.halved())
    machine_time = 600.0  # [s], less than an edge lasts
    assert abs(finer[0] - bound[0]) <= TOLERANCE * machine_time


@pytest.mark.slow
def test_it_does_not_depend_on_threads_or_on_what_is_computed_beside_it() -> None:
    done: list[int] = []
    together = bounds(BASE, SEEDS[:2], COARSE, on_seed=lambda: done.append(1), threads=2)
    assert together.tolist() == [bounds(BASE, [seed], COARSE, threads=1)[0] for seed in SEEDS[:2]]
    assert len(done) == 2


def test_worn_edges_and_hard_skins_lower_it() -> None:
    worn, skin = (bounds(Scenario.load(name), SEEDS[:1], COARSE)[0] for name in ("worn_lot", "forging_skin"))
    plain = bounds(BASE, SEEDS[:1], COARSE)[0]
    assert worn < plain
    assert skin < plain


def test_it_says_what_it_covers() -> None:
    covered = {env_id for env_id, preset in IDS.items() if covers(Scenario.load(preset))}
    assert covered == {"RoughTurning-v0", "RoughTurning-Override-v0"}
    assert not covers(Scenario.model_validate({"control": {"time_limit": 5.0}}))
    with pytest.raises(ValueError, match="does not cover scenario 'shift'"):
        bounds(Scenario.load("shift"), SEEDS)
