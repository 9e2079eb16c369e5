"""The transition: what edges cost, and how episodes end."""

import numpy as np
import pytest

from tests.turning_env.playing import SHORT_LIVED, UNDISTURBED, changed, fixed_actions, play
from turning_env import RoughTurningEnv, Scenario
from turning_env.batch.driver import start_episodes
from turning_env.physics.quantities import REPORT, STATE, WIDTH, layout
from turning_env.physics.records import block_records


@pytest.mark.parametrize("source", [SHORT_LIVED, "shift", "batch_casting"])
def test_every_edge_is_paid_for_whole(source):
    scenario = Scenario.load(source)
    economics = scenario.economics
    edge_price = 60 * economics.edge_cost
    breakage_price = 0.0
    if scenario.control.edge_changes == "end":
        # Changes take no time, so their time is part of the price.
        edge_price += 60 * economics.edge_change_time
        breakage_price = 60 * economics.breakage_downtime
    actions = fixed_actions(600, 1, scenario)[:, 0]
    record = play(RoughTurningEnv(scenario), seed=1, actions=actions)
    downtime = breakage_price * record["edges_broken"]
    paid = -record["reward_edge"] - record["reward_breakage"] - downtime
    assert paid == pytest.approx(edge_price * record["edges_used"], rel=1e-9, abs=1e-9)
    assert record["edges_used"].sum() > 0.5
    assert record["broken"].tolist() == (record["edges_broken"] > 0).tolist()


def test_a_worn_edge_ends_the_step_at_once():
    wear_law = UNDISTURBED.material.wear
    criterion = UNDISTURBED.tool.wear_criterion
    scenario = changed(UNDISTURBED, control={"sub_steps": 10000, "time_limit": 1e4})
    actions = np.ones((100, 2), np.float32)
    record = play(RoughTurningEnv(scenario), seed=0, actions=actions)
    end = int(np.flatnonzero(record["terminated"])[0])
    life = record["time"][: end + 1].sum() / 60

    # W = W_1 t^n, so the Taylor life is T = (W_max / W_1)^(1 / n).
    wear_after_minute = wear_law(200, 0.6, depth_of_cut=2.5)
    taylor_life = (criterion / wear_after_minute) ** (1 / wear_law.time)
    assert life == pytest.approx(taylor_life, abs=1e-4)
    assert record["wear"][end] == pytest.approx(criterion, rel=1e-4)


def test_an_episode_starts_with_nothing_of_the_one_before():
    """Also in quantities that no effect of the scenario sets."""
    scenario = Scenario()
    quantities = [quantity.name for quantity in STATE if quantity.shape == (WIDTH,)]
    observations = np.zeros((WIDTH, len(layout(scenario))), np.float32)
    table = np.zeros((len(REPORT), WIDTH))
    starts = []
    for left_behind in (0, 7):
        states, parameters, scratches = block_records(scenario)
        for name in set(quantities) - {"seed", "episode"}:
            states[name] = left_behind
        chosen = np.ones(WIDTH, np.bool_)
        start_episodes(states, parameters, scratches, chosen, observations, table)
        starts.append(states)
    for name in quantities:
        assert starts[0][name].tobytes() == starts[1][name].tobytes(), name
