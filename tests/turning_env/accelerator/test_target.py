"""No product and sum are fused: that would change the last bits."""

import numpy as np
import pytest

from turning_env.accelerator.layout import aligned, fields_in, lane_of, put
from turning_env.accelerator.target import refuse_fused
from turning_env.records import LANES, PARAMETERS, REPORT, REPORT_FIELDS, WIDTH, WORK, narrowed, parameter_records
from turning_env.scenario import Scenario


@pytest.mark.parametrize("operation", ["fma.rn.f64", "mad.rn.f64", "mul.f64", "add.f64", "sub.f64"])
def test_what_is_or_may_be_fused_is_refused(operation):
    refuse_fused("mul.rn.f64 a, b, c;\n\nadd.rn.f64 a, b, c;\nadd.s64 a, b, c;\nmad.lo.s64 a, b, c, d;")
    with pytest.raises(ArithmeticError, match=operation):
        refuse_fused(f"mul.rn.f64 a, b, c;\n\t@%p1 {operation} a, b, c;")


def test_a_lane_in_place_is_the_block_s_own():
    blocks = np.zeros(2, LANES)
    blocks["path"] = np.arange(2 * WIDTH).reshape(2, WIDTH)
    lanes = np.ndarray((2, WIDTH), lane_of(LANES), blocks.data, 0, (LANES.itemsize, 8))
    assert lanes[1, 3]["path"][0] == WIDTH + 3
    lanes[1, 3]["roughness_reference"][0] = 7.0
    assert blocks[1]["roughness_reference"][3] == 7.0
    assert (blocks["roughness_reference"] != 0.0).sum() == 1


def test_notes_of_one_lane_have_room_for_its_two_nodes():
    notes = narrowed(WORK)
    assert notes.names == WORK.names
    assert notes["node_lane"].shape == (2,)
    assert notes["observation"].shape == (WORK["observation"].shape[0], 1)
    with pytest.raises(ValueError, match="field action is"):
        lane_of(WORK)


def test_reports_are_rows_of_numbers():
    assert all(REPORT[name].base == np.float64 for name in REPORT_FIELDS)
    assert [REPORT.fields[name][1] for name in REPORT_FIELDS] == [8 * WIDTH * place for place in range(len(REPORT_FIELDS))]
    assert REPORT.itemsize == 8 * WIDTH * len(REPORT_FIELDS)
    assert callable(fields_in)


def test_aligned_parameters_keep_their_values():
    source = parameter_records(Scenario())[0]
    target = np.zeros(1, aligned(PARAMETERS))
    put(target[0], source)
    assert target.dtype.isalignedstruct
    assert target["wear_law"].dtype.isalignedstruct
    for name in PARAMETERS.names:
        assert np.array_equal(target[name][0].tolist(), source[name].tolist()), name
