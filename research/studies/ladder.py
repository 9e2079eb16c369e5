"""Show what makes the family `shop` hard: its jobs with one uncertain factor at a time.

    python -m research.studies.ladder
    python -m research.studies.ladder --rungs none law-of-wear --policies self_tuning

The jobs are those of ``validation``, in truth with the nominal value of every other factor: laws
are those of the nominal model, spreads and noise are 0. Nominal models, and so observed contexts,
stay, so policies do not know which factors are left. The oracle ``causal`` knows all true values.

The tables have the regret, which is the return of ``causal`` less that of the policy, and how much
a factor adds to the regret without any; both in s per job with 95 % intervals over jobs.

``RUNS/ladder`` keeps the episodes: the same command continues where it stopped.
"""

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines import catalogue
from baselines.comparators import CAUSAL, NOMINAL_SHARE
from baselines.oracles.perfect_state import VERSION
from baselines.oracles.truthful import Truthful
from leaderboard.agents import onnx_policy
from leaderboard.agents.agent_file import ONNX_SUFFIX
from leaderboard.family import FamilyPlay
from leaderboard.play import Episodes
from leaderboard.statistics import Bootstrap, Estimate, Floats
from leaderboard.table import markdown
from research.studies.compare import kept_episodes
from turning_env import MODEL_VERSION, Family
from turning_env.console import described, exits, positive
from turning_env.scenario.family import DrawnJobs

FAMILY = "shop"
SPLIT = "validation"
JOBS = 128
AGENTS = Path("agents/RoughTurning-Family-v1/shop")
POLICIES = (
    NOMINAL_SHARE,
    "load_loop_jobs",
    "predictive",
    "self_tuning",
    "ppo_load_target-seed0",
    "simulator_gradient-seed0",
    CAUSAL,
)
"""Rules, agents of ``AGENTS`` and the oracle."""

SPREADS = {
    "edges": ("tool.wear_factor_spread", "tool.edge_strength_spread"),
    "depth": ("workpiece.depth_bar_spread", "workpiece.depth_along_spread"),
    "hardness": ("workpiece.hardness_bar_spread", "workpiece.hardness_along_spread"),
    "noise": ("sensors.force_noise", "sensors.power_noise"),
}
"""Fields of what scatters in a job: 0 is no scatter."""
ERRORS = {
    "law-of-force": ("material.thrust_force.", "tool.edge_strength"),
    "law-of-power": ("material.power.",),
    "law-of-wear": ("material.wear.",),
    "lags-of-drives": ("machine.feed_time_constant", "machine.spindle_time_constant"),
}
"""Sections, which end in a dot, and fields in which nominal models are wrong."""
FACTORS = {**ERRORS, **SPREADS}
"""Sections and fields of each factor."""
NONE = "none"
RUNGS: dict[str, tuple[str, ...]] = {
    NONE: (),
    **{factor: (factor,) for factor in FACTORS},
    "laws-of-loads": ("law-of-force", "law-of-power"),
    "all": tuple(FACTORS),
}
"""Uncertain factors of each rung. Nominal laws of force and power are wrong together, as both
follow from the specific cutting force."""


class Rung(Family):
    """A family with some uncertain factors; its jobs are otherwise the same."""

    factors: tuple[str, ...]  # keys of ``FACTORS``

    @classmethod
    def with_factors(cls, family: Family, factors: Sequence[str]) -> "Rung":
        """Return a family in which some factors are uncertain."""
        return cls.model_validate(family.model_dump() | {"factors": tuple(factors)})

    def draw_numbers(self, split: str, numbers: NDArray[np.uint64]) -> DrawnJobs:
        """Draw the family's jobs, then make the truth certain in all other factors.

        ``numbers`` are those of the jobs, shape (jobs,).
        """
        jobs = super().draw_numbers(split, numbers)
        nominal_fields = dict(jobs.nominal_fields)
        true_fields = dict(jobs.true_fields)
        for factor in FACTORS.keys() - set(self.factors):
            for name in SPREADS.get(factor, ()):
                # The family leaves some of these fields to its base.
                nominal_fields.setdefault(name, self._base[name])
                true_fields[name] = 0.0
            for name in jobs.true_fields:
                if is_of(name, ERRORS.get(factor, ())):
                    true_fields[name] = nominal_fields[name]
        return replace(
            jobs,
            true=self.batch_of(true_fields, len(numbers)),
            nominal=self.batch_of(nominal_fields, len(numbers)),
            true_fields=true_fields,
            nominal_fields=nominal_fields,
        )


class TruthfulRung(Truthful, Rung):
    """A ``Rung`` whose nominal models are true, for the oracle."""


def is_of(name: str, places: Sequence[str]) -> bool:
    """Return whether a dotted name is one of some fields, or lies in one of some sections."""
    sections = tuple(place for place in places if place.endswith("."))
    return name in places or name.startswith(sections)


def played(rung: Rung, policy: str, num_jobs: int, runs: Path) -> Episodes:
    """Return the episodes of a policy on a rung, which are played unless they are kept."""
    jobs = range(num_jobs)
    player: Any = policy
    family: Family = rung
    if policy == CAUSAL:
        version: int | str = VERSION
        family = TruthfulRung.of(rung)
    elif policy in catalogue.RULES:
        version = catalogue.RULES[policy].version
    elif policy == NOMINAL_SHARE:
        version = 1
    else:
        player = onnx_policy.load(AGENTS / f"{policy}{ONNX_SUFFIX}")
        version = player.sha256
    identity = [FAMILY, SPLIT, num_jobs, MODEL_VERSION, policy, version, rung.digest()]
    plays = FamilyPlay(family, SPLIT, player, forgets=False)
    work = partial(plays, family.job(0).scenario, jobs, lambda ended: None)
    return kept_episodes(runs, identity, work)


Returns = Mapping[str, Mapping[str, Floats]]
"""Returns of the jobs [s] by rung and policy, shape (jobs,) each."""


def regrets(returns: Returns) -> Iterator[dict[str, str]]:
    """Yield the cells of each rung's regrets, by heading."""
    for rung, by_policy in returns.items():
        cells = {
            "Uncertain": rung,
            "`causal` returns": mean_text(by_policy[CAUSAL]),
        }
        for policy, regret in regrets_of(by_policy).items():
            cells[f"`{policy}`"] = mean_text(regret)
        yield cells


def additions(returns: Returns) -> Iterator[dict[str, str]]:
    """Yield the cells of what each rung adds to the regrets without any factor, by heading."""
    without_any = regrets_of(returns[NONE])
    for rung, by_policy in returns.items():
        if rung == NONE:
            continue
        cells = {"Uncertain": rung}
        for policy, regret in regrets_of(by_policy).items():
            cells[f"`{policy}`"] = mean_text(regret - without_any[policy])
        yield cells


def regrets_of(by_policy: Mapping[str, Floats]) -> dict[str, Floats]:
    """Return the regrets of all policies but the oracle [s], shape (jobs,) each."""
    oracle = by_policy[CAUSAL]
    return {policy: oracle - by_policy[policy] for policy in by_policy if policy != CAUSAL}


def mean_text(values: Floats) -> str:
    """Return the mean over jobs with its interval."""
    replicates = Bootstrap(len(values)).means(values[np.newaxis], "jobs")
    mean = Estimate.of(values.mean(), replicates)
    return f"{mean.value:.0f} ({mean.low:.0f} to {mean.high:.0f})"


@exits(ValueError, interrupted="interrupted: run the same command again to go on")
def main(arguments: Sequence[str] | None = None) -> int:
    """Play all that is missing and print the tables; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m research.studies.ladder", **described(__doc__))
    add = parser.add_argument
    add("--rungs", nargs="+", choices=RUNGS, default=tuple(RUNGS), metavar="RUNG")
    add("--policies", nargs="+", choices=POLICIES, default=POLICIES, metavar="POLICY")
    add("--jobs", type=positive, default=JOBS, metavar="N", help="(default: %(default)s)")
    add("--runs", type=Path, default=Path("runs"), help="folder of all runs (default: %(default)s)")
    options = parser.parse_args(arguments)
    policies = list(dict.fromkeys([*options.policies, CAUSAL]))
    family = Family.load(FAMILY)
    returns: dict[str, dict[str, Floats]] = {}
    with tqdm(total=len(options.rungs) * len(policies), unit="play", disable=None) as bar:
        for name in options.rungs:
            rung = Rung.with_factors(family, RUNGS[name])
            returns[name] = {}
            for policy in policies:
                bar.set_postfix_str(f"{name}, {policy}")
                episodes = played(rung, policy, options.jobs, options.runs / "ladder")
                returns[name][policy] = episodes["return"]
                bar.update()
    print(markdown(list(regrets(returns))))
    if NONE in returns:
        print()
        print(markdown(list(additions(returns))))
    return 0


if __name__ == "__main__":
    sys.exit(main())
