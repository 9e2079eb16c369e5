"""The clairvoyant bound and the causal oracle, which know what no policy can know."""

from collections.abc import Callable, Sequence
from itertools import count

import numpy as np

from baselines.oracles import clairvoyant, perfect_state
from leaderboard.standings import CAUSAL, CLAIRVOYANT
from turning_env import Scenario
from turning_env.scoring.play import EPISODE_FIELDS, Episodes
from turning_env.scoring.policy import PolicySpec


def oracles(scenario: Scenario) -> list[PolicySpec]:
    """Return the bound and the oracle of a scenario, as far as they cover it."""
    known = []
    if clairvoyant.covers(scenario):
        known.append(
            PolicySpec(
                name=CLAIRVOYANT,
                kind="oracle",
                description="bound: every bar known beforehand, nothing lags or breaks",
                parameters={name: float(value) for name, value in clairvoyant.GRID._asdict().items()},
                compute=_bound,
            )
        )
    if perfect_state.covers(scenario):
        nominal = scenario.nominal()  # of the mismatch it knows what every policy knows: nothing
        known.append(
            PolicySpec(
                name=CAUSAL,
                version=4,
                kind="oracle",
                description="the optimiser with foresight, told the true depth, hardness and wear after every step",
                make=lambda num_envs: perfect_state.PerfectState(nominal, num_envs),
            )
        )
    return known


def _bound(scenario: Scenario, seeds: Sequence[int], on_step: Callable[[int], None]) -> Episodes:
    """Return the bound on each return; all other fields are 0, as no lathe can play it."""
    played = count(1)
    returns = clairvoyant.bounds(scenario, seeds, on_seed=lambda: on_step(next(played)))
    return {name: np.zeros(len(seeds)) for name in EPISODE_FIELDS} | {"return": returns}
