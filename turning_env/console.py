"""Shared parts of all command lines: help with examples, exit statuses, one-line errors, JSON.

Exit statuses: 0 done; 1 the requested check fails; 2 a user's mistake, such as a missing file or an
unknown name; 130 interrupted. Results go to stdout; errors, notices and progress to stderr.
"""

import argparse
import difflib
import functools
import inspect
import io
import os
import re
import shutil
import sys
import textwrap
from collections.abc import Callable
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Any, ParamSpec

import numpy as np
from pydantic_core import to_json

from turning_env.extras import missing

DONE = 0
FAILED = 1
USER_ERROR = 2
INTERRUPTED = 130

MAX_WHOLE = 2**63 - 1
"""Largest whole number of an argument: what 64 bits hold."""

_P = ParamSpec("_P")


class UserError(ValueError):
    """A user's mistake. The message names the fault and the allowed values."""


def printable(text: str) -> str:
    r"""Return a text with every character that does not print escaped, such as ESC as ``\x1b``.

    A terminal obeys control characters, and a line break may forge a line of output. Texts that
    come from a file or from a stranger pass through here before they are shown.
    """
    shown = ""
    for character in text:
        if character.isprintable():
            shown += character
        else:
            shown += character.encode("unicode_escape").decode("ascii")
    return shown


class Parser(argparse.ArgumentParser):
    """A parser that names the option that a misspelt one resembles; subparsers are like it."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse arguments; an unknown option ends the program with this command's usage."""
        options, unknown = super().parse_known_args(args, namespace)
        misspelt = next((word for word in unknown if word.startswith("--")), None)
        if misspelt is not None:
            known = re.findall(r"--[a-z][\w-]*", self.format_help())
            similar = difflib.get_close_matches(misspelt.partition("=")[0], known, n=1)
            meant = f"; did you mean {similar[0]}?" if similar else ""
            self.error(f"there is no option {printable(misspelt)}{meant}")
        return options, unknown


def described(text: str | None) -> dict[str, Any]:
    """Return argparse's keyword arguments for a docstring.

    Its prose is the description, its examples are the epilog. A paragraph that begins with
    ``python -m`` holds examples, one command per line. Others are wrapped to the terminal, except
    those with an indented line or a list item.
    """
    width = shutil.get_terminal_size().columns - 2
    prose = []
    epilog = None
    for paragraph in inspect.cleandoc(text or "").split("\n\n"):
        lines = paragraph.splitlines()
        if paragraph.lstrip().startswith("python -m "):
            title = "example:" if len(lines) == 1 else "examples:"
            epilog = "\n  ".join([title, *(line.strip() for line in lines)])
        elif any(line.startswith((" ", "- ")) for line in lines):
            prose.append(paragraph)
        else:
            prose.append(
                textwrap.fill(paragraph, width, break_long_words=False, break_on_hyphens=False)
            )
    return {
        "description": "\n\n".join(prose).replace("``", ""),
        "epilog": epilog,
        "formatter_class": argparse.RawDescriptionHelpFormatter,
    }


def number_within(low: float, high: float, unit: str) -> Callable[[str], float]:
    """Return an argparse type for a number within a range [unit], ends included.

    The type raises argparse.ArgumentTypeError for a number outside, and for text that is no number.
    """
    allowed = f"{low:g} to {high:g} {unit}".rstrip(" -")

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(
                f"{text!r} is no number: give {allowed}, without a unit; decimals have a point"
            ) from error
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is outside the allowed range {allowed}")
        return value

    return number


def whole_number(text: str) -> int:
    """Return a whole number, as an argparse type: ``1000000``, ``1_000_000`` and ``1e6`` are one.

    Raises:
        argparse.ArgumentTypeError: it is no number, has a fraction, or is beyond 64 bits.
    """
    try:
        number = Decimal(text)
    except InvalidOperation:
        number = Decimal("nan")
    # The range comes first: a huge exponent would fill the memory with digits.
    in_range = number.is_finite() and number.copy_abs() <= MAX_WHOLE
    if not in_range or number % 1 != 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number, such as 1000000 or 1e6")
    return int(number)


def positive(text: str) -> int:
    """Return a whole number above 0, as an argparse type.

    Raise argparse.ArgumentTypeError for others; see ``whole_number``.
    """
    number = whole_number(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return number


def picture_path(text: str) -> Path:
    """Return the path of a picture, as an argparse type.

    Raise argparse.ArgumentTypeError unless its suffix is .png, .svg or .pdf.
    """
    path = Path(text)
    if path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise argparse.ArgumentTypeError(f"{text!r} must end in .png, .svg, .pdf")
    return path


def exits(
    *mistakes: type[Exception], interrupted: str = "interrupted", checks: bool = False
) -> Callable[[Callable[_P, int]], Callable[_P, int]]:
    """Decorate a function that returns an exit status: turn its exceptions into such a status.

    A user's mistake is printed as one line, ``error: ...``.

    Args:
        mistakes: exceptions that are a user's mistakes, beside UserError, OSError and the
            ModuleNotFoundError of an optional package.
        interrupted: what to print if the user interrupts: what is kept, and how to continue.
        checks: whether the status is the result of a check. If the reader of the output leaves
            early, it is then 1, otherwise 0.
    """
    caught: tuple[type[Exception], ...] = (*mistakes, UserError, OSError, ModuleNotFoundError)

    def decorated(command: Callable[_P, int]) -> Callable[_P, int]:
        @functools.wraps(command)
        def run(*args: _P.args, **kwargs: _P.kwargs) -> int:
            _print_any_name()
            try:
                status = command(*args, **kwargs)
                sys.stdout.flush()
                return status
            except BrokenPipeError:
                # Redirect stdout, which Python flushes once more at the end.
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
                return FAILED if checks else DONE
            except KeyboardInterrupt:
                print(interrupted, file=sys.stderr)
                return INTERRUPTED
            except caught as error:
                message = _message(error)
                if message is None:
                    raise
                # Some messages list their items on lines of their own.
                lines = [printable(line) for line in message.split("\n")]
                print("error:", "\n".join(lines), file=sys.stderr)
                return USER_ERROR

        return run

    return decorated


def _print_any_name() -> None:
    """Have stdout escape what it cannot encode, such as a file's name that is not UTF-8.

    stderr does so anyway.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _message(error: Exception) -> str | None:
    """Return the message of a user's mistake; None for a module that is not optional."""
    if isinstance(error, ModuleNotFoundError):
        return missing(error)
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    # The text of a KeyError is the representation of its argument, in quotes.
    if isinstance(error, KeyError) and error.args:
        return str(error.args[0])
    return str(error)


def print_json(value: object) -> None:
    """Print mappings, lists, arrays, data classes, numbers and texts as JSON.

    Numbers that are not finite are written as null.
    """

    def plain(value: Any) -> object:
        return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)

    print(to_json(value, indent=1, inf_nan_mode="null", fallback=plain).decode())
