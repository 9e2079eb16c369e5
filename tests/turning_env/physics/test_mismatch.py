"""Effects of model mismatch on the process, which nominal predictions ignore."""

import numpy as np
import pytest

from tests.turning_env.playing import UNDISTURBED, changed, play
from turning_env import RoughTurningEnv, read

STEADY = changed(UNDISTURBED, control={"interval": 1})
SKIN = {"skin_thickness": 0.5, "skin_hardness": 1.4, "skin_wear": 1.5}
INITIAL_WEAR = 0.2
INITIAL_USED_LIFE = (INITIAL_WEAR / 0.3) ** (1 / 0.245)
WORN = {"initial_wear": INITIAL_WEAR}


def steps(scenario, count, action=(0.0, 0.0)):
    return play(RoughTurningEnv(scenario), 3, np.tile(np.array(action, np.float32), (count, 1)))


def with_mismatch(scenario=STEADY, **mismatch):
    return changed(scenario, mismatch=mismatch)


@pytest.mark.parametrize(
    "mismatch",
    [
        {"hardness_factor": 1.2},
        SKIN,
        {"wear_factor": 1.3},
        WORN,
        {"power_bias": -0.1, "force_bias": -0.2},
    ],
    ids=lambda mismatch: next(iter(mismatch)),
)
def test_the_nominal_predictions_know_nothing_of_the_mismatch(mismatch):
    told, untold = (
        read(steps(scenario, 60, (-0.8, -0.8))["observation"][31:], scenario)
        for scenario in (STEADY, with_mismatch(**mismatch))
    )  # before, the force of a worn edge is out of an observation's range
    assert not np.allclose(told.power_ratio, untold.power_ratio, rtol=1e-4)
    assert untold.nominal_wear.tolist() == told.nominal_wear.tolist()
    assert untold.power / untold.power_ratio == pytest.approx(
        told.power / told.power_ratio, rel=1e-6
    )
    assert untold.thrust_force / untold.force_ratio == pytest.approx(
        told.thrust_force / told.force_ratio, rel=1e-6
    )


def test_skin_hardens_the_cut_and_wears_the_edge_by_its_share_of_depth():
    share = SKIN["skin_thickness"] / STEADY.workpiece.depth_of_cut
    nominal, skinned = steps(STEADY, 20), steps(with_mismatch(**SKIN), 20)
    hardness = 1 + share * (SKIN["skin_hardness"] - 1)
    assert skinned["hardness"] == pytest.approx(hardness, rel=1e-12)
    wear = hardness**STEADY.material.wear.hardness * (1 + share * (SKIN["skin_wear"] - 1))
    assert skinned["wear"][1:] / nominal["wear"][1:] == pytest.approx(wear, rel=1e-9)
    assert steps(with_mismatch(**SKIN | {"skin_thickness": 3.0}), 1)["hardness"] == pytest.approx(
        SKIN["skin_hardness"]
    )


def test_a_worn_edge_goes_on_from_its_wear_and_is_charged_what_is_used_of_it():
    worn = with_mismatch(**WORN)
    record = steps(worn, 3000, (0.5, 0.0))
    assert record["wear"][0] == pytest.approx(INITIAL_WEAR)
    assert (record["cutting_time"][0], read(record["observation"], worn).nominal_wear[0]) == (
        0.0,
        0.0,
    )
    end = int(np.flatnonzero(record["terminated"])[0])
    assert record["wear"][end] == pytest.approx(0.3, rel=1e-3)
    assert record["edges_used"][: end + 1].sum() == pytest.approx(1 - INITIAL_USED_LIFE, rel=1e-9)
    fresh = steps(STEADY, 3000, (0.5, 0.0))
    life = int(np.flatnonzero(fresh["terminated"])[0])
    assert end / life == pytest.approx(1 - INITIAL_USED_LIFE, abs=2 / life)
