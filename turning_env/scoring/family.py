"""Play policies on the jobs of a family, and families whose nominal models are right.

Seeds are those of the family's environments, so all policies meet the same bars.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from turning_env.family_env import Context, FamilyVectorEnv
from turning_env.scenario.family import Draw, Family, Job
from turning_env.scenario.plan import features, plan_of
from turning_env.scoring.play import Episodes, play
from turning_env.scoring.policy import PolicyFactory


def play_jobs(family: Family, split: str, seeds: Sequence[int], make: Callable[[Job], PolicyFactory],
              on_step: Callable[[int], None] = lambda ended: None) -> Episodes:  # fmt: skip
    """Play one episode per seed, each with a policy that is made for the seed's job; returns and raises as ``play``."""
    played = []
    for seed in seeds:
        job = family.job(seed, split)
        played.append(play(make(job), job.scenario, [seed]))
        on_step(len(played))
    return {name: np.concatenate([each[name] for each in played]) for name in played[0]}


def play_family(
    family: Family,
    split: str,
    seeds: Sequence[int],
    make_policy: PolicyFactory,
    context: Context = "told",
    on_step: Callable[[int], None] = lambda ended: None,
    *,
    tell: bool = False,
) -> Episodes:
    """Play one episode per seed, all in one batch, with a policy that plays all jobs; see ``play``.

    A controller that is built for the jobs needs the ``context`` "hidden".
    """
    env = FamilyVectorEnv(len(seeds), family, split, context, AutoresetMode.SAME_STEP)
    return play(make_policy, env, seeds, on_step, tell=tell)


class Truthful(Family):
    """A family whose nominal models are right in some fields; its jobs are otherwise the same."""

    right: str | tuple[str, ...] = ""  # how the dotted names of these fields begin, or one of several beginnings

    def __reduce__(self) -> Any:
        """Pickle the family without its jobs."""
        return Truthful.model_validate, (self.model_dump(),)

    def _drawn(self, split: str, numbers: NDArray[np.uint64]) -> Draw:
        draw = super()._drawn(split, numbers)
        nominal, true = draw.fields
        told = {name: true[name] if name.startswith(self.right) else value for name, value in nominal.items()}
        columns = self.columns(told)
        plan = plan_of(columns, len(numbers))
        context = features(columns, plan) | {name: draw.features[name] for name in self.shown}
        return replace(draw, nominal=columns, plan=plan, fields=(told, true), features=context)


def truthful(family: Family, right: str | tuple[str, ...] = "") -> Truthful:
    """Return the family with nominal models that are right in the fields whose dotted names begin so, or one of these ways."""
    return Truthful.model_validate(family.model_dump() | {"right": right})
