"""Train with FOCOPS, first order constrained optimisation in policy space, for one training seed.

    python -m train.focops --seed 0

(Zhang, Vuong and Ross 2020, arXiv 2002.06506.) The allowance of overload is that of ``train/lagrangian_ppo.py``, and the
multiplier is set as in ``train/pid_lagrangian_ppo.py``; the paper's rule is ``gain_p = gain_d = 0``. The policy's update differs
from PPO's: it approaches the best policy near the last one, q(a) ~ p_last(a) exp(A(a) / temperature), by gradient descent on

    KL(p, p_last) - p / p_last * A / temperature

in those states where KL(p, p_last) is within ``kl_limit``. A is the advantage of the rewards less the multiplier's charge,
normalised. Advantages are linear in the rewards, so one value function stands for the paper's two, of rewards and of costs.
The same command resumes an interrupted training, and does nothing if training is finished. Files: see ``train/training.py``.
"""

import copy
import dataclasses
import sys
from functools import partial
from typing import Any

import torch
from optuna.distributions import FloatDistribution
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv
from torch.distributions import kl_divergence

from train import pid_lagrangian_ppo, ppo
from train.run import Run
from train.training import command_line

_UNUSED = {"clip_range": 0.2, "entropy_coefficient": 0.0}  # settings of PPO without effect here


class FOCOPS(PPO):
    """PPO of Stable-Baselines3 with the update of FOCOPS, which neither clips nor rewards entropy."""

    def __init__(self, *arguments: Any, temperature: float = 1.0, kl_limit: float = 0.02, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.temperature, self.kl_limit = temperature, kl_limit

    def train(self) -> None:
        """Update policy and value function with the last rollout, until the mean KL divergence of an epoch exceeds its limit."""
        self.policy.set_training_mode(True)
        self._update_learning_rate(self.policy.optimizer)
        last = copy.deepcopy(self.policy)
        divergence = 0.0
        for _ in range(self.n_epochs):
            divergences = []
            for batch in self.rollout_buffer.get(self.batch_size):
                ours: Any = self.policy.get_distribution(batch.observations)
                with torch.no_grad():
                    theirs: Any = last.get_distribution(batch.observations)
                kl = kl_divergence(ours.distribution, theirs.distribution).sum(dim=1)
                ratio = torch.exp(ours.log_prob(batch.actions) - batch.old_log_prob)
                advantages = (batch.advantages - batch.advantages.mean()) / (batch.advantages.std() + 1e-8)
                near = (kl <= self.kl_limit).detach()
                policy_loss = (near * (kl - ratio * advantages / self.temperature)).mean()
                values = self.policy.predict_values(batch.observations).flatten()
                value_loss = torch.nn.functional.mse_loss(values, batch.returns)
                self.policy.optimizer.zero_grad()
                loss: Any = policy_loss + self.vf_coef * value_loss
                loss.backward()
                torch.nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
                self.policy.optimizer.step()
                divergences.append(kl.mean().item())
            self._n_updates += 1
            divergence = sum(divergences) / len(divergences)
            if divergence > self.kl_limit:
                break
        self.logger.record("train/kl_divergence", divergence)


def new_model(run: Run, vec_env: VecEnv) -> FOCOPS:
    """Return an untrained model, and set the initial multiplier."""
    assert isinstance(vec_env, pid_lagrangian_ppo.PidVecEnv)
    p = run.parameters
    vec_env.multiplier = p["initial_multiplier"]
    values = ppo.settings(dataclasses.replace(run, parameters=p | _UNUSED))
    return FOCOPS("MlpPolicy", vec_env, temperature=p["temperature"], kl_limit=p["kl_limit"], **values)


SEARCH = pid_lagrangian_ppo.SEARCH | {
    "temperature": FloatDistribution(0.3, 3.0, log=True),
    "kl_limit": FloatDistribution(0.005, 0.1, log=True),
}

ALGORITHM = dataclasses.replace(
    pid_lagrangian_ppo.ALGORITHM, name="focops", title="FOCOPS", model=FOCOPS, new_model=new_model, search=SEARCH
)


main = partial(command_line, ALGORITHM)

if __name__ == "__main__":
    sys.exit(main())
