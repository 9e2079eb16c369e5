"""Walks a page of documentation as a reader would: its commands, programs, files and changes, in a copy of the repository."""

import hashlib
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
MAX = 110.0
"""A process that takes longer [s] hangs, or is too long for a test: pytest-timeout ends that after 120 s."""
LONG = "# minutes to hours"
"""First line of a block whose commands take too long for a test: ``tests/test_command_lines.py`` parses them."""

Smaller = Mapping[str, tuple[str, Mapping[str, str]]]
"""Changes that make a command small, by its first words: added options, replaced words."""


class Block(NamedTuple):
    """A fenced block."""

    language: str
    title: str | None  # the file that it shows, if any
    text: str


def blocks(page: str) -> Iterator[Block]:
    """Yield the fenced blocks of a page in order."""
    for language, title, text in re.findall(
        r'^```(\w*)(?: title="([^"]*)")?\n(.*?)^```$', page, re.DOTALL | re.MULTILINE
    ):
        yield Block(language, title or None, text)


def commands(block: Block) -> list[str]:
    """The command lines of a block; one that ends in a backslash goes on."""
    return [
        line
        for line in block.text.replace("\\\n", " ").splitlines()
        if line.strip() and not line.startswith("#")
    ]


def copy_to(folder: Path) -> None:
    """Put the tracked files with their times, the machine code made of them, and the installed environment, into a folder."""
    tracked = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.splitlines()
    for name in tracked:
        if (ROOT / name).exists():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    for kept in ROOT.glob(
        "*/**/__pycache__/machine_code-*/*"
    ):  # Numba names its folders by the place of the sources
        code = folder / kept.relative_to(ROOT).parent
        place = hashlib.sha1(str(code.parents[1]).encode(), usedforsecurity=False).hexdigest()
        if kept.is_dir() and code.parents[1].is_dir():
            shutil.copytree(kept, code / f"{code.parents[1].name}_{place}", dirs_exist_ok=True)
    (folder / ".venv").symlink_to(ROOT / ".venv")


def small(command: str, smaller: Smaller) -> list[str]:
    """The words of a command, made small, with this Python for ``python``."""
    for start, (options, replaced) in smaller.items():
        if command.startswith(start):
            command = shlex.join(
                replaced.get(word, word) for word in shlex.split(f"{command} {options}")
            )
    words = shlex.split(command)
    return [sys.executable, *words[1:]] if words[0] == "python" else words


def run(words: list[str], folder: Path) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        words, cwd=folder, capture_output=True, text=True, timeout=MAX, check=False
    )


def walk(page: str, folder: Path, smaller: Smaller, done: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Do in a copy what a page says: run commands and programs, write the files that it shows, make the changes that it shows.

    Commands that begin like one that is ``done`` already are not run again. Those that were run are returned.
    """
    ran = []
    for block in blocks(page):
        if block.title is not None and block.language == "diff":
            change(folder / block.title, block.text)
        elif block.title is not None:
            (folder / block.title).parent.mkdir(parents=True, exist_ok=True)
            (folder / block.title).write_text(block.text, "utf-8")
        elif block.language == "bash" and not block.text.startswith(LONG):
            for command in commands(block):
                if not command.startswith(done):
                    check(run(small(command, smaller), folder), command)
                    ran.append(command)
        elif block.language == "python":
            check(run([sys.executable, "-W", "error", "-c", block.text], folder), block.text)
    return tuple(ran)


def until(holds: Callable[[], bool]) -> None:
    limit = time.monotonic() + MAX
    while not holds():
        assert time.monotonic() < limit
        time.sleep(0.02)


def check(finished: "subprocess.CompletedProcess[str]", what: str) -> None:
    """Fail with all that was printed unless it ended well, and without a traceback."""
    told = f"{what}\n{finished.stdout}\n{finished.stderr}"
    assert finished.returncode == 0, told
    assert "Traceback" not in finished.stderr, told


def change(path: Path, difference: str) -> None:
    """Make the change of a diff without line numbers in a file."""
    lines = difference.splitlines(keepends=True)
    before = "".join(line[1:] for line in lines if line[0] in " -")
    after = "".join(line[1:] for line in lines if line[0] in " +")
    text = path.read_text("utf-8")
    assert text.count(before) == 1, f"{path} has this {text.count(before)} times:\n{before}"
    path.write_text(text.replace(before, after), "utf-8")
