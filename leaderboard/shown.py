"""Texts of agents' files as cards and pages show them: short, in one line, and never markup.

A file may come from a stranger. Its parameters hold any JSON, up to 100,000 characters, with HTML,
Markdown or control characters.
"""

import re
from collections.abc import Mapping
from typing import Any

from turning_env.console import printable

MAX_VALUE = 200  # characters of a value
MAX_COMMAND = 2_000  # characters of a command
MAX_VALUES = 100  # values of a table
_MARKUP = re.compile(r"[^\w ,.;+=%/-]|(?<!\w)_|_(?!\w)")
"""Characters that may begin markup in Markdown or HTML.

These are all but the characters of words, numbers and lists. An underscore inside a word is safe.
"""


def limited(value: object, max_length: int = MAX_VALUE) -> str:
    """Return a value as one line of at most ``max_length`` characters.

    A note follows a text that is cut and says how long it was.
    """
    text = str(value)
    # Escaping makes a text longer, so it is cut before (to bound the work) and after.
    shown = printable(text[:max_length])[:max_length]
    if len(text) <= max_length:
        return shown
    return f"{shown}... ({len(text):,} characters)"


def few(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the first values of a table that may hold any number."""
    return dict(list(values.items())[:MAX_VALUES])


def markdown_text(value: object) -> str:
    """Return a value as Markdown that shows it unchanged.

    Characters that may be markup become character references.
    """
    if isinstance(value, list) and len(str(value)) <= MAX_VALUE:
        return f"[{', '.join(map(markdown_text, value))}]"
    return _MARKUP.sub(lambda markup: f"&#{ord(markup[0])};", limited(value))


def fenced(lines: list[str]) -> str:
    """Return commands as a block of code, with a fence that none of them can close."""
    shown = [limited(line, MAX_COMMAND) for line in lines]
    longest = 0
    for line in shown:
        for backticks in re.findall("`+", line):
            longest = max(longest, len(backticks))
    fence = "`" * max(3, longest + 1)
    return "\n".join([f"{fence}bash", *shown, fence])
