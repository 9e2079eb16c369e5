"""TQC, SAC that knows how returns are distributed and leaves out the highest: train one agent for one training seed.

    python -m train.tqc --seed 0

Running the same command again resumes an interrupted training, and does nothing if it is finished. What a run's folder holds:
``train/training.py``. (Kuznetsov et al. 2020, arXiv 2005.04269.)
"""

import sys
from pathlib import Path

from optuna.distributions import FloatDistribution, IntDistribution
from sb3_contrib import TQC

from train import command
from train.feedforward import Feedforward
from train.run import Run
from train.sac import settings, squashed
from train.training import Algorithm
from train.vec_env import RoughTurningVecEnv


def new_model(run: Run, lathes: RoughTurningVecEnv) -> TQC:
    """An untrained model."""
    p, values = run.parameters, settings(run, lathes)
    values["policy_kwargs"] |= {"n_critics": p["critics"], "n_quantiles": p["quantiles"]}
    return TQC("MlpPolicy", lathes, top_quantiles_to_drop_per_net=p["dropped_quantiles"], **values)


def actor(path: Path) -> Feedforward:
    """The finished agent in a ``policy.zip`` of your own."""
    return squashed(TQC.load(path, device="cpu").actor)


SEARCH = {
    "learning_rate": FloatDistribution(3e-4, 3e-3, log=True),
    "discount": FloatDistribution(0.5, 0.95),
    "dropped_quantiles": IntDistribution(0, 6),
    "target_entropy_per_action": FloatDistribution(-3.0, -0.5),
}

ALGORITHM = Algorithm("tqc", "TQC", TQC, new_model, actor, SEARCH, kept=("replay_buffer",), log_interval=100)


def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    return command.main(ALGORITHM, arguments)


if __name__ == "__main__":
    sys.exit(main())
