"""Shared parts of all command lines."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from turning_env.console import described, exits, print_json


def raising(error: BaseException) -> Callable[[], int]:
    def command() -> int:
        raise error

    return command


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (ValueError("--wear is 5"), 2, "error: --wear is 5"),
        (FileNotFoundError(2, "No such file or directory", "a.csv"), 2, "error: a.csv: No such file or directory"),
        (ModuleNotFoundError(name="PIL.Image"), 2, "error: PIL is not installed: pip install 'rough-turning[render]'"),
        (KeyboardInterrupt(), 130, "stopped; run it again"),
    ],
)
def test_exception_becomes_a_line_and_a_status(
    error: BaseException, status: int, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exits(ValueError, KeyError, interrupted="stopped; run it again")(raising(error))() == status
    printed = capsys.readouterr()
    assert (printed.out, printed.err) == ("", f"{message}\n")


@pytest.mark.parametrize("error", [ZeroDivisionError(), ModuleNotFoundError(name="turning_env.nothing")])
def test_other_exceptions_are_raised(error: Exception) -> None:
    with pytest.raises(type(error)):
        exits(ValueError)(raising(error))()


def test_docstring_is_split_into_prose_and_examples() -> None:
    help_text = described("Does ``this``.\n\n    python -m a --b\n    python -m a --c\n\nAnd that.\n")
    assert help_text["description"] == "Does this.\n\nAnd that."
    assert help_text["epilog"] == "examples:\n  python -m a --b\n  python -m a --c"
    assert described("Does this.\n\n    python -m a\n")["epilog"] == "example:\n  python -m a"
    assert described(None)["epilog"] is None


def test_json_holds_arrays_as_lists_of_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"return": np.array([[1.5, np.nan], [2.0, 3.0]]), "count": np.int64(3)})
    assert json.loads(capsys.readouterr().out) == {"return": [[1.5, None], [2.0, 3.0]], "count": 3}


def test_json_holds_data_classes_and_no_infinite_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    @dataclass
    class Pair:
        left: float
        right: tuple[int, ...]

    pair = Pair(math.inf, (1, 2))
    print_json({"pair": pair, "rate": np.float64(0.5), "nan": np.float64("nan"), "met": True, "none": None, 3: Path("three")})
    expected = {"pair": {"left": None, "right": [1, 2]}, "rate": 0.5, "nan": None, "met": True, "none": None, "3": "three"}
    assert json.loads(capsys.readouterr().out) == expected
