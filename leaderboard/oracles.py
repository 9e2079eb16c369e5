"""The references that are ranked beside the policies of a scenario: what no policy can know is known to them."""

from collections.abc import Callable, Sequence

import numpy as np

from baselines.oracles import clairvoyant, perfect_state
from leaderboard.contestants import Reference
from leaderboard.result import PolicyRecord, digest_of
from turning_env import Scenario
from turning_env.score.play import EPISODE_FIELDS, Episodes, play

CLAIRVOYANT, CAUSAL = "clairvoyant", "causal"


def references(scenario: Scenario) -> list[Reference]:
    """Those that can be computed for a scenario."""
    known = []
    if clairvoyant.covers(scenario):
        grid = {name: float(value) for name, value in clairvoyant.GRID._asdict().items()}
        description = "bound: every bar known beforehand, nothing lags or breaks"
        known.append(Reference(_record(CLAIRVOYANT, description, grid), _bound))
    if perfect_state.covers(scenario):
        description = "the optimiser with foresight, told the true depth, hardness and wear after every interval"
        known.append(Reference(_record(CAUSAL, description, {}), _play_told))
    return known


def _record(name: str, description: str, parameters: dict[str, float]) -> PolicyRecord:
    return PolicyRecord(
        name=name,
        kind="reference",
        description=description,
        parameters=dict(parameters),
        digest=digest_of(parameters),
        training_seed=None,
        command=None,
    )


def _bound(scenario: Scenario, draws: Sequence[int], on_step: Callable[[int], None]) -> Episodes:
    """Returns alone: what a bound would do to earn them is nothing that a lathe could do."""
    done = 0

    def on_draw() -> None:
        nonlocal done
        done += 1
        on_step(done)

    returns = clairvoyant.bounds(scenario, draws, on_seed=on_draw)
    return {name: np.zeros(len(draws)) for name in EPISODE_FIELDS} | {"return": returns}


def _play_told(scenario: Scenario, draws: Sequence[int], on_step: Callable[[int], None]) -> Episodes:
    # Told the lot no more than any control is: it learns what there is from the truth at the tool.
    return play(lambda num_envs: perfect_state.PerfectState(scenario.nominal(), num_envs), scenario, draws, on_step, tell=True)
