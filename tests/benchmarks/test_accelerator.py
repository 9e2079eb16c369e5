"""The accelerator's benchmark measures the same loops on the processor, and says where there is no GPU."""

import pytest
import torch

from benchmarks import accelerator


def test_it_measures_on_the_processor(capsys):
    assert accelerator.main(["--device", "cpu", "--most", "1024", "--repeats", "1", "--seconds", "0.001"]) == 0
    header, row = capsys.readouterr().out.splitlines()
    assert header.split()[0] == "lanes"
    assert row.split()[0] == "1024"
    assert row.count("to") == 2


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_without_a_gpu_it_says_so(capsys):
    assert accelerator.main([]) == 2
    assert capsys.readouterr().err.startswith("error: ")


@pytest.mark.parametrize("arguments", [["--most", "1023"], ["--most-learning", "1"], ["--repeats", "0"], ["--seconds", "0"]])
def test_bad_arguments_are_refused(arguments, capsys):
    with pytest.raises(SystemExit, match="2"):
        accelerator.main(arguments)
    assert "usage" in capsys.readouterr().err
