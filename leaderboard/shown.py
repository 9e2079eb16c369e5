"""Texts of agents' files as cards and pages show them: short, in one line, and never markup.

A file may come from a stranger. Its parameters hold any JSON, up to a megabyte, with HTML, Markdown or control characters.
"""

import re
from collections.abc import Mapping
from typing import Any

from turning_env.console import printable

MAX_VALUE = 200  # characters of a value
MAX_COMMAND = 2_000  # characters of a command
MAX_VALUES = 100  # values of a table
_MARKUP = re.compile(r"[^\w ,.;+=%/-]|(?<!\w)_|_(?!\w)")
"""Characters that may begin markup in Markdown or HTML: all but those of words, numbers and lists."""


def limited(value: object, most: int = MAX_VALUE) -> str:
    """Return a value as one line of at most ``most`` characters and a note of how many there were."""
    text = str(value)
    shown = printable(text[:most])[:most]
    return shown if len(text) <= most else f"{shown}... ({len(text):,} characters)"


def few(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the first values of a table that may hold any number."""
    return dict(list(values.items())[:MAX_VALUES])


def markdown_text(value: object) -> str:
    """Return a value as Markdown that shows it as it is: what may be markup is written as a character reference."""
    if isinstance(value, list) and len(str(value)) <= MAX_VALUE:
        return f"[{', '.join(map(markdown_text, value))}]"
    return _MARKUP.sub(lambda found: f"&#{ord(found[0])};", limited(value))


def fenced(lines: list[str]) -> str:
    """Return commands as a block of code, with a fence that none of them can close."""
    shown = [limited(line, MAX_COMMAND) for line in lines]
    longest = max((len(run) for line in shown for run in re.findall("`+", line)), default=0)
    fence = "`" * max(3, longest + 1)
    return "\n".join([f"{fence}bash", *shown, fence])
