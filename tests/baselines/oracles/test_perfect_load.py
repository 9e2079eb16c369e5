import pytest

from baselines import catalogue
from baselines.oracles.perfect_load import PerfectLoad, covers
from leaderboard.play import play
from leaderboard.seeds import tuning_seeds
from tests.turning_env.playing import changed
from turning_env import Scenario

OVERRIDE = Scenario.load("override")
SURFACE = Scenario.load("surface")
SEEDS = tuning_seeds(4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "brief", "rule"),
    [
        pytest.param(
            OVERRIDE,
            changed(OVERRIDE, workpiece={"bar_length": 25.0}),
            "constant_power_lead",
            id="override",
        ),
        pytest.param(
            SURFACE,
            changed(SURFACE, control={"time_limit": 0.1}),
            "constant_force_lead",
            id="surface",
        ),
    ],
)
def test_knowing_the_load_is_worth_more_than_measuring_it(
    task: Scenario, brief: Scenario, rule: str
) -> None:
    measured = play(catalogue.spec(rule, brief, tuned_on=task).make, brief, SEEDS)
    known = play(
        lambda num_envs: PerfectLoad(brief, num_envs),
        brief,
        SEEDS,
        tell=True,
    )
    assert (known["return"] > measured["return"]).all()


@pytest.mark.slow
def test_a_constant_depth_is_cut_at_the_limit_and_not_above() -> None:
    steady = changed(
        OVERRIDE,
        workpiece={
            "bar_length": 25.0,
            "depth_profile": [],
            "depth_of_cut": 3.0,
            "depth_ripple": 0.0,
            "depth_along_spread": 0.0,
            "hardness_along_spread": 0.0,
        },
    )
    episodes = play(
        lambda num_envs: PerfectLoad(steady, num_envs),
        steady,
        SEEDS,
        tell=True,
    )
    assert episodes["excess"].sum() < 1e-3 * episodes["engaged_time"].sum()
    lower_limit = changed(steady, limits={"power": 0.98 * steady.limits.power})
    cautious = play(
        lambda num_envs: PerfectLoad(lower_limit, num_envs),
        steady,
        SEEDS,
        tell=True,
    )
    assert (episodes["time"] < cautious["time"]).all()


def test_it_says_what_it_covers() -> None:
    presets = ("override", "rough_turning", "shift", "surface")
    covered = {preset for preset in presets if covers(Scenario.load(preset))}
    assert covered == {"override", "surface"}
    assert not covers(changed(OVERRIDE, machine={"command_delay": 0.02}))
