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
    actions = np.tile(np.array(action, np.float32), (count, 1))
    return play(RoughTurningEnv(scenario), 3, actions)


def first_end(record):
    """Return the row in which the first episode of a record ends."""
    return int(np.flatnonzero(record["terminated"])[0])


def with_mismatch(**mismatch):
    return changed(STEADY, mismatch=mismatch)


def reading_of(scenario):
    """Return a reading from a slow cut; before, the force of a worn edge is out of range."""
    record = steps(scenario, 60, (-0.8, -0.8))
    return read(record["observation"][31:], scenario)


@pytest.mark.parametrize(
    "mismatch",
    [
        pytest.param({"hardness_factor": 1.2}, id="hardness"),
        pytest.param(SKIN, id="skin"),
        pytest.param({"wear_factor": 1.3}, id="wear"),
        pytest.param(WORN, id="initial wear"),
        pytest.param({"power_bias": -0.1, "force_bias": -0.2}, id="bias"),
    ],
)
def test_the_nominal_predictions_ignore_the_mismatch(mismatch):
    nominal = reading_of(STEADY)
    mismatched = reading_of(with_mismatch(**mismatch))
    nominal_power = nominal.power / nominal.power_ratio
    nominal_force = nominal.thrust_force / nominal.force_ratio
    assert not np.allclose(nominal.power_ratio, mismatched.power_ratio, rtol=1e-4)
    assert mismatched.nominal_wear.tolist() == nominal.nominal_wear.tolist()
    predicted_power = mismatched.power / mismatched.power_ratio
    predicted_force = mismatched.thrust_force / mismatched.force_ratio
    assert predicted_power == pytest.approx(nominal_power, rel=1e-6)
    assert predicted_force == pytest.approx(nominal_force, rel=1e-6)


def test_skin_hardens_the_cut_and_wears_the_edge_by_its_share_of_depth():
    nominal = steps(STEADY, 20)
    skinned = steps(with_mismatch(**SKIN), 20)
    share = SKIN["skin_thickness"] / STEADY.workpiece.depth_of_cut
    hardness = 1 + share * (SKIN["skin_hardness"] - 1)
    assert skinned["hardness"] == pytest.approx(hardness, rel=1e-12)

    wear_by_hardness = hardness**STEADY.material.wear.hardness
    wear_by_skin = 1 + share * (SKIN["skin_wear"] - 1)
    relative_wear = skinned["wear"][1:] / nominal["wear"][1:]
    assert relative_wear == pytest.approx(wear_by_hardness * wear_by_skin, rel=1e-9)


def test_a_cut_within_the_skin_has_the_skins_hardness():
    thick = with_mismatch(**SKIN | {"skin_thickness": 3.0})
    assert steps(thick, 1)["hardness"] == pytest.approx(SKIN["skin_hardness"])


def test_a_worn_edge_goes_on_from_its_wear_and_is_charged_its_further_use():
    worn = with_mismatch(**WORN)
    record = steps(worn, 3000, (0.5, 0.0))
    nominal_wear = read(record["observation"], worn).nominal_wear
    assert record["wear"][0] == pytest.approx(INITIAL_WEAR)
    assert record["cutting_time"][0] == 0.0
    assert nominal_wear[0] == 0.0

    remaining_life = 1 - INITIAL_USED_LIFE
    end = first_end(record)
    charged = record["edges_used"][: end + 1].sum()
    assert record["wear"][end] == pytest.approx(0.3, rel=1e-3)
    assert charged == pytest.approx(remaining_life, rel=1e-9)

    fresh = steps(STEADY, 3000, (0.5, 0.0))
    life = first_end(fresh)
    assert end / life == pytest.approx(remaining_life, abs=2 / life)
