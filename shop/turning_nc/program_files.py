"""Read a program together with the sub-programs and contours that it keeps in other files.

Controls look for them in the program's folder. Their text is put behind the program's, so that all
lines have one numbering; a note names the lines of each file.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from turning_nc.dialects import NOT_READ, Dialect, with_line_feeds
from turning_nc.words import (
    Line,
    NcError,
    PartProgram,
    Word,
    divide,
    naming,
    read_program_file,
)

MAX_FILES = 20  # that a program reads
MAX_ENTRIES = 10_000  # of a folder that are looked at

SUFFIXES = {"", ".spf", ".mpf", ".sub", ".nc", ".cnc", ".tap", ".txt", ".prg", ".eia"}
"""Ends of the names of files in which programs are kept, in small letters."""
_NUMBER = re.compile(r"O?0*(\d+)")
_ARCHIVED = re.compile(r"_N_(\w+)_(?:SPF|MPF)")


def read_program(path: Path, dialect: Dialect | None = None) -> PartProgram:
    """Return the program in a file, with the parts that it calls from files beside it.

    Raises:
        NcError: a file is not understood, or the program calls more than ``MAX_FILES``.
        OSError: a file cannot be read.
    """
    program = read_program_file(path, dialect)
    notes: list[str] = []
    while True:
        found = _first_missing(program, path)
        if found is None:
            return replace(program, notes=(*notes, *program.notes))
        name, file = found
        if len(notes) >= MAX_FILES:
            raise NcError(f"{path}: calls parts of more than {MAX_FILES} files")
        program, note = _with_file(program, name, file=file, path=path)
        notes.append(note)


def _with_file(program: PartProgram, name: str, file: Path, path: Path) -> tuple[PartProgram, str]:
    """Return a program with a part from another file behind it, and a note."""
    other = read_program_file(file, program.dialect)
    text = program.text
    if not text.endswith(("\n", "\r")):
        text += "\n"
    if name not in other.parts:
        text += f"O{name}\n" if program.dialect.system else f"%_N_{name}_SPF\n"
    lines_before = with_line_feeds(text).count("\n")
    other_text = with_line_feeds(other.text.rstrip())
    first = lines_before + 1
    last = first + other_text.count("\n")
    note = f"lines {first} to {last} are those of {file.name}, which the program calls"
    with naming(path):
        whole = divide(text + other.text, program.dialect)
    return whole, note


def _first_missing(program: PartProgram, path: Path) -> tuple[str, Path] | None:
    """Return the first part that is called but is not in the program, and its file beside it."""
    missing = [name for name in _called(program) if name not in program.parts]
    if not missing:
        return None
    files = _files_beside(path, program.dialect)
    for name in missing:
        if name in files:
            return name, files[name]
    return None


def _files_beside(path: Path, dialect: Dialect) -> dict[str, Path]:
    """Return the programs in the folder of another, by their names on the control.

    A Fanuc calls a program by its number: 12 for O0012.nc. On a SINUMERIK, an archived file such
    as _N_GROOVE_SPF.MPF holds the sub-program GROOVE. Other files have the program's name.
    """
    call_name = _NUMBER if dialect.system else _ARCHIVED
    # A folder may be huge, such as a whole archive of programs.
    entries = sorted(path.parent.iterdir())[:MAX_ENTRIES]
    files: dict[str, Path] = {}
    for file in entries:
        is_program = file.suffix.lower() in SUFFIXES and file.is_file()
        if not is_program or file.name == path.name:
            continue
        name = file.stem.upper()
        match = call_name.fullmatch(name)
        if match:
            name = match[1]
        # The first by name, as two files may hold programs of one name.
        files.setdefault(name, file)
    return files


def _called(program: PartProgram) -> Iterator[str]:
    """Yield the names of the parts that a program calls."""
    for lines in program.parts.values():
        for line in lines:
            if program.dialect.system:
                yield from _called_by_number(line)
            else:
                for word in line.words:
                    yield from _called_by_name(word, program.dialect)


def _called_by_number(line: Line) -> Iterator[str]:
    """Yield the sub-program that M98 of a Fanuc calls."""
    word = line.first("P") if line.has("M", 98) else None
    digits = word.text.split(".")[0] if word else ""
    if digits.isdigit():
        yield str(int(digits[-4:]))


def _called_by_name(word: Word, dialect: Dialect) -> Iterator[str]:
    """Yield the sub-program or the contour that a word of a SINUMERIK calls."""
    if word.address == "L" and word.text:
        yield f"L{word.text}"
    elif word.address == "CYCLE95" and word.arguments:
        yield word.arguments[0].text.strip('" ')
    elif word.is_call and not (word.address in dialect.names or word.address in NOT_READ):
        yield word.address
