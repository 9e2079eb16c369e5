"""Specification of ``RoughTurning-Family-v1``: every episode is another job."""

import os
from collections.abc import Mapping
from typing import Any, Literal, get_args

from gymnasium.vector import AutoresetMode

from turning_env.batch.driver import Jobs
from turning_env.env import BaseEnv, RoughTurningEnv
from turning_env.scenario import Scenario
from turning_env.scenario.family import Family, Job, families
from turning_env.vector_env import RoughTurningVectorEnv

FamilySource = str | os.PathLike[str] | Mapping[str, Any] | Family
Context = Literal["told", "hidden"]


class FamilyBase(BaseEnv):
    """Base of environments that play the jobs of a family."""

    def _jobs(self, family: FamilySource, split: str, context: Context) -> Jobs:
        if context not in get_args(Context):
            raise ValueError(f'context is {context!r}, but must be "told" or "hidden"')
        self.family = Family.load(family)
        self.split = split
        return Jobs(self.family, split, shows_context=context == "told")

    def job(self, env_index: int = 0) -> Job:
        """Return an environment's present job: its true scenario, nominal model and context."""
        return self._batch.job(env_index)


def vector_env(
    source: str | os.PathLike[str] | Scenario | Family,
    num_envs: int,
    autoreset_mode: AutoresetMode,
    **kwargs: Any,
) -> RoughTurningVectorEnv:
    """Return a batch of a scenario's environments, or of a family's training jobs.

    The source is a scenario or a ``Family``, or the name of either. ``kwargs`` are further
    arguments of ``RoughTurningVectorEnv``. Raise ScenarioError if it names neither.
    """
    if isinstance(source, Family) or (isinstance(source, str) and source in families()):
        return FamilyVectorEnv(num_envs, source, autoreset_mode=autoreset_mode, **kwargs)
    return RoughTurningVectorEnv(num_envs, source, autoreset_mode=autoreset_mode, **kwargs)


class FamilyEnv(FamilyBase, RoughTurningEnv):
    """``RoughTurning-Family-v1``: rough turning on many lathes, whose nominal models are wrong.

    ## Description

    Every episode is a job drawn from a family (default: `shop`): one lathe, one material, one kind
    of insert and one kind of bar, for the time that about five edges last. The laws of power,
    thrust force and wear, the drives' lags and the edges' strength differ from the nominal model,
    by which the observation's predictions are made. Edges are changed on command, as in `ShiftEnv`,
    so what the first edge teaches pays on the others. `reset(seed=s)` starts the job of seed s,
    `reset()` the next.

    ## Action space

    `Box(-1, 1, (3,), float32)`, as for `ShiftEnv`: changes of speed and feed, and above 0 a change
    of the edge. Ranges of speed and feed, and limits, are the job's.

    ## Observation space

    The 11 entries of `RoughTurningEnv`, scaled by the job's ranges and limits, and `removed_wear`,
    the measured wear of the edge that was taken out last over the criterion (0 before the first
    change). With `context="told"`, the nominal model's numbers follow, standardised by the training
    jobs and limited to -10..10 (`Family.context_names`): exponents of the three laws; logarithms of
    load, life, removal rate, prices, spreads, lengths and lags; and at five used lives the best
    speed, feed and life. If the family's `fields` set `sensors.observes_all`, the hidden state
    follows `removed_wear`, and the context also has these numbers by the true laws, and the hidden
    forms (`true_...`).

    ## Reward and end

    As for `ShiftEnv`. The reference removal rate is the best that the nominal model can sustain, so
    holding it would earn about 0 if the model were right. Truncated when the job's time is over.

    ## Info

    As for `RoughTurningEnv`, and `job`, the number of the job in its split.

    ## Arguments

    `family`: the name of a family, the path of its TOML file, a dict or a `Family`. `split`:
    "train"; "validation", by which agents are chosen; or "unseen_jobs", "unseen_materials",
    "unseen_machines", on which they are scored. No training seed plays the jobs of another split.
    `context`: "told" or "hidden". `render_mode`: None, "rgb_array" or "human": frames show the
    present job.
    """

    def __init__(
        self,
        family: FamilySource = "shop",
        split: str = "train",
        context: Context = "told",
        render_mode: str | None = None,
    ) -> None:
        super().__init__(self._jobs(family, split, context), render_mode)


class FamilyVectorEnv(FamilyBase, RoughTurningVectorEnv):
    """``num_envs`` independent environments, each exactly the ``FamilyEnv`` with its seed.

    See ``RoughTurningVectorEnv`` for the other arguments.
    """

    def __init__(
        self,
        num_envs: int = 1,
        family: FamilySource = "shop",
        split: str = "train",
        context: Context = "told",
        *args: Any,
        **kwargs: Any,
    ) -> None:
        super().__init__(num_envs, self._jobs(family, split, context), *args, **kwargs)
