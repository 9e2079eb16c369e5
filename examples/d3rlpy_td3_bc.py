"""d3rlpy: TD3+BC on a data set of Minari.

    python -m examples.d3rlpy_td3_bc --steps 20000
    python -m examples.d3rlpy_td3_bc --dataset runs/datasets/rough_turning-mixture-v0

Write a data set with ``python -m examples.offline make``. Without ``--dataset``, the script records 50 episodes of `load_rule`.
``--steps`` counts updates.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import d3rlpy
import numpy as np
from d3rlpy.algos import TD3PlusBCConfig
from d3rlpy.logging import NoopAdapterFactory

from examples import offline
from examples.shared import parser, run, score


def read(folder: Path) -> d3rlpy.dataset.MDPDataset:
    """Read a Minari data set as a d3rlpy data set."""
    episodes = list(offline.load(folder).iterate_episodes())
    return d3rlpy.dataset.MDPDataset(
        observations=np.concatenate([episode.observations[:-1] for episode in episodes]),
        actions=np.concatenate([episode.actions for episode in episodes]),
        rewards=np.concatenate([episode.rewards for episode in episodes]),
        terminals=np.concatenate([episode.terminations for episode in episodes]),
        timeouts=np.concatenate([episode.truncations for episode in episodes]),
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Read or record a data set, learn, score; return the exit status."""
    command_line = parser("d3rlpy_td3_bc", __doc__, 20_000)
    command_line.add_argument("--dataset", type=Path, help="a folder (default: record one)")
    options = command_line.parse_args(arguments)
    with TemporaryDirectory() as folder:
        dataset = read(options.dataset or offline.make("load_rule", 50, Path(folder)))
    d3rlpy.seed(options.seed)
    learner = TD3PlusBCConfig(gamma=0.8, reward_scaler=d3rlpy.preprocessing.StandardRewardScaler()).create()
    learner.fit(dataset, options.steps, options.steps, logger_adapter=NoopAdapterFactory(), show_progress=False)
    print(f"load_rule: {score(offline.load_rule, options.tuning_seeds)}")
    print(f"TD3+BC after {options.steps} steps: {score(learner.predict, options.tuning_seeds)}")
    return 0


if __name__ == "__main__":
    sys.exit(run(main))
