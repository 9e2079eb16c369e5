"""The accelerator plays what the processor plays, bit for bit; and what it refuses."""

import os
import pickle
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from numba import cuda

from tests.turning_env.accelerator.playing import CASES, accelerator_plays, processor_plays
from tests.turning_env.playing import Record, assert_same_bytes
from turning_env.accelerator import AcceleratedLathes, NoAcceleratorError

REPOSITORY = Path(__file__).parents[3]
GPU = find_spec("numba_cuda") is not None and cuda.is_available()
SIMULATOR = {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}


def in_simulator(code: str) -> bytes:
    """What a new interpreter in which the accelerator is simulated writes."""
    command = [sys.executable, "-W", "error", "-c", code]
    run = subprocess.run(command, cwd=REPOSITORY, env=os.environ | SIMULATOR, capture_output=True, check=False)
    assert run.returncode == 0, run.stderr.decode()
    return run.stdout


@pytest.fixture(scope="module")
def simulated() -> dict[str, Record]:
    """All cases, simulated."""
    code = "import pickle, sys; from tests.turning_env.accelerator.playing import CASES, accelerator_plays as play; "
    return pickle.loads(in_simulator(code + "pickle.dump({name: play(name) for name in CASES}, sys.stdout.buffer)"))


@pytest.mark.parametrize("name", CASES)
def test_the_simulated_accelerator_plays_what_the_processor_plays(name, simulated):
    assert_same_bytes(simulated[name], processor_plays(name))


def test_the_cases_hold_ends_of_all_kinds_and_steps_past_them():
    record = processor_plays("ends")
    ended = (record["time"] == 0.0)[1:]
    assert record["broken"].any()
    assert (record["terminated"] & (record["broken"] == 0.0)).any()
    assert ended.sum() > record["terminated"].sum() > 0


@pytest.mark.skipif(not GPU, reason="there is no GPU")
@pytest.mark.parametrize("name", CASES)
def test_the_gpu_plays_what_the_processor_plays(name):
    assert_same_bytes(accelerator_plays(name), processor_plays(name))


@pytest.mark.skipif(not GPU, reason="there is no GPU")
def test_torch_shares_the_gpu_s_memory():
    import torch

    lathes = AcceleratedLathes(64)
    lathes.reset(3)
    observations = torch.as_tensor(lathes.observations, device="cuda")
    assert observations.data_ptr() == lathes.observations.__cuda_array_interface__["data"][0]
    before = observations.clone()
    lathes.step(torch.zeros(64, 2, device="cuda"))
    torch.cuda.synchronize()
    assert not torch.equal(before, observations)
    assert np.array_equal(observations.cpu().numpy(), lathes.observations.copy_to_host())


@pytest.mark.skipif(GPU, reason="there is a GPU")
def test_without_a_gpu_the_error_says_what_is_missing():
    with pytest.raises(NoAcceleratorError, match=r"numba-cuda is not installed|Numba finds no GPU"):
        AcceleratedLathes(1)


def test_what_is_refused_is_named():
    refused = in_simulator("from tests.turning_env.accelerator.test_lathes import refusals; print(refusals())").decode()
    for message in (
        "count is 0, but must be at least 1",
        "call reset() first",
        "there are 1 seeds, but must be one for each of 2 lanes",
        "seed -1 of lane 0 must be a whole number",
        "seed 18446744073709551616 of lane 1 must be a whole number",
        "actions must be float32 or float64 of shape (2, 2), got int64 of (2, 2)",
        "actions must be float32 or float64 of shape (2, 2), got float64 of (2, 3)",
        "actions must be in the accelerator's memory (__cuda_array_interface__), got list",
        "an action of lane 1 was not finite, and counted as 0",
    ):
        assert message in refused
    assert "the simulator takes interpreted code" in refused


def refusals() -> list[str]:
    """The messages with which wrong calls are refused."""
    lathes = AcceleratedLathes(2)
    messages = []

    def note(call) -> None:
        try:
            call()
        except (ValueError, TypeError, NoAcceleratorError) as error:
            messages.append(str(error))

    note(lambda: AcceleratedLathes(0))
    note(lambda: lathes.step(np.zeros((2, 2))))
    for seed in ([1], -1, 2**64 - 1):
        note(lambda seed=seed: lathes.reset(seed))
    lathes.reset(1)
    for actions in (np.zeros((2, 2), np.int64), np.zeros((2, 3)), [[0.0, 0.0]] * 2, np.array([[0.0, 1.0], [0.0, np.inf]])):
        note(lambda actions=actions: lathes.step(actions))
    note(lathes.check)
    lathes.check()
    os.environ["NUMBA_DISABLE_JIT"] = "0"
    note(lambda: AcceleratedLathes(1))
    return messages
