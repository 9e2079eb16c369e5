"""No product and sum are fused: that would change the last bits."""

from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest
from numba import types
from numba.np import numpy_support

from turning_env.accelerator.layout import aligned, fields_in, lane_of, put
from turning_env.accelerator.target import refuse_fused
from turning_env.records import LANES, PARAMETERS, REPORT, REPORT_FIELDS, WIDTH, WORK, narrowed, parameter_records
from turning_env.scenario import Scenario


@pytest.mark.parametrize("operation", ["fma.rn.f64", "mul.f64", "add.f64", "sub.f64"])
def test_what_is_or_may_be_fused_is_refused(operation):
    refuse_fused("mul.rn.f64 a, b, c;\n\nadd.rn.f64 a, b, c;\nadd.s64 a, b, c;")
    with pytest.raises(ArithmeticError, match=operation):
        refuse_fused(f"mul.rn.f64 a, b, c;\n\t{operation} a, b, c;")


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


@pytest.mark.skipif(find_spec("numba_cuda") is None, reason="numba-cuda is not installed")
@pytest.mark.parametrize("capability", [(8, 0), (9, 0)])
def test_the_kernel_compiles_for_a_gpu_without_one(capability, monkeypatch):
    """To PTX, with NVIDIA's compiler library (of the package nvidia-cuda-nvcc-cu12, say)."""
    from numba import cuda
    from numba.cuda import dispatcher

    from turning_env.accelerator import kernels
    from turning_env.accelerator.target import unfused

    monkeypatch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=capability))
    with unfused():
        code, _ = cuda.compile_ptx(kernels._step, step_signature(kernels), cc=capability)
    refuse_fused(code)
    assert code.count("mul.rn.f64") > 1000
    assert "ld.global.f64" in code  # numbers are read whole


def step_signature(kernels):
    """Of ``kernels._step``, with actions of float32."""

    def array(kind, dimensions, layout="C"):
        return types.Array(numpy_support.from_dtype(np.dtype(kind)), dimensions, layout)

    return types.void(
        array(kernels.LANE, 2, "A"),
        array(kernels.ALIGNED_PARAMETERS, 1),
        array(kernels.LANE_REPORT, 2, "A"),
        array(np.float32, 2),
        array(np.float32, 2),
        array(np.float64, 1),
        array(np.bool_, 2),
        array(np.int64, 1),
    )
