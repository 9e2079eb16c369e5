import pytest

from baselines.oracles import clairvoyant
from baselines.oracles.clairvoyant import TOLERANCE, StateGrid, bounds, covers
from baselines.oracles.perfect_state import PerfectState
from leaderboard.play import play
from leaderboard.seeds import tuning_seeds
from tests.turning_env.playing import changed
from turning_env import Scenario

BASE = Scenario.load("rough_turning")
# Force and power grow from that of a fresh edge, which needs no wear.
FRESH_SHARE = Scenario.load(
    {
        "base": "rough_turning",
        "material": {
            "thrust_force": {"coefficient": 11315.0, "wear": 1.0, "wear_growth": 4.2},
            "power": {"coefficient": 0.1564, "wear": 1.0, "wear_growth": 0.83},
        },
    }
)
SEEDS = tuning_seeds(2)
COARSE = StateGrid(cell=10.0, lives=60, speeds=8)
FINE = StateGrid(cell=2.5, lives=480, speeds=32)


@pytest.mark.slow
@pytest.mark.parametrize("scenario", [BASE, FRESH_SHARE], ids=["papers_laws", "fresh_share"])
def test_knowing_the_present_earns_less_than_knowing_all_but_not_much_less(
    scenario: Scenario,
) -> None:
    bound = bounds(scenario, SEEDS)
    episodes = play(
        lambda num_envs: PerfectState(scenario, num_envs),
        scenario,
        SEEDS,
        tell=True,
    )
    assert (episodes["return"] <= bound).all()
    assert (bound - episodes["return"] < 0.15 * episodes["time"]).all()


@pytest.mark.slow
def test_finer_grids_move_it_by_less_than_its_tolerance() -> None:
    brief = changed(BASE, tool={"wear_criterion": 0.15})
    machine_time = 60.0  # [s], of an edge
    finer = bounds(brief, SEEDS[:1], FINE)[0]
    usual = bounds(brief, SEEDS[:1], clairvoyant.GRID)[0]
    assert abs(finer - usual) <= TOLERANCE * machine_time


@pytest.mark.slow
def test_it_does_not_depend_on_threads_or_on_what_is_computed_beside_it() -> None:
    calls: list[int] = []
    together = bounds(
        BASE,
        SEEDS,
        COARSE,
        on_seed=lambda: calls.append(1),
        threads=2,
    )
    for seed, bound in zip(SEEDS, together, strict=True):
        assert bounds(BASE, [seed], COARSE, threads=1)[0] == bound
    assert len(calls) == 2


def test_it_says_what_it_covers() -> None:
    presets = ("override", "rough_turning", "shift", "surface")
    covered = {preset for preset in presets if covers(Scenario.load(preset))}
    assert covered == {"override", "rough_turning"}
    assert not covers(Scenario.model_validate({"control": {"time_limit": 5.0}}))
    with pytest.raises(ValueError, match="does not cover scenario 'shift'"):
        bounds(Scenario.load("shift"), SEEDS)
