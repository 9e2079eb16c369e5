"""The kernels as compiled for a GPU, played on the processor where there is none."""

import shutil
from importlib.util import find_spec

import pytest

from tests.turning_env.accelerator import playing
from tests.turning_env.accelerator.playing import CASES, accelerator_plays, processor_plays
from tests.turning_env.accelerator.ptx import MEMORY, compiled_to_ptx, played_on_processor, translated
from tests.turning_env.playing import SHORT_LIVED, assert_same_bytes
from turning_env import presets

MORE = {preset: (preset, 40, 12 if preset.startswith("batch") else 300) for preset in presets()}
ALL = CASES | {f"long_{name}": case for name, case in MORE.items()} | {"many_ends": (SHORT_LIVED, 70, 200)}

needs_compiler = pytest.mark.skipif(find_spec("numba_cuda") is None, reason="numba-cuda is not installed")


@pytest.fixture(scope="module")
def kernels(tmp_path_factory):
    """The kernels in place of those that a GPU runs."""
    from turning_env.accelerator import kernels, lathes

    with pytest.MonkeyPatch.context() as patch:
        codes = compiled_to_ptx(kernels, patch)
        for name, kernel in played_on_processor(codes, tmp_path_factory.mktemp("ptx")).items():
            patch.setattr(kernels, name, kernel)
        patch.setattr(lathes, "cuda", MEMORY)
        patch.setattr(lathes, "need_accelerator", lambda: None)
        patch.setattr(playing, "on_device", MEMORY.to_device)
        yield kernels


@needs_compiler
def test_the_kernels_compile_for_older_gpus_likewise(monkeypatch):
    from turning_env.accelerator import kernels

    code = compiled_to_ptx(kernels, monkeypatch, (8, 0))["step"]
    assert code.count("mul.rn.f64") > 1000
    assert "ld.global.f64" in code  # numbers are read whole


@needs_compiler
@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@pytest.mark.parametrize("name", ALL)
def test_the_compiled_kernels_play_what_the_processor_plays(name, kernels, monkeypatch):
    monkeypatch.setitem(CASES, name, ALL[name])
    assert_same_bytes(accelerator_plays(name), processor_plays(name))


def test_an_instruction_that_is_unknown_is_an_error():
    kernel = ".param .u64 k_param_0\n)\n{\n.reg .f64 %fd<4>;\n{};\nret;\n}}\n"
    assert "fd1 = fd2 + fd3" in translated(kernel.replace("{}", "add.rn.f64 %fd1, %fd2, %fd3").replace("}}", "}"), "k")
    with pytest.raises(ValueError, match=r"the instruction fma\.rn\.f64 has no translation"):
        translated(kernel.replace("{}", "fma.rn.f64 %fd1, %fd2, %fd3, %fd1").replace("}}", "}"), "k")
