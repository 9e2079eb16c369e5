"""Shared parts of all command lines."""

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from turning_env.console import exits, positive, print_json, printable, whole_number


def raising(error: BaseException) -> Callable[[], int]:
    def command() -> int:
        raise error

    return command


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        pytest.param(
            ValueError("--wear is 5"),
            2,
            "error: --wear is 5",
            id="value",
        ),
        pytest.param(
            FileNotFoundError(2, "No such file or directory", "a.csv"),
            2,
            "error: a.csv: No such file or directory",
            id="file",
        ),
        pytest.param(
            ModuleNotFoundError(name="PIL.Image"),
            2,
            "error: PIL is not installed: pip install 'rough-turning[render]'",
            id="package",
        ),
        pytest.param(
            KeyboardInterrupt(),
            130,
            "stopped; run it again",
            id="interruption",
        ),
    ],
)
def test_exception_becomes_a_line_and_a_status(
    error: BaseException, status: int, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command = exits(ValueError, KeyError, interrupted="stopped; run it again")(raising(error))
    assert command() == status
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == f"{message}\n"


def test_text_of_a_file_cannot_command_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    assert printable("\x1b[2J\r\n\x9b7m\u202e \u00e9") == r"\x1b[2J\r\n\x9b7m\u202e " + "\u00e9"
    exits(ValueError)(raising(ValueError("bad key \x1b]0;title\x07\n  second line")))()
    assert capsys.readouterr().err == "error: bad key \\x1b]0;title\\x07\n  second line\n"


def test_json_holds_data_classes_and_arrays_and_no_infinite_numbers(
    capsys: pytest.CaptureFixture[str],
) -> None:
    @dataclass
    class Pair:
        left: float
        right: tuple[int, ...]

    values = {
        "pair": Pair(math.inf, (1, 2)),
        "table": np.array([[1.5, np.nan], [2.0, 3.0]]),
        "count": np.int64(3),
        "met": True,
        "none": None,
        3: Path("three"),
    }
    print_json(values)
    assert json.loads(capsys.readouterr().out) == {
        "pair": {"left": None, "right": [1, 2]},
        "table": [[1.5, None], [2.0, 3.0]],
        "count": 3,
        "met": True,
        "none": None,
        "3": "three",
    }


@pytest.mark.parametrize("text", ["1000000", "1_000_000", "1e6", "1E+6", "1000000.0"])
def test_a_whole_number_may_be_written_in_any_way(text: str) -> None:
    assert whole_number(text) == 1_000_000
    assert positive(text) == 1_000_000


@pytest.mark.parametrize("text", ["1.5", "1e-3", "nan", "inf", "1e99999999", "2**3", "1 000", ""])
def test_what_is_no_whole_number_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="is not a whole number"):
        whole_number(text)


def test_a_count_is_above_0() -> None:
    assert whole_number("-3") == -3
    with pytest.raises(argparse.ArgumentTypeError, match="'0' is not a whole number above 0"):
        positive("0")
