"""Train a guide of ``self_tuning`` with PPO for one training seed.

    python -m train.guided_ppo --env RoughTurning-Family-v1 --scenario unmodelled --seed 0

A guide sets the highest speed of the rule and the used life at which it changes edges
(``baselines/guided.py``). It sees more than the rule: the catalogue's numbers that the family
shows, and what became of earlier edges. ``docs/unmodelled.md`` has the results.

A step of this training is a decision, which holds for ``HOLD`` steps of the environment. Each
environment keeps its job, with new bars in every episode. The same command resumes an interrupted
training, and does nothing if training is finished.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from baselines.guided import HOLD, GuidedRule, decision_space, feature_space
from train import ppo
from train.training import command_line
from turning_env import Family, FamilyVectorEnv
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv


class GuidedVecEnv(RoughTurningVecEnv):
    """Training jobs of a family behind Stable-Baselines3's ``VecEnv``.

    Observations are the features of a guide, actions its decisions. See ``RoughTurningVecEnv`` for
    the arguments. The return of an ``episode`` is the job's [s].
    """

    def __init__(
        self,
        family: Family,
        num_envs: int,
        reward_scale: float = 1.0,
        wrapper: Callable[[Any], Any] | None = None,
    ) -> None:
        # No wrapper: the rule reads plain observations, and the guide sees features of the rule.
        super().__init__(family, num_envs, reward_scale)
        self._family = family
        # This class starts episodes itself: the rule must know when its job starts again.
        self.vector_env = FamilyVectorEnv(num_envs, family, autoreset_mode=AutoresetMode.DISABLED)
        self.observation_space = feature_space(len(family.context_names))
        self.action_space = decision_space()

    def reset(self) -> NDArray[np.float32]:
        """Return first features, shape (num_envs, entries); see ``RoughTurningVecEnv.reset``."""
        seeds = [index if seed is None else seed for index, seed in enumerate(self._seeds)]
        self._episode_seeds = np.array(seeds)
        self._observations, infos = self.vector_env.reset(seed=self._episode_seeds.tolist())
        self._reset_seeds()
        self._clear_sums(np.ones(self.num_envs, np.bool_))
        jobs = [self._family.job(int(number)) for number in infos["job"]]
        self._rule = GuidedRule([job.scenario.nominal() for job in jobs])
        self._features = self._rule.features(self._observations)
        return self._features

    def step_wait(
        self,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        decision_rewards = np.zeros(self.num_envs)
        done = np.zeros(self.num_envs, np.bool_)
        env_infos: list[dict[str, Any]] = [{}] * self.num_envs
        self._rule.follow(self._actions)
        self._lengths += 1
        for _ in range(HOLD):
            actions = self._rule.act(self._observations)
            step = self.vector_env.step(actions)
            self._observations, rewards, terminated, truncated, infos = step
            # After an episode's end, the rest of the decision belongs to no episode.
            counted_rewards = np.where(done, 0.0, rewards)
            decision_rewards += counted_rewards
            self._returns += counted_rewards
            self._costs += np.where(done, 0.0, infos["cost"])
            ended = terminated | truncated
            if ended.any():
                for index in np.flatnonzero(ended & ~done).tolist():
                    env_infos[index] = self.info_at_end(
                        index, self._features[index], truncated=bool(truncated[index])
                    )
                done |= ended
                self._start_episodes(ended)
            self._features = self._rule.features(self._observations)
        rewards = (decision_rewards * self.reward_scale).astype(np.float32)
        return self._features, rewards, done, env_infos

    def _start_episodes(self, mask: NDArray[np.bool_]) -> None:
        """Start the same jobs with other bars in the environments of a mask, shape (num_envs,).

        The rule decides there until the guide's next decision.
        """
        # Seed s plays job s modulo the number of jobs.
        self._episode_seeds[mask] += self._family.jobs
        seeds = [
            int(seed) if starts else None
            for seed, starts in zip(self._episode_seeds, mask, strict=True)
        ]
        self._observations, _ = self.vector_env.reset(seed=seeds, options={"reset_mask": mask})
        self._rule.reset(mask)
        self._clear_sums(mask)


DEFAULTS: dict[str, Any] = {
    "total_timesteps": 1_500_000,  # decisions, each of 30 environment steps
    "num_envs": 1024,  # jobs, each in an environment of its own
    "n_steps": 24,  # decisions per environment between updates
    "batch_size": 2048,
    "n_epochs": 4,
    "gamma": 0.98,  # per half a minute: a horizon of 25 min
    "gae_lambda": 0.9,
    "learning_rate": 7e-4,  # falls linearly ...
    "final_learning_rate": 1e-5,  # ... to this
    "clip_range": 0.2,
    "ent_coef": 0.0,
    "vf_coef": 0.5,
    "max_grad_norm": 0.5,
    "net_arch": [64, 64],  # for policy and value function each
    "activation_fn": "tanh",  # or "relu"
    "log_std_init": -1.0,
    "initial_actions": [0.0, 0.2],  # near the best constants
    "reward_scale": 0.01,  # factor on rewards [s]
    "guide": True,  # its actions are decisions: baselines/guided.py
}

ALGORITHM = replace(
    ppo.ALGORITHM,
    name="guided_ppo",
    defaults=DEFAULTS,
    vec_env=GuidedVecEnv,
    single_scenarios=False,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
