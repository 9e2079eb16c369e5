"""Measure the shield in simulation: overload, broken edges and material removal rate of policies with and without it."""

import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
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
    takeovers: int  # episodes that ended early because the operator took over; the figures count until then


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
    found = [
        (each.returns.mean(), folder / f"{each.name}-seed0.onnx")
        for each in shipped(env_id)
        if each.kind == "agent"
    ]
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
            yield _measured(
                env_id, name, scenario, make(episodes), episodes, settings if with_shield else None
            )


@dataclass(frozen=True)
class Guarded:
    """Figures of a policy's episodes, until they end or the operator takes over."""

    episodes: int
    severe: float  # share of cutting time with an excess above the tolerance, 5 % [-]
    edges_broken: int
    removal_rate: float  # [cm3/min]
    overridden: float  # share of decisions in which the shield changed the action [-]
    takeovers: int  # episodes that ended early because the operator took over


class Played:
    """Sums over the episodes of each environment of a batch."""

    def __init__(self, num_envs: int) -> None:
        self.sums = {name: np.zeros(num_envs) for name in SUMS}
        self.takeovers, self.changed, self.decisions = np.zeros((3, num_envs), np.int64)

    def total(self, environments: slice = slice(None)) -> Guarded:
        """Return the figures of some environments together."""
        sums = {name: float(values[environments].sum()) for name, values in self.sums.items()}
        return Guarded(
            episodes=len(self.decisions[environments]),
            severe=sums["severe_overload_time"] / max(sums["engaged_time"], 1e-9),
            edges_broken=round(sums["edges_broken"]),
            removal_rate=60.0 * sums["removed"] / max(sums["time"], 1e-9),
            overridden=float(
                self.changed[environments].sum() / max(self.decisions[environments].sum(), 1)
            ),
            takeovers=int(self.takeovers[environments].sum()),
        )


def play_guarded(
    scenario: Scenario, policy: Policy, seeds: Sequence[int], settings: Settings | None, label: str
) -> Played:
    """Play one episode per seed with a policy behind the shield, or without it if there are no settings.

    A line of progress that begins with ``label`` goes to standard error every ten seconds.
    """
    num_envs = len(seeds)
    env = RoughTurningVectorEnv(num_envs, scenario, AutoresetMode.SAME_STEP)
    if settings:
        policy = Shield(policy, scenario, num_envs, settings)
    observations, _ = env.reset(seed=list(seeds))
    policy.reset(np.ones(num_envs, np.bool_))
    played, running = Played(num_envs), np.ones(num_envs, np.bool_)
    reported = time.monotonic()
    while running.any():
        actions = policy.act(observations)
        if isinstance(policy, Shield):  # the operator has stopped the machine
            played.takeovers += running & policy.takeover
            running = running & ~policy.takeover
            played.changed += running & (np.array(policy.reasons) != "passed")
            played.decisions += running
        observations, _, terminated, truncated, infos = env.step(actions)
        for name in SUMS:
            played.sums[name] += info_at_end_of_step(infos, name) * running
        ended = terminated | truncated
        policy.reset(ended)
        running = running & ~ended
        if time.monotonic() > reported + REPORTED:
            reported = time.monotonic()
            print(
                f"{label}: {num_envs - running.sum()} of {num_envs} episodes",
                file=sys.stderr,
                flush=True,
            )
    return played


def _measured(
    env_id: str,
    name: str,
    scenario: Scenario,
    policy: Policy,
    episodes: int,
    settings: Settings | None,
) -> Result:
    shield = ", shielded" if settings else ""
    played = play_guarded(
        scenario, policy, held_out_seeds(episodes), settings, label=f"{env_id}: {name}{shield}"
    )
    figures = played.total()
    return Result(
        env_id=env_id,
        policy=name,
        shielded=settings is not None,
        severe=figures.severe,
        edges_broken=figures.edges_broken,
        removal_rate=figures.removal_rate,
        overridden=figures.overridden,
        takeovers=figures.takeovers,
    )


def table(measured: Iterable[Result]) -> str:
    """Return the rows as a Markdown table."""
    heads = (
        "Task",
        "Policy",
        "Shield",
        "Over 5 % [% of cutting time]",
        "Edges broken",
        "MRR [cm3/min]",
    )
    rows = []
    for row in measured:
        shield = (
            ("yes", f"{100 * row.overridden:.0f}", f"{row.takeovers}")
            if row.shielded
            else ("no", "", "")
        )
        figures = f"{100 * row.severe:.3f}", f"{row.edges_broken}", f"{row.removal_rate:.1f}"
        rows.append((row.env_id, row.policy, shield[0], *figures, *shield[1:]))
    return markdown((*heads, "Overridden [%]", "Takeovers"), rows)


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (heads, ["---"] * len(heads), *rows))
