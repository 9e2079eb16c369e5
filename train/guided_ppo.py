"""Train a guide of ``self_tuning`` with PPO for one training seed: it sets the highest speed and when edges are changed.

    python -m train.guided_ppo --env RoughTurning-Family-v0 --scenario unmodelled --seed 0
    python -m train.guided_ppo --env RoughTurning-Family-v0 --scenario unmodelled --seed 1 --total-timesteps 500000

The guide is told what the rule is not: the catalogue's numbers that the family shows, and what became of earlier edges
(``baselines/guided.py``). On the family ``unmodelled``, a linear law of two of these numbers (``baselines/contextual.py``)
returns as much; ``docs/unmodelled.md`` has the differences. A step of this training is a decision, which holds for
``HOLD`` steps of the environment. Each environment keeps its job, with new bars in every episode. The same command resumes an
interrupted training, and does nothing if training is finished.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from baselines.guided import HOLD, GuidedRule, decision_space, feature_space
from train import ppo
from train.training import command_line
from turning_env import Family, FamilyVectorEnv, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv


class GuidedVecEnv(RoughTurningVecEnv):
    """Training jobs of a family behind Stable-Baselines3's ``VecEnv``, whose actions are a guide's decisions.

    See ``RoughTurningVecEnv`` for the arguments. The return of an ``episode`` is the job's [s].
    """

    def __init__(
        self,
        scenario: Scenario | Family,
        num_envs: int,
        reward_scale: float = 1.0,
        wrapper: Callable[[Any], Any] | None = None,
    ) -> None:
        if not isinstance(scenario, Family):
            raise ValueError(
                f"a guide learns on the jobs of a family, not on scenario {scenario.name!r}"
            )
        super().__init__(scenario, num_envs, reward_scale)
        self._family = scenario
        self.vector_env = FamilyVectorEnv(num_envs, scenario, autoreset_mode=AutoresetMode.DISABLED)
        self.observation_space, self.action_space = (
            feature_space(len(scenario.context_names)),
            decision_space(),
        )

    def reset(self) -> NDArray[np.float32]:
        """Return first features, shape (num_envs, entries); see ``RoughTurningVecEnv.reset``."""
        self._own = np.array([i if seed is None else seed for i, seed in enumerate(self._seeds)])
        self._observations, infos = self.vector_env.reset(seed=self._own.tolist())
        self._reset_seeds()
        self._returns[:], self._lengths[:] = 0.0, 0
        self._rule = GuidedRule(
            [self._family.job(int(number)).scenario.nominal() for number in infos["job"]]
        )
        self._features = self._rule.features(self._observations)
        return self._features

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        gained, done = np.zeros(self.num_envs), np.zeros(self.num_envs, np.bool_)
        env_infos: list[dict[str, Any]] = [{}] * self.num_envs
        self._rule.follow(self._actions)
        self._lengths += 1
        for _ in range(HOLD):
            self._observations, rewards, terminated, truncated, _ = self.vector_env.step(
                self._rule.act(self._observations)
            )
            counted = np.where(done, 0.0, rewards)  # the rest of the decision belongs to no episode
            gained += counted
            self._returns += counted
            if (ended := terminated | truncated).any():
                for i in np.flatnonzero(ended & ~done).tolist():
                    env_infos[i] = self.info_at_end(i, self._features[i], bool(truncated[i]))
                done |= ended
                self._begin(ended)
            self._features = self._rule.features(self._observations)
        return self._features, (gained * self.reward_scale).astype(np.float32), done, env_infos

    def _begin(self, ended: NDArray[np.bool_]) -> None:
        """Begin the job anew, with other bars, where it has ended; the rule decides until the guide does."""
        self._own[ended] += self._family.jobs
        seeds = [int(seed) if new else None for seed, new in zip(self._own, ended, strict=True)]
        self._observations, _ = self.vector_env.reset(seed=seeds, options={"reset_mask": ended})
        self._rule.reset(ended)
        self._returns[ended], self._lengths[ended] = 0.0, 0


ALGORITHM = replace(ppo.ALGORITHM, name="guided_ppo", vec_env=GuidedVecEnv)

main = partial(command_line, ALGORITHM)

if __name__ == "__main__":
    sys.exit(main())
