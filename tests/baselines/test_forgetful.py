"""Forgetting at each change of the edge."""

import numpy as np
from numpy.typing import NDArray

from baselines.forgetful import Forgetful
from turning_env.physics.quantities import OBS
from turning_env.policy import Actions, Observations, Policy


def test_a_forgetful_policy_is_reset_where_the_edge_is_fresh() -> None:
    resets: list[list[bool]] = []

    class Remembering(Policy):
        def reset(self, mask: NDArray[np.bool_]) -> None:
            resets.append(mask.tolist())

        def act(self, observations: Observations) -> Actions:
            return np.zeros((len(observations), 3), np.float32)

    forgetful = Forgetful(Remembering())
    # The second environment changes its edge before the third step.
    for wear in [(0.0, 0.0), (0.2, 0.1), (0.3, 0.0), (0.4, 0.1)]:
        observations = np.zeros((2, 11), np.float32)
        observations[:, OBS.nominal_wear] = wear
        forgetful.act(observations)
    assert resets == [[False, False], [False, True], [False, False]]
