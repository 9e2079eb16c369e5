from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.train.small import ALGORITHMS, small_run
from train.training import new_model


@pytest.mark.parametrize("means", [[], [-0.8], [-0.8, 0.5]])
def test_first_actions_vary_about_what_is_asked_for(means: list[float], tmp_path: Path) -> None:
    run = small_run(ALGORITHMS["ppo"], tmp_path)
    run = replace(run, parameters=run.parameters | {"initial_actions": means})
    model = new_model(run, ALGORITHMS["ppo"])
    observations = model.env.reset()
    actions, _ = model.predict(observations, deterministic=True)
    expected = np.zeros(2)
    expected[: len(means)] = means
    np.testing.assert_allclose(actions, np.broadcast_to(expected, actions.shape), atol=0.05)
