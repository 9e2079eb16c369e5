"""The transition: what holds in every interval, how episodes end, and convergence."""

import numpy as np
import pytest

from tests.turning_env.playing import SHORT_LIVED, UNDISTURBED, changed, fixed_actions, play
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario, presets

REWARD_TERMS = ("metal", "time", "edge", "overload", "breakage", "roughness")


@pytest.mark.parametrize("scenario", [SHORT_LIVED, *presets()])
def test_what_holds_in_every_interval(scenario):
    scenario = Scenario.load(scenario)
    economics, control = scenario.economics, scenario.control
    timeless = control.edge_changes == "end"
    edge_price = 60 * (economics.edge_cost + (economics.edge_change_time if timeless else 0))
    for seed in range(2):
        env = RoughTurningEnv(scenario)
        record = play(env, seed, fixed_actions(600, 1, scenario)[:, 0])
        assert all(env.observation_space.contains(row) for row in record["observation"])
        assert record["reward"] == pytest.approx(sum(record[f"reward_{term}"] for term in REWARD_TERMS), rel=1e-12)
        assert record["reward_time"] == pytest.approx(-record["time"], rel=1e-12)
        assert record["cost"] == pytest.approx(record["cost_force"] + record["cost_power"], rel=1e-12)
        assert (record["cost"] >= 0).all()
        assert (record["severe_overload_time"] <= record["overload_time"]).all()
        assert (record["overload_time"] <= record["engaged_time"] + 1e-9).all()
        assert (record["engaged_time"] + record["stopped_time"] <= record["time"] + 1e-9).all()
        assert (record["overload_time"] > 0).tolist() == (record["cost"] > 0).tolist()
        assert ((record["mean_power"] > 0) <= (record["engaged_time"] > 0)).all()
        assert record["broken"].tolist() == (record["edges_broken"] > 0).tolist()
        lost = record["edges_broken"] * (edge_price + 60 * economics.breakage_downtime * timeless)
        assert (-record["reward_breakage"] <= lost + 1e-9).all()
        if timeless:
            assert not record["stopped_time"].any()
            paid = record["reward_edge"] + record["reward_breakage"] + 60 * economics.breakage_downtime * record["edges_broken"]
        else:
            paid = record["reward_edge"] + record["reward_breakage"]
        assert -paid == pytest.approx(edge_price * record["edges_used"], rel=1e-9, abs=1e-9)
        stepped = record["time"] > 0
        if scenario.machine.chip_lag == 0 and timeless and not record["finished"].any():
            for name in ("thrust_force", "power", "torque", "depth_of_cut", "hardness"):
                assert ((record[name] > 0) == record["cutting"])[stepped].all(), name
        if timeless:
            assert ((record["time"] < control.interval - 1e-9) <= record["terminated"])[stepped].all()

        ends = np.flatnonzero(record["terminated"] | record["truncated"])
        for episode in np.split(np.arange(len(record["reward"])), ends + 1):
            never_falling = ("used_life", "wear", "path", "cutting_time", "bar") if timeless else ("path", "bar")
            for name in never_falling:
                assert (np.diff(record[name][episode]) >= 0).all(), name


def test_episodes_end_worn_broken_or_out_of_time():
    num_envs = 200
    env = RoughTurningVectorEnv(num_envs, SHORT_LIVED, "SameStep")
    env.reset(seed=0)
    worn_count = broken_count = truncated_count = 0
    for count, actions in enumerate(fixed_actions(30, num_envs), start=1):
        _, _, terminated, truncated, infos = env.step(actions)
        if (terminated | truncated).any():
            final = infos["final_info"]
            worn = final["wear"] >= SHORT_LIVED.tool.wear_criterion
            broken = final["broken"]
            assert (terminated == (terminated & (worn | broken))).all()
            assert (final["thrust_force"] > final["edge_strength"])[terminated & broken].all()
            assert not (terminated & truncated).any()
            if count < 30:
                assert not truncated.any()
            worn_count += (terminated & worn).sum()
            broken_count += (terminated & broken).sum()
            truncated_count += truncated.sum()
    assert min(worn_count, broken_count, truncated_count) > 10


def test_a_worn_edge_ends_the_interval_at_once():
    wear_law, criterion = UNDISTURBED.material.wear, UNDISTURBED.tool.wear_criterion
    scenario = changed(UNDISTURBED, control={"sub_steps": 10000, "time_limit": 1e4})
    record = play(RoughTurningEnv(scenario), 0, np.ones((100, 2), np.float32))
    end = int(np.flatnonzero(record["terminated"])[0])
    taylor_life = (criterion / wear_law(200, 0.6, 2.5)) ** (1 / wear_law.time)
    assert record["time"][: end + 1].sum() / 60 == pytest.approx(taylor_life, abs=1e-4)
    assert record["wear"][end] == pytest.approx(criterion, rel=1e-4)
