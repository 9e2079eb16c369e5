"""Measure the shield in simulation: overload, broken edges and material removal rate of policies with and without it."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from turning_env.control.shield import Settings, Shield
from turning_env.physics.quantities import action_size
from turning_env.scenario import Scenario
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.packed import shipped
from turning_env.scoring.policy import Actions, Observations, Policy, PolicyFactory
from turning_env.scoring.seeds import held_out_seeds
from turning_env.vector_env import RoughTurningVectorEnv


class Row(NamedTuple):
    """A policy's figures on a task."""

    env_id: str
    policy: str
    shielded: bool
    episodes: int
    severe: float
    """Share of cutting time with an excess above the tolerance, 5 % [-]."""
    edges_broken: int
    removal_rate: float
    """[cm3/min]"""
    overridden: float
    """Share of decisions in which the shield changed the action [-]."""
    handed_over: int
    """Episodes that ended early because the shield handed over to the operator; the figures count until then."""


SUMS = ("severe_overload_time", "engaged_time", "edges_broken", "removed", "time")


class UniformRandom(Policy):
    """Actions drawn evenly from -1..1."""

    def __init__(self, size: int) -> None:
        self._size, self._random = size, np.random.default_rng(0)

    def act(self, observations: Observations) -> Actions:
        return self._random.uniform(-1.0, 1.0, (len(observations), self._size)).astype(np.float32)


def best_agent(env_id: str, agents: Path) -> Path | None:
    """Return the file of the shipped agent with the highest mean return on a task; None if there is none in the folder."""
    preset = gymnasium.spec(env_id).kwargs["scenario"]
    found = []
    for each in shipped(env_id):
        seed = int(each.returns.mean(axis=1).argmax())
        path = agents / env_id / preset / f"{each.name}-seed{seed}.onnx"
        if each.kind == "agent" and path.is_file():
            found.append((each.returns[seed].mean(), path))
    return max(found)[1] if found else None


def rows(env_ids: list[str], episodes: int, agents: Path, settings: Settings) -> Iterator[Row]:
    """Yield the figures of uniform random actions and of the best agent, each with and without the shield."""
    for env_id in env_ids:
        scenario = Scenario.load(gymnasium.spec(env_id).kwargs["scenario"])
        policies: list[tuple[str, PolicyFactory]] = [("uniform random", lambda n, s=scenario: UniformRandom(action_size(s)))]  # type: ignore[misc]
        if (best := best_agent(env_id, agents)) is not None:
            policies.append((best.stem, as_factory(best)))
        for name, make in policies:
            for with_shield in (False, True):
                yield _row(env_id, scenario, name, make, settings if with_shield else None, episodes)


def _row(env_id: str, scenario: Scenario, policy_name: str, make: PolicyFactory, settings: Settings | None, episodes: int) -> Row:
    seeds = held_out_seeds(episodes)
    env = RoughTurningVectorEnv(episodes, scenario, AutoresetMode.SAME_STEP)
    policy = make(episodes) if settings is None else Shield(make(episodes), scenario, episodes, settings)
    observations, _ = env.reset(seed=seeds)
    policy.reset(np.ones(episodes, np.bool_))
    running, sums, handed_over = np.ones(episodes, np.bool_), dict.fromkeys(SUMS, 0.0), 0
    while running.any():
        actions = policy.act(observations)
        if isinstance(policy, Shield):  # the operator has stopped the machine
            handed_over += int((running & policy.handed_over).sum())
            running &= ~policy.handed_over
        observations, _, terminated, truncated, infos = env.step(actions)
        ended = terminated | truncated
        for name in SUMS:
            values = np.where(ended, infos["final_info"][name], infos[name]) if ended.any() else infos[name]
            sums[name] += float((values * running).sum())
        if ended.any():
            policy.reset(ended)
            running &= ~ended
    counts = policy.counts if isinstance(policy, Shield) else {"passed": 1}
    return Row(
        env_id,
        policy_name,
        settings is not None,
        episodes,
        sums["severe_overload_time"] / max(sums["engaged_time"], 1e-9),
        int(sums["edges_broken"]),
        60.0 * sums["removed"] / max(sums["time"], 1e-9),
        1.0 - counts["passed"] / sum(counts.values()),
        handed_over,
    )


def markdown(measured: list[Row]) -> str:
    """Return the rows as a table."""
    lines = [
        "| Task | Policy | Shield | Over 5 % [% of cutting time] | Edges broken | MRR [cm3/min] | Overridden [%] | Handed over |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.env_id} | {row.policy} | {'yes' if row.shielded else 'no'} | {100 * row.severe:.2f} | {row.edges_broken} "
        f"| {row.removal_rate:.1f} |" + (f" {100 * row.overridden:.0f} | {row.handed_over} |" if row.shielded else " | |")
        for row in measured
    ]
    return "\n".join(lines)
