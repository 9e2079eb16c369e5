"""Measure the shield in simulation: overload, broken edges and material removal rate of policies with and without it."""

import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode

from turning_control.shield import Settings, Shield
from turning_env import IDS
from turning_env.physics.quantities import action_size
from turning_env.scenario import Scenario
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.policy import Actions, Observations, Policy
from turning_env.scoring.score import shipped
from turning_env.scoring.seeds import held_out_seeds
from turning_env.vector_env import RoughTurningVectorEnv, info_at_end_of_step


class Result(NamedTuple):
    """A policy's result on a task."""

    env_id: str
    policy: str
    shielded: bool
    severe: float  # share of cutting time with an excess above the tolerance, 5 % [-]
    edges_broken: int
    removal_rate: float  # [cm3/min]
    overridden: float  # share of decisions in which the shield changed the action [-]
    handed_over: int  # episodes that ended early because the shield handed over to the operator; the figures count until then


SUMS = ("severe_overload_time", "engaged_time", "edges_broken", "removed", "time")
REPORTED = 10.0  # time between lines of progress [s]


class UniformRandom(Policy):
    """A policy of uniform random actions in -1..1."""

    def __init__(self, size: int) -> None:
        self._size, self._random = size, np.random.default_rng(0)

    def act(self, observations: Observations) -> Actions:
        return self._random.uniform(-1.0, 1.0, (len(observations), self._size)).astype(np.float32)


def best_agent(env_id: str, agents: Path) -> Path | None:
    """Return the file of training seed 0 of the shipped agent with the highest mean return on a task; None if there is none."""
    folder = agents / env_id / IDS[env_id]
    found = [(each.returns.mean(), folder / f"{each.name}-seed0.onnx") for each in shipped(env_id) if each.kind == "agent"]
    return max(((mean, path) for mean, path in found if path.is_file()), default=(0.0, None))[1]


def rows(env_ids: list[str], episodes: int, agents: Path, settings: Settings) -> Iterator[Result]:
    """Yield the figures of uniform random actions and of the best agent in a folder, each with and without the shield.

    Each plays as many held-out seeds of each task as ``episodes``.
    """
    for env_id in env_ids:
        scenario = Scenario.load(IDS[env_id])
        policies = {"uniform random": as_factory(UniformRandom(action_size(scenario)))}
        if (best := best_agent(env_id, agents)) is not None:
            policies[best.stem] = as_factory(best)
        for (name, make), with_shield in product(policies.items(), (False, True)):
            yield _measured(env_id, name, scenario, make(episodes), episodes, settings if with_shield else None)


def _measured(env_id: str, name: str, scenario: Scenario, policy: Policy, episodes: int, settings: Settings | None) -> Result:
    env = RoughTurningVectorEnv(episodes, scenario, AutoresetMode.SAME_STEP)
    if settings:
        policy = Shield(policy, scenario, episodes, settings)
    observations, _ = env.reset(seed=held_out_seeds(episodes))
    policy.reset(np.ones(episodes, np.bool_))
    running, sums, handed_over, changed, decisions = np.ones(episodes, np.bool_), dict.fromkeys(SUMS, 0.0), 0, 0, 0
    reported = time.monotonic()
    while running.any():
        actions = policy.act(observations)
        if isinstance(policy, Shield):  # the operator has stopped the machine
            handed_over += int((running & policy.handed_over).sum())
            running &= ~policy.handed_over
            changed += int((running & (np.array(policy.reasons) != "passed")).sum())
            decisions += int(running.sum())
        observations, _, terminated, truncated, infos = env.step(actions)
        for each in SUMS:
            sums[each] += float((info_at_end_of_step(infos, each) * running).sum())
        ended = terminated | truncated
        policy.reset(ended)
        running &= ~ended
        if time.monotonic() > reported + REPORTED:
            reported, shield = time.monotonic(), ", shielded" if settings else ""
            print(f"{env_id}: {name}{shield}: {episodes - running.sum()} of {episodes} episodes", file=sys.stderr, flush=True)
    severe = sums["severe_overload_time"] / max(sums["engaged_time"], 1e-9)
    rate = 60.0 * sums["removed"] / max(sums["time"], 1e-9)
    overridden, broken = changed / max(decisions, 1), int(sums["edges_broken"])
    return Result(env_id, name, settings is not None, severe, broken, rate, overridden, handed_over)


def table(measured: Iterable[Result]) -> str:
    """Return the rows as a Markdown table."""
    heads = ("Task", "Policy", "Shield", "Over 5 % [% of cutting time]", "Edges broken", "MRR [cm3/min]")
    rows = []
    for row in measured:
        shield = ("yes", f"{100 * row.overridden:.0f}", f"{row.handed_over}") if row.shielded else ("no", "", "")
        figures = f"{100 * row.severe:.3f}", f"{row.edges_broken}", f"{row.removal_rate:.1f}"
        rows.append((row.env_id, row.policy, shield[0], *figures, *shield[1:]))
    return markdown((*heads, "Overridden [%]", "Handed over"), rows)


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (heads, ["---"] * len(heads), *rows))
