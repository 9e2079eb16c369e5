"""What all command lines have in common."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from turning_env.console import described, exits, print_json


def raising(error: BaseException) -> Callable[[], int]:
    def command() -> int:
        raise error

    return command


@pytest.mark.parametrize(
    ("error", "status", "told"),
    [
        (ValueError("--wear is 5"), 2, "error: --wear is 5"),
        (KeyError("no rule 'x'"), 2, "error: no rule 'x'"),
        (FileNotFoundError(2, "No such file or directory", "a.csv"), 2, "error: a.csv: No such file or directory"),
        (OSError("the disk is gone"), 2, "error: the disk is gone"),
        (KeyboardInterrupt(), 130, "stopped; run it again"),
    ],
)
def test_what_a_command_raises_is_a_line_and_a_status(
    error: BaseException, status: int, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exits(ValueError, KeyError, interrupted="stopped; run it again")(raising(error))() == status
    printed = capsys.readouterr()
    assert (printed.out, printed.err) == ("", f"{told}\n")


def test_what_is_no_mistake_of_the_user_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        exits(ValueError)(raising(ZeroDivisionError()))()


@pytest.mark.parametrize("status", [0, 1])
def test_the_status_of_what_ends_is_kept(status: int) -> None:
    assert exits()(lambda: status)() == status


@pytest.mark.parametrize("indent", ["", "    "])
def test_a_docstring_tells_prose_from_examples(indent: str) -> None:
    told = described(f"Does ``this``.\n\n{indent}python -m a --b\n{indent}python -m a --c\n\nAnd that.\n")
    assert told["description"] == "Does this.\n\nAnd that."
    assert told["epilog"] == "examples:\n  python -m a --b\n  python -m a --c"
    assert described("Does this.\n\n    python -m a\n")["epilog"] == "example:\n  python -m a"
    assert described(None)["epilog"] is None


def test_json_holds_data_classes_and_no_infinite_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    @dataclass
    class Pair:
        left: float
        right: tuple[int, ...]

    print_json({"pair": Pair(math.inf, (1, 2)), "rate": np.float64(0.5), "met": True, "none": None, 3: "three"})
    told = {"pair": {"left": None, "right": [1, 2]}, "rate": 0.5, "met": True, "none": None, "3": "three"}
    assert json.loads(capsys.readouterr().out) == told
