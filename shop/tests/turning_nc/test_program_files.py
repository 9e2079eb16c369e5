"""Programs whose contours and sub-programs are in files of their own."""

from pathlib import Path

import pytest

pytest.importorskip("shapely")

from turning_nc.moves import Moves, run
from turning_nc.paths import Path as ToolPath
from turning_nc.program_files import read_program
from turning_nc.words import NcError

from shop.tests.turning_nc.programs import ISO, SIEMENS, moves

MAIN, *_ = SIEMENS.split("%_N_KONTUR_SPF\n")
CONTOUR, L5 = SIEMENS.removeprefix(MAIN).removeprefix("%_N_KONTUR_SPF\n").split("%_N_L5_SPF\n")
CALLING, CALLED = ISO.removesuffix("%\n").split("O0007\n")


def in_files(folder: Path, **texts: str) -> Moves:
    """Return the moves of the program MAIN beside other files, which are given without a dot."""
    for name, text in texts.items():
        path = folder / name.replace("__", ".")
        path.write_text(text, newline="")
    return run(read_program(folder / next(iter(texts)).replace("__", ".")))


def paths(made: Moves) -> list[ToolPath]:
    """Return the paths of moves."""
    return [move.path for move in made.moves]


@pytest.mark.parametrize("name", ["KONTUR__SPF", "kontur__spf", "_N_KONTUR_SPF", "KONTUR__MPF"])
def test_a_contour_beside_the_program_is_read(name: str, tmp_path: Path) -> None:
    made = in_files(
        tmp_path,
        WELLE__MPF=MAIN,
        **{name: CONTOUR},
        L5__SPF=L5,
    )
    assert paths(made) == paths(moves(SIEMENS))
    contour_note, sub_program_note = [note for note in made.notes if "which the program" in note]
    assert "lines 9 to 12 are those of" in contour_note
    assert "L5.SPF" in sub_program_note


@pytest.mark.parametrize("name", ["O0007", "O7__nc", "0007__NC", "o0007__txt"])
@pytest.mark.parametrize("header", ["", "O0007\n", "%\nO0007 (BORE)\n"])
def test_a_sub_program_of_a_fanuc_beside_the_program_is_read(
    name: str, header: str, tmp_path: Path
) -> None:
    made = in_files(tmp_path, O0001__nc=f"{CALLING}%\n", **{name: f"{header}{CALLED}"})
    assert paths(made) == paths(moves(ISO))


def test_files_that_are_not_called_are_not_read(tmp_path: Path) -> None:
    made = in_files(
        tmp_path,
        WELLE__MPF=SIEMENS,
        KONTUR__SPF="damaged (",
        OTHER__SPF="G1 X1",
    )
    assert paths(made) == paths(moves(SIEMENS))
    assert not any("which the program" in note for note in made.notes)


def test_a_missing_contour_names_the_file_to_add(tmp_path: Path) -> None:
    with pytest.raises(NcError, match=r"line 5: .*KONTUR\.SPF"):
        in_files(tmp_path, WELLE__MPF=MAIN, L5__SPF=L5)


def test_programs_that_call_each_other_end(tmp_path: Path) -> None:
    with pytest.raises(NcError, match="call each other"):
        in_files(
            tmp_path,
            HPT__MPF="G71 DIAMON\nG0 X1\nUPB\nM30",
            UPB__SPF="UPA\nRET",
            UPA__SPF="UPB\nRET",
        )
