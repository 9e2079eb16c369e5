"""Train an agent with TQC for one training seed.

    python -m train.tqc --seed 0

TQC is SAC with distributional critics, whose highest quantiles are dropped. The same command
resumes an interrupted training, and does nothing if training is finished. Files: see
``train/training.py``. (Kuznetsov et al. 2020, arXiv 2005.04269.)
"""

import sys
from typing import Any

from optuna.distributions import FloatDistribution, IntDistribution
from sb3_contrib import TQC
from stable_baselines3.common.vec_env import VecEnv

from train import sac
from train.run import Run
from train.training import Algorithm, command_line


def new_model(run: Run, vec_env: VecEnv) -> TQC:
    """Return an untrained model."""
    p = run.parameters
    arguments = sac.settings(run, vec_env)
    arguments["top_quantiles_to_drop_per_net"] = p["top_quantiles_to_drop_per_net"]
    arguments["policy_kwargs"]["n_critics"] = p["n_critics"]
    arguments["policy_kwargs"]["n_quantiles"] = p["n_quantiles"]
    return TQC("MlpPolicy", vec_env, **arguments)


DEFAULTS: dict[str, Any] = sac.DEFAULTS | {
    "batch_size": 256,
    "n_critics": 2,
    "n_quantiles": 10,  # of the return, of each critic
    "top_quantiles_to_drop_per_net": 1,  # highest quantiles, of each critic
}

SEARCH = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "gamma": FloatDistribution(0.5, 0.999),
    "top_quantiles_to_drop_per_net": IntDistribution(0, 6),
    "target_entropy_per_action": FloatDistribution(-3.0, -0.5),
}

ALGORITHM = Algorithm(
    name="tqc",
    model=TQC,
    new_model=new_model,
    network=sac.network,
    defaults=DEFAULTS,
    search=SEARCH,
    training_information=("rewards",),
    extra_state=("replay_buffer",),
    log_interval=100,
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    return command_line(ALGORITHM, __doc__, arguments)


if __name__ == "__main__":
    sys.exit(main())
