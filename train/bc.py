"""Train an agent offline to act as the policy of a data set, for one training seed.

    python -m train.datasets --policy self_tuning
    python -m train.bc --env RoughTurning-Family-v1 --set behaviour=self_tuning --seed 0

Behaviour cloning: a regression of recorded actions on observations (Pomerleau 1991, "Efficient
training of artificial neural networks for autonomous navigation"). Rewards are not used. The base
of all offline algorithms is ``train/offline.py``.
"""

import sys

import torch
from optuna.distributions import FloatDistribution
from stable_baselines3.common.vec_env import VecEnv

from train.offline import DEFAULTS, Batch, OfflineAlgorithm, OfflinePolicy, network, options_of
from train.run import Run
from train.training import Algorithm, command_line


class BC(OfflineAlgorithm):
    """The algorithm; see ``OfflineAlgorithm``."""

    def update(self, batch: Batch) -> dict[str, float]:
        """Take a step towards the recorded actions."""
        actions = self.policy.actor(batch.observations)
        loss = torch.nn.functional.mse_loss(actions, batch.actions)
        self.policy.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self.policy.optimizer.step()
        return {"loss": loss.item()}


def new_model(run: Run, vec_env: VecEnv) -> BC:
    """Return an untrained model."""
    return BC(OfflinePolicy, vec_env, **options_of(run, vec_env))


ALGORITHM = Algorithm(
    name="bc",
    model=BC,
    new_model=new_model,
    network=network,
    defaults=DEFAULTS,
    search={"learning_rate": FloatDistribution(1e-4, 3e-3, log=True)},
    # The data set's policy is a further input: see ``training_inputs`` of leaderboard/inputs.py.
    training_information=(),
    single_scenarios=False,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
