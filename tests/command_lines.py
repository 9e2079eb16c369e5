"""Run command lines in this process, and check their help and their errors."""

import argparse
import importlib
import re
import shlex
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

from tests.walking import blocks, commands


class ParsedError(Exception):
    """Raised instead of running a command once it has parsed its arguments."""


def command_modules(folder: Path, packages: Iterable[str]) -> list[str]:
    """Return the modules and packages that ``python -m`` runs."""
    modules = []
    for package in packages:
        for path in sorted((folder / package).rglob("*.py")):
            if re.search(r"^if __name__ ==", path.read_text("utf-8"), re.MULTILINE):
                module = ".".join(path.relative_to(folder).with_suffix("").parts)
                modules.append(module.removesuffix(".__main__"))
    return modules


def status_of(words: list[str]) -> int:
    """Return the exit status of a command, whether its parser or the command itself ends it."""
    program = importlib.import_module(words[0])
    is_package = hasattr(program, "__path__")
    if is_package:
        program = importlib.import_module(f"{words[0]}.__main__")
    main: Callable[[list[str]], int] = program.main
    try:
        return main(words[1:])
    except SystemExit as ended:
        return int(ended.code or 0)


def parse(words: list[str]) -> None:
    """Have a command parse its words, without running it. Fail if it does not understand them."""
    original = argparse.ArgumentParser.parse_args

    def parse_args(*arguments: Any) -> Any:
        original(*arguments)
        raise ParsedError

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(argparse.ArgumentParser, "parse_args", parse_args)
        with pytest.raises(ParsedError):
            status_of(words)


def check_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Check that a command has help, and that the examples in it parse."""
    assert status_of([*command.split(), "--help"]) == 0
    printed = capsys.readouterr().out
    for line in printed.replace("\\\n", " ").splitlines():
        if line.startswith("  python -m "):
            _, _, *words = shlex.split(line)
            parse(words)


def check_mistake(command: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Check that a command with a mistake ends with status 2 and an error that has some words."""
    assert status_of(shlex.split(command)) == 2
    printed = capsys.readouterr()
    assert re.search(r"error: \S", printed.err.splitlines()[-1])
    assert said in printed.err
    assert printed.out == ""


def documented(pages: Iterable[Path], packages: Iterable[str]) -> list[list[str]]:
    """Return the words after ``python -m`` of the packages' commands that pages print."""
    documented_commands = []
    for page in pages:
        for block in blocks(page.read_text("utf-8")):
            if block.language != "bash":
                continue
            for line in commands(block):
                words = shlex.split(line)
                package = words[2].partition(".")[0] if len(words) > 2 else ""
                if words[:2] == ["python", "-m"] and package in packages:
                    documented_commands.append(words[2:])
    return documented_commands
