"""A training plays the seeds that are its own, and through whatever episodes no others."""

from pathlib import Path
from typing import Any

import pytest

from tests.train import small
from train.training import SEED_STRIDE, SEEDS, Algorithm, train
from turning_env.batch.driver import Batch
from turning_env.score.seeds import TUNING_START


@pytest.mark.parametrize("algorithm", small.ALGORITHMS.values(), ids=small.ALGORITHMS)
def test_trainings_play_their_own_seeds_alone(algorithm: Algorithm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given: set[int] = set()
    seed = Batch.seed

    def watched(self: Batch, lanes: Any, seeds: Any) -> None:
        given.update(int(number) for number in seeds)
        seed(self, lanes, seeds)

    monkeypatch.setattr(Batch, "seed", watched)
    run = small.small_run(algorithm, tmp_path, steps=1024)
    train(run, algorithm)
    own = range(run.seed * SEED_STRIDE, (run.seed + 1) * SEED_STRIDE)
    assert given
    assert all(number in own for number in given)


def test_no_training_seed_reaches_the_draws_of_tuning() -> None:
    assert SEEDS * SEED_STRIDE <= TUNING_START
