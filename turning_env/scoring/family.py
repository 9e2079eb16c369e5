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
from turning_env.scenario.family import CHUNK, Draw, Family, Job
from turning_env.scenario.plan import features, plan_of
from turning_env.scoring.play import Episodes, play
from turning_env.scoring.policy import PolicyFactory
from turning_env.scoring.statistics import Floats


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
    """A family whose nominal models are right, or nearly: policies are told the true laws, and observations compare with them."""

    right: str = ""
    """How the names of the fields begin that are right."""
    errors: tuple[float, ...] = (0.0,)
    """Shares of these fields' errors that remain, each for a chunk of jobs in turn."""

    def __reduce__(self) -> Any:
        """Pickle the family without its jobs."""
        return Truthful.model_validate, (self.model_dump(),)

    def error(self, numbers: NDArray[np.int64]) -> Floats:
        """Return the share of errors that remains in jobs by number."""
        return np.array(self.errors)[numbers // CHUNK % len(self.errors)]

    def _drawn(self, split: str, numbers: NDArray[np.uint64]) -> Draw:
        draw, share = super()._drawn(split, numbers), self.error(numbers.astype(np.int64))
        nominal, true = draw.fields
        told = {
            name: _between(true[name], value, share) if name.startswith(self.right) else value for name, value in nominal.items()
        }
        columns = self.columns(told)
        plan = plan_of(columns, len(numbers))
        return replace(draw, true=self.columns(true, columns), plan=plan, fields=(told, true), features=features(columns, plan))


def _between(true: Any, nominal: Any, share: Floats) -> Any:
    """Return values with a share of the error of nominal ones; what is no array is the same in all jobs."""
    if not isinstance(nominal, np.ndarray):
        return true
    return np.where(share < 1.0, true + share * (nominal - true), nominal)


def truthful(family: Family, right: str = "", errors: Sequence[float] = (0.0,)) -> Truthful:
    """Return the family with nominal models that are right in the fields whose dotted names begin so; see ``Truthful``.

    Its jobs are otherwise the same.

    Raises:
        ValueError: there are no ``errors``, or some are not from 0 to 1.
    """
    if not errors or not all(0.0 <= error <= 1.0 for error in errors):
        raise ValueError(f"errors is {list(errors)}, but must be one or more numbers from 0 to 1")
    return Truthful.model_validate(family.model_dump() | {"right": right, "errors": tuple(errors)})
