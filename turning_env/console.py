"""What all command lines of the project have in common: help with examples, exit statuses, errors in one line, JSON.

Exit statuses: 0 done; 1 the check that was asked for fails; 2 a user's mistake, as a missing file or an unknown name; 130
interrupted. Results go to stdout; errors, notices and progress to stderr.
"""

import argparse
import functools
import json
import math
import os
import sys
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import asdict, is_dataclass
from typing import Any, ParamSpec

DONE, FAILED, MISTAKE, INTERRUPTED = 0, 1, 2, 130

_P = ParamSpec("_P")


def described(text: str | None) -> dict[str, Any]:
    """What argparse needs for a help that a docstring says: its prose, then its examples.

    Args:
        text: paragraphs; one that begins with ``python -m`` holds examples, a command per line. None gives neither.
    """
    paragraphs = textwrap.dedent(text or "").strip().split("\n\n")
    prose = [paragraph.replace("``", "") for paragraph in paragraphs if not _is_command(paragraph)]
    examples = [line.strip() for paragraph in paragraphs if _is_command(paragraph) for line in paragraph.splitlines()]
    title = "example:" if len(examples) == 1 else "examples:"
    return {
        "description": "\n\n".join(prose),
        "epilog": "\n".join([title, *(f"  {line}" for line in examples)]) if examples else None,
        "formatter_class": _Help,
    }


def _is_command(paragraph: str) -> bool:
    return paragraph.lstrip().startswith("python -m ")


class _Help(argparse.HelpFormatter):
    """Wraps paragraphs to the terminal, one by one, and leaves those alone in which a line is indented or an item."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        paragraphs = [
            paragraph
            if any(line.startswith((" ", "- ")) for line in paragraph.splitlines())
            else textwrap.fill(paragraph, width, break_long_words=False, break_on_hyphens=False)
            for paragraph in text.split("\n\n")
        ]
        return textwrap.indent("\n\n".join(paragraphs), indent)


def exits(
    *mistakes: type[Exception], interrupted: str = "interrupted", checks: bool = False
) -> Callable[[Callable[_P, int]], Callable[_P, int]]:
    """A decorator of a function that is a command and returns its exit status: what it raises becomes a line and a status.

    Args:
        mistakes: exceptions that a user's mistake raises, printed as ``error: ...``; an OSError always is one.
        interrupted: what to say if the user interrupts it: what is kept, and how to go on.
        checks: whether the status tells if something holds. Then it is not 0 if the reader of the output leaves early.
    """

    caught: tuple[type[Exception], ...] = (*mistakes, OSError)

    def decorated(command: Callable[_P, int]) -> Callable[_P, int]:
        @functools.wraps(command)
        def run(*args: _P.args, **kwargs: _P.kwargs) -> int:
            try:
                status = command(*args, **kwargs)
                sys.stdout.flush()
            except BrokenPipeError:  # whoever reads the output has seen enough; at its end, Python would flush once more
                os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
                return FAILED if checks else DONE
            except KeyboardInterrupt:
                print(interrupted, file=sys.stderr)
                return INTERRUPTED
            except caught as error:
                print(f"error: {_message(error)}", file=sys.stderr)
                return MISTAKE
            return status

        return run

    return decorated


def _message(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    return str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)


def print_json(value: object) -> None:
    """Print mappings, lists, data classes, numbers and texts as JSON; what is not a finite number becomes null."""
    print(json.dumps(_plain(value), indent=1, allow_nan=False))


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, Mapping):
        return {str(name): _plain(of_name) for name, of_name in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value if value is None or isinstance(value, (bool, int)) else str(value)
