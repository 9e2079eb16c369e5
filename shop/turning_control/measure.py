"""Measure the shield in simulation: how policies do with and without it.

The figures are overload, broken edges and material removal rate. ``adversary.py`` searches for
policies that make them bad.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode
from tqdm import tqdm
from turning_control.shield import Settings, Shield

from leaderboard.adapt import as_factory
from leaderboard.scoring import shipped
from leaderboard.seeds import held_out_seeds
from turning_env import IDS
from turning_env.physics.quantities import action_size
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario import Scenario
from turning_env.vector_env import RoughTurningVectorEnv, info_at_end_of_step

SUMS = ("severe_overload_time", "engaged_time", "edges_broken", "removed", "time")


class Result(NamedTuple):
    """A policy's result on a task."""

    env_id: str
    policy: str
    shielded: bool
    severe: float  # share of cutting time with an excess above the tolerance, 5 % [-]
    edges_broken: int
    removal_rate: float  # [cm3/min]
    overridden: float  # share of decisions in which the shield changed the action [-]
    # Episodes that ended early because the operator took over; the figures count until then.
    takeovers: int


class UniformRandom(Policy):
    """A policy of uniform random actions in -1..1."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._random = np.random.default_rng(0)

    def act(self, observations: Observations) -> Actions:
        shape = (len(observations), self._size)
        return self._random.uniform(-1.0, 1.0, shape).astype(np.float32)


def best_agent(env_id: str, agents: Path) -> Path | None:
    """Return the file of the best shipped agent of a task, or None if there is none.

    It is training seed 0 of the agent with the highest mean return.
    """
    folder = agents / env_id / IDS[env_id]
    candidates = []
    for result in shipped(env_id):
        path = folder / f"{result.name}-seed0.onnx"
        if result.kind == "agent" and path.is_file():
            mean_return = float(result.returns.mean())
            candidates.append((mean_return, path))
    if not candidates:
        return None
    _, best = max(candidates)
    return best


def rows(env_ids: list[str], episodes: int, agents: Path, settings: Settings) -> Iterator[Result]:
    """Yield the results of random actions and of the best agent, each without and with the shield.

    Args:
        env_ids: tasks.
        episodes: number of held-out seeds that each policy plays on each task.
        agents: folder of the shipped agents.
        settings: of the shield.
    """
    for env_id in env_ids:
        scenario = Scenario.load(IDS[env_id])
        uniform = UniformRandom(action_size(scenario))
        policies = {"uniform random": as_factory(uniform)}
        agent = best_agent(env_id, agents)
        if agent is not None:
            policies[agent.stem] = as_factory(agent)
        for name, make_policy in policies.items():
            for guard in (None, settings):
                policy = make_policy(episodes)
                yield _result(env_id, name, scenario, policy, episodes, settings=guard)


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
    """Sums over the episode of each environment of a batch."""

    def __init__(self, num_envs: int) -> None:
        self.sums = {name: np.zeros(num_envs) for name in SUMS}
        self.takeovers = np.zeros(num_envs, np.int64)
        self.changed = np.zeros(num_envs, np.int64)  # decisions
        self.decisions = np.zeros(num_envs, np.int64)

    def total(self, environments: slice = slice(None)) -> Guarded:
        """Return the figures of some environments together."""
        sums = {name: float(values[environments].sum()) for name, values in self.sums.items()}
        changed = self.changed[environments].sum()
        decisions = self.decisions[environments].sum()
        return Guarded(
            episodes=len(self.decisions[environments]),
            severe=sums["severe_overload_time"] / max(sums["engaged_time"], 1e-9),
            edges_broken=round(sums["edges_broken"]),
            removal_rate=60.0 * sums["removed"] / max(sums["time"], 1e-9),
            overridden=float(changed / max(decisions, 1)),
            takeovers=int(self.takeovers[environments].sum()),
        )


def play_guarded(
    scenario: Scenario, policy: Policy, seeds: Sequence[int], settings: Settings | None, label: str
) -> Played:
    """Play one episode per seed with a policy behind the shield.

    Args:
        scenario: task.
        policy: for ``len(seeds)`` environments.
        seeds: one per episode.
        settings: of the shield; None: the policy plays without it.
        label: name of the progress bar.
    """
    num_envs = len(seeds)
    env = RoughTurningVectorEnv(num_envs, scenario, AutoresetMode.SAME_STEP)
    if settings:
        policy = Shield(policy, scenario, num_envs, settings)
    observations, _ = env.reset(seed=list(seeds))
    policy.reset(np.ones(num_envs, np.bool_))
    played = Played(num_envs)
    running = np.ones(num_envs, np.bool_)

    # miniters=0 redraws the bar while no episode ends; disable=None hides it without a terminal.
    with tqdm(
        total=num_envs, desc=label, unit="episode", miniters=0, leave=False, disable=None
    ) as bar:
        while running.any():
            actions = policy.act(observations)
            if isinstance(policy, Shield):
                # The operator stops the machine, so the episode ends before the action.
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
            bar.update(num_envs - running.sum() - bar.n)
    return played


def _result(
    env_id: str,
    name: str,
    scenario: Scenario,
    policy: Policy,
    episodes: int,
    settings: Settings | None,
) -> Result:
    shield = ", shielded" if settings else ""
    played = play_guarded(
        scenario,
        policy,
        seeds=held_out_seeds(episodes),
        settings=settings,
        label=f"{env_id}: {name}{shield}",
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


def table(results: Iterable[Result]) -> str:
    """Return results as a Markdown table."""
    heads = (
        "Task",
        "Policy",
        "Shield",
        "Over 5 % [% of cutting time]",
        "Edges broken",
        "MRR [cm3/min]",
        "Overridden [%]",
        "Takeovers",
    )
    rows = []
    for result in results:
        rows.append(
            (
                result.env_id,
                result.policy,
                "yes" if result.shielded else "no",
                f"{100 * result.severe:.3f}",
                f"{result.edges_broken}",
                f"{result.removal_rate:.1f}",
                f"{100 * result.overridden:.0f}" if result.shielded else "",
                f"{result.takeovers}" if result.shielded else "",
            )
        )
    return markdown(heads, rows)


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
