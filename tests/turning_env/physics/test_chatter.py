"""Chatter of slender bars."""

import numpy as np
import pytest

from tests.turning_env.playing import UNDISTURBED, changed, infos

GAIN = 0.4  # share of the static force [-]
WORST_SPEED = 500.0  # [rev/min]
WIDTH = 0.1  # of log speed [-]
CHATTERING = changed(
    UNDISTURBED,
    machine={"chatter": GAIN, "chatter_speed": WORST_SPEED, "chatter_width": WIDTH},
)


def test_a_bar_chatters_about_one_spindle_speed():
    dynamic_shares = []
    for action in np.linspace(-0.5, 0.5, 21):
        (still,) = infos(UNDISTURBED, [(action, 0.0)])
        (chattering,) = infos(CHATTERING, [(action, 0.0)])
        log_ratio = np.log(still["spindle_speed"] / WORST_SPEED)
        dynamic_share = GAIN * np.exp(-((log_ratio / WIDTH) ** 2))
        expected_force = still["thrust_force"] * (1 + dynamic_share)
        assert chattering["thrust_force"] == pytest.approx(expected_force, rel=1e-9)
        assert chattering["power"] == still["power"]
        dynamic_shares.append(dynamic_share)
    # The speeds reach from the worst one to quiet ones.
    assert max(dynamic_shares) > 0.35
    assert min(dynamic_shares) < 0.01
