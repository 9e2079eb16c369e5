"""Tables of tools are read, written and read again."""

import math
from pathlib import Path

import pytest
from turning_shop import WorkshopError
from turning_shop.__main__ import main
from turning_shop.tool_library import LibraryTool, csv_of, read_tools

PM = LibraryTool(
    designation="CNMG120408-PM",
    grade="P25",
    material="42CrMo4",
    nose_radius=0.8,
    edge_length=12.9,
    cutting_speed=168.0,
    feed=0.4,
    depth_of_cut=2.0,
    diameter=80.0,
)


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, "utf-8")
    return path


def test_a_table_tells_tools_by_names_or_symbols_and_designations_fill_in(tmp_path: Path) -> None:
    text = "Insert;Grade;vc [m/min];f;RE\nCNMG120408-PM;P25;168;0,4;\nOwn-1;;;;1,2\n"
    standard, own = read_tools(written(tmp_path, "tools.csv", text))
    assert standard.cutting_speed == 168.0
    assert standard.feed == 0.4
    assert standard.nose_radius == 0.8
    assert standard.edge_length == pytest.approx(12.9, abs=0.01)
    assert own.designation == "Own-1"
    assert own.nose_radius == 1.2
    assert math.isnan(own.edge_length)


@pytest.mark.parametrize(
    ("suffix", "text", "complaint"),
    [
        pytest.param("csv", "", "is empty", id="empty table"),
        pytest.param(
            "csv",
            "vc,f\n1,2\n",
            "no column designation",
            id="table without designations",
        ),
        pytest.param(
            "csv",
            "insert,f\nCNMG120408,fast\n",
            "line 2, feed",
            id="table with a word for a number",
        ),
        pytest.param(
            "csv",
            "insert,RE\nCNMG120408,0.4\n",
            "designation says 0.8",
            id="table with another nose radius",
        ),
        pytest.param(
            "csv",
            "insert,vc [SFM]\nCNMG120408,600\n",
            "unit must be m/min",
            id="table with another unit",
        ),
        pytest.param("xml", "<a/>", "read from .csv", id="another format"),
    ],
)
def test_a_file_that_is_no_library_is_refused(
    tmp_path: Path, suffix: str, text: str, complaint: str
) -> None:
    with pytest.raises(WorkshopError, match=complaint):
        read_tools(written(tmp_path, f"tools.{suffix}", text))


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    other = LibraryTool(**{**PM.__dict__, "material": "1.4301", "cutting_speed": 140.0})
    assert read_tools(written(tmp_path, "t.csv", csv_of([PM, other]))) == [PM, other]


def test_the_command_joins_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own = LibraryTool(designation="Own-1", nose_radius=1.2)
    first = written(tmp_path, "first.csv", csv_of([PM]))
    second = written(tmp_path, "second.csv", csv_of([own]))
    joined = tmp_path / "library.csv"
    assert main(["tools", str(first), str(second), "--out", str(joined)]) == 0
    printed = capsys.readouterr()
    assert "Own-1" in printed.out
    assert "Own-1 is no designation of ISO 1832" in printed.err
    assert f"{PM.designation} is no" not in printed.err
    assert read_tools(joined)[0] == PM
    assert read_tools(joined)[1].nose_radius == 1.2
    assert main(["tools", str(first), "--out", str(joined)]) == 2
    assert main(["tools", str(first), "--out", str(tmp_path / "bits")]) == 2
