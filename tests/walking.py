"""Walk a page of documentation as a reader would, in a copy of the repository.

Its commands and programs are run, the files that it shows written, and its changes made.
"""

import hashlib
import re
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.util import cache_from_source
from pathlib import Path
from typing import NamedTuple

from tests import preloaded

ROOT = Path(__file__).parents[1]
MAX_SECONDS = 110.0
"""Time limit of a process [s]: pytest-timeout ends a test after 120 s."""
INSTALLING_NOTHING = (
    "--old-file=.venv/run",
    "--old-file=.venv/test",
    "PIP=false",
    "UV=false",
)
"""Words that keep ``make`` from installing a copy in the environment that it shares.

The environment counts as set up, however new the copy's requirements are.
"""
LONG = "# minutes to hours"
"""First line of a block whose commands take too long for a test.

``tests/test_command_lines.py`` parses them.
"""


@dataclass(frozen=True)
class Smaller:
    """A change that makes a command small enough for a test."""

    options: str = ""
    """Words added at the end of the command."""
    replaced: Mapping[str, str] = field(default_factory=dict)
    """New words by those that they replace."""


class Block(NamedTuple):
    """A fenced block."""

    language: str
    title: str | None
    """The file that it shows, if any."""
    text: str


def blocks(page: str) -> Iterator[Block]:
    """Yield the fenced blocks of a page in order."""
    fenced = r'^```(\w*)(?: title="([^"]*)")?\n(.*?)^```$'
    for language, title, text in re.findall(fenced, page, re.DOTALL | re.MULTILINE):
        yield Block(language, title or None, text)


def commands(block: Block) -> list[str]:
    """Return the command lines of a block, with lines that end in a backslash joined."""
    lines = block.text.replace("\\\n", " ").splitlines()
    return [line for line in lines if line.strip() and not line.startswith("#")]


def copy_to(folder: Path) -> None:
    """Copy the tracked files with their times, their compiled code, and the environment."""
    command = ["git", "ls-files"]
    tracked = subprocess.run(
        command,
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    for name in tracked.stdout.splitlines():
        if (ROOT / name).exists():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
        if name.endswith(".py"):
            copy_bytecode(ROOT / name, folder / name)
    for code in ROOT.glob("*/**/__pycache__/machine_code-*/*"):
        if code.is_dir():
            copy_machine_code(code, folder / code.relative_to(ROOT).parent)
    copy_environment(folder / ".venv")


def copy_environment(copy: Path) -> None:
    """Link what is in the environment, but its Python: a process of its own takes seconds."""
    (copy / "bin").mkdir(parents=True)
    for path in (ROOT / ".venv").iterdir():
        if path.name != "bin":
            (copy / path.name).symlink_to(path)
    for program in (ROOT / ".venv" / "bin").iterdir():
        if program.name != "python":
            (copy / "bin" / program.name).symlink_to(program)
    preloaded.write_stand_in(copy / "bin" / "python", MAX_SECONDS)


def copy_bytecode(source: Path, copy: Path) -> None:
    """Copy the bytecode of a module, if there is any, which holds the time of its source."""
    bytecode = Path(cache_from_source(str(source)))
    if bytecode.exists():
        copied_bytecode = Path(cache_from_source(str(copy)))
        copied_bytecode.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(bytecode, copied_bytecode)


def copy_machine_code(code: Path, cache: Path) -> None:
    """Copy a folder of machine code into the cache beside a copy of its sources."""
    sources = cache.parents[1]
    if not sources.is_dir():
        return
    # Numba names its folders by the place of the sources.
    digest = hashlib.sha1(str(sources).encode(), usedforsecurity=False).hexdigest()
    shutil.copytree(code, cache / f"{sources.name}_{digest}", dirs_exist_ok=True)


def small(command: str, smaller: Mapping[str, Smaller]) -> list[str]:
    """Return the words of a command, made small, with this Python for ``python``.

    ``smaller`` holds the changes by the first words of commands.
    """
    words = shlex.split(command)
    for start, change in smaller.items():
        if command.startswith(start):
            words += shlex.split(change.options)
            words = [change.replaced.get(word, word) for word in words]
    if words[0] == "python":
        words[0] = sys.executable
    elif words[0] == "make":
        words += INSTALLING_NOTHING
    return words


def run(words: list[str], folder: Path) -> "subprocess.CompletedProcess[str]":
    """Run a command in a folder; ``check`` looks at how it ended."""
    process = preloaded.process_of(words[1:]) if words[0] == sys.executable else None
    if process is not None:
        return preloaded.run(process, words[1:], folder, MAX_SECONDS)
    return subprocess.run(
        words, cwd=folder, capture_output=True, text=True, timeout=MAX_SECONDS, check=False
    )


def walk(
    page: str,
    folder: Path,
    smaller: Mapping[str, Smaller],
    elsewhere: tuple[str, ...] = (),
) -> None:
    """Do in a copy what a page says.

    Commands that start like one in ``elsewhere`` are left out, and those that have been run before.
    A block of text shows what the program above it prints.
    """
    printed = ""
    run_before = set()
    for block in blocks(page):
        if block.title is not None:
            write_or_change(folder / block.title, block)
        elif block.language == "bash" and not block.text.startswith(LONG):
            for command in commands(block):
                if not command.startswith(elsewhere) and command not in run_before:
                    run_before.add(command)
                    check(run(small(command, smaller), folder), command)
        elif block.language == "python":
            program = [sys.executable, *preloaded.PROGRAM, block.text]
            finished = run(program, folder)
            check(finished, block.text)
            printed = finished.stdout
        elif block.language == "text":
            assert block.text == printed


def write_or_change(path: Path, block: Block) -> None:
    """Write the file that a block shows, or make the change that it shows."""
    if block.language == "diff":
        change(path, block.text)
    else:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.text, "utf-8")


def until(holds: Callable[[], bool]) -> None:
    """Wait until a condition holds. Fail after the time limit of a process."""
    limit = time.monotonic() + MAX_SECONDS
    while not holds():
        assert time.monotonic() < limit
        time.sleep(0.02)


def check(finished: "subprocess.CompletedProcess[str]", command: str) -> None:
    """Fail with all that was printed unless a command ended with 0 and without a traceback."""
    printed = f"{command}\n{finished.stdout}\n{finished.stderr}"
    assert finished.returncode == 0, printed
    assert "Traceback" not in finished.stderr, printed


def change(path: Path, difference: str) -> None:
    """Apply a diff without line numbers to a file."""
    lines = difference.splitlines(keepends=True)
    before = "".join(line[1:] for line in lines if line[0] in " -")
    after = "".join(line[1:] for line in lines if line[0] in " +")
    text = path.read_text("utf-8")
    assert text.count(before) == 1, f"{path} has this {text.count(before)} times:\n{before}"
    path.write_text(text.replace(before, after), "utf-8")
