"""Chatter of slender bars."""

import numpy as np
import pytest

from tests.turning_env.playing import UNDISTURBED, changed, infos


def test_a_bar_chatters_about_one_spindle_speed():
    chatter = {"chatter": 0.4, "chatter_speed": 500.0, "chatter_width": 0.1}
    over = []
    for action in np.linspace(-0.5, 0.5, 21):
        still, sings = (
            infos(each, [(action, 0.0)])[0]
            for each in (UNDISTURBED, changed(UNDISTURBED, machine=chatter))
        )
        turns = 1000 * still["cutting_speed"] / (np.pi * UNDISTURBED.workpiece.diameter)
        dynamic = 0.4 * np.exp(-((np.log(turns / 500) / 0.1) ** 2))
        assert sings["thrust_force"] / still["thrust_force"] == pytest.approx(1 + dynamic, rel=1e-9)
        assert sings["power"] == still["power"]
        over.append(dynamic)
    assert max(over) > 0.35 > 0.01 > min(over)
