"""Measure the shield in simulation: overload, broken edges and material removal rate of policies with and without it."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import gymnasium
import numpy as np

from turning_env.control.shield import Settings, Shield
from turning_env.physics.quantities import action_size
from turning_env.scenario import Scenario
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.overload import severe_share
from turning_env.scoring.play import play
from turning_env.scoring.policy import Actions, Observations, Policy, PolicyFactory
from turning_env.scoring.seeds import held_out_seeds
from turning_env.scoring.shipped import shipped


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


def _row(env_id: str, scenario: Scenario, name: str, make: PolicyFactory, settings: Settings | None, episodes: int) -> Row:
    guards: list[Shield] = []

    def guarded(num_envs: int) -> Policy:
        if settings is None:
            return make(num_envs)
        guards.append(Shield(make(num_envs), scenario, num_envs, settings))
        return guards[0]

    played = play(guarded, scenario, held_out_seeds(episodes))
    counts = guards[0].counts if guards else {"passed": 1}
    return Row(
        env_id,
        name,
        settings is not None,
        episodes,
        severe_share(played["severe_overload_time"], played["engaged_time"]),
        int(played["edges_broken"].sum()),
        float(60.0 * played["removed"].sum() / played["time"].sum()),
        1.0 - counts["passed"] / sum(counts.values()),
    )


def markdown(measured: list[Row]) -> str:
    """Return the rows as a table."""
    lines = [
        "| Task | Policy | Shield | Over 5 % [% of cutting time] | Edges broken | Removal rate [cm3/min] | Overridden [%] |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.env_id} | {row.policy} | {'yes' if row.shielded else 'no'} | {100 * row.severe:.2f} | {row.edges_broken} "
        f"| {row.removal_rate:.1f} | {f'{100 * row.overridden:.0f}' if row.shielded else ''} |"
        for row in measured
    ]
    return "\n".join(lines)
