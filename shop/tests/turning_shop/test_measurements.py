"""Measurements are read, and every mistake in them is named.

``tests/soundness/test_readers.py`` reads damaged files.
"""

import os
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from turning_shop import WorkshopError
from turning_shop.headers import read_heading
from turning_shop.measurements import read_measurements

HEADER = "cutting_speed,feed,depth_of_cut,wear,power\n"
GOOD = HEADER + "100,0.3,2.5,0.2,4.5\n"


def reading(folder: Path, content: str | bytes) -> Path:
    path = folder / "cuts.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize(
    ("content", "message"),
    [
        pytest.param("", "is empty: a header and rows", id="empty"),
        pytest.param(HEADER, "has a header but no rows", id="header alone"),
        pytest.param(
            "feed,power\n1,2\n",
            "no column cutting_speed, depth_of_cut; "
            "it has 'feed', 'power', and the columns understood are",
            id="missing columns",
        ),
        pytest.param(
            "a;b;c\n1;2;3\n",
            "no column cutting_speed, feed, depth_of_cut; it has 'a;b;c'",
            id="no known column",
        ),
        pytest.param(
            GOOD.replace("feed", "f [mm/min]"),
            "f .mm/min.*: feed in 'mm/min' is not understood: allowed are mm/rev.*"
            "a feed in mm/min is first divided by the spindle speed",
            id="unit",
        ),
        pytest.param(
            GOOD.replace("cutting_speed", "vc [rpm]"),
            r"cutting_speed in 'rpm' is not understood.*pi d n / 1000 m/min",
            id="spindle speed",
        ),
        pytest.param(
            GOOD.replace("wear", "ap"),
            "more than one column depth_of_cut: 'depth_of_cut' and 'ap'",
            id="two columns of one quantity",
        ),
        pytest.param(
            GOOD.replace(",", ";") + "100;0,3;2.5;0,2;4,5\n",
            "line 2, column feed: '0.3' has a point, but other cells have decimal commas",
            id="points and commas",
        ),
        pytest.param(
            GOOD.replace("power", "P [W]") + "100,0.3,2.5,0.2,2e7\n",
            r"P .W.: 2e7, which is 2e\+04 kW, is outside",
            id="out of range in a unit",
        ),
        pytest.param(
            GOOD + "fast,0.3,2.5,0.2,4.5\n",
            "line 3, column cutting_speed: 'fast' is not a number; allowed is 0.1 to 5000 m/min",
            id="word",
        ),
        pytest.param(
            GOOD + '100,"0,3",2.5,0.2,4.5\n',
            "line 3, column feed: '0,3' has a comma: write decimals with a point",
            id="comma",
        ),
        pytest.param(
            GOOD + "100,-0.3,2.5,0.2,4.5\n",
            "line 3, column feed: -0.3 is outside the allowed range 0.001 to 10 mm/rev",
            id="negative",
        ),
        pytest.param(
            GOOD + "100,0.3,2.5,inf,4.5\n",
            "line 3, column wear: 'inf' is not a number",
            id="infinite",
        ),
        pytest.param(
            GOOD + "\n\n100,0.3,2.5,0.2\n",
            "line 5 has 4 cells, but the header has 5",
            id="missing cell",
        ),
        pytest.param(
            "cutting_speed,feed,depth_of_cut,hardness\n100,0.3,2.5,260\n",
            "hardness: 260 is outside .*: 1 is nominal",
            id="hardness in HB",
        ),
        pytest.param(
            b"\xff\0" + GOOD.encode(),
            "is not text: save the sheet as CSV, in UTF-8",
            id="bytes",
        ),
        pytest.param(HEADER + '"100', "is not CSV", id="open quote"),
    ],
)
def test_mistake_is_named(tmp_path: Path, content: str | bytes, message: str) -> None:
    with pytest.raises(WorkshopError, match=message) as error:
        read_measurements(reading(tmp_path, content))
    assert "cuts.csv" in str(error.value)


def test_many_mistakes_are_counted(tmp_path: Path) -> None:
    with pytest.raises(WorkshopError, match=r"line 2, .*; line 6, .*; and 15 more like these$"):
        read_measurements(reading(tmp_path, HEADER + "x,0.3,2.5,0.2,1\n" * 20))


def test_spreadsheets_are_read(tmp_path: Path) -> None:
    header = '\ufeff cutting_speed , feed,depth_of_cut,"note, of mine",wear\r\n'
    content = header + '100,0.3,"2.5","a ""b""\nc", \r\n,,,,\r\n1.2e2,+.4,3.,,0.2'
    measurements = read_measurements(reading(tmp_path, content))
    assert measurements.ignored == ("note, of mine",)
    assert measurements.columns["cutting_speed"].tolist() == [100, 120]
    assert measurements.columns["feed"].tolist() == [0.3, 0.4]
    assert np.isnan(measurements.columns["wear"]).tolist() == [True, False]
    assert measurements.lines.tolist() == [3, 5]


def test_old_line_ends_are_read(tmp_path: Path) -> None:
    measurements = read_measurements(reading(tmp_path, GOOD.replace("\n", "\r")))
    assert measurements.lines.tolist() == [2]


GERMAN = (
    "Schneide;vc [m/min];f in mm/U;Schnitttiefe (mm);Zeit [s];VB_um;Leistung (W);Härte;Bemerkung"
)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
@pytest.mark.parametrize("separator", [";", "\t"])
def test_sheets_of_other_shapes_are_read(tmp_path: Path, encoding: str, separator: str) -> None:
    rows = ["A;100;0,3;2,5;90;200;4500;1,1;gut", "A;1,2e2;,4;3;120;250;5e3;1,0;"]
    text = "\n".join([GERMAN, *rows, ""]).replace(";", separator)
    measurements = read_measurements(reading(tmp_path, text.encode(encoding)))
    assert {name: column.tolist() for name, column in measurements.columns.items()} == {
        "cutting_speed": [100.0, pytest.approx(120)],
        "feed": [0.3, 0.4],
        "depth_of_cut": [2.5, 3.0],
        "time": [1.5, 2.0],
        "wear": pytest.approx([0.2, 0.25]),
        "power": [4.5, 5.0],
        "hardness": [1.1, 1.0],
    }
    assert measurements.edges is not None
    assert measurements.ignored == ("Bemerkung",)
    assert len(measurements.readings) == 8
    assert "times 0.001" in next(line for line in measurements.readings if "Leistung" in line)


@pytest.mark.parametrize(
    ("header", "column"),
    [
        ("Vc", "cutting_speed"),
        ("v_c [m/s]", "cutting_speed"),
        ("Schnittgeschwindigkeit m/min", "cutting_speed"),
        ("fn", "feed"),
        ("Vorschub [mm/U]", "feed"),
        ("f, mm/rev", "feed"),
        ("vf [mm/min]", None),
        ("n [1/min]", None),
        ("Feed rate (mm/rev)", "feed"),
        ("VBmax [mm]", "wear"),
        ("Tool No.", "edge"),
        ("Machining time, min", "time"),
        ("a_p", "depth_of_cut"),
        ("ap mm", "depth_of_cut"),
        ("DOC (ap) [mm]", "depth_of_cut"),
        ("DOC [inch]", "depth_of_cut"),
        ("t [min]", "time"),
        ("VB", "wear"),
        ("flank wear [µm]", "wear"),
        ("Verschleiß", "wear"),
        ("Ff [kN]", "feed_force"),
        ("P_kW", "power"),
        ("Spindelleistung in kW", "power"),
        ("Fc", "main_force"),
        ("SFM", "cutting_speed"),
        ("IPR", "feed"),
        ("HP", "power"),
        ("thrust force", "thrust_force"),
        ("note, of mine", None),
        ("Passivkraft", "back_force"),
        ("Insert", "edge"),
        ("Härte [%]", "hardness"),
        ("", None),
        ("Vorschub f [mm/U]", "feed"),
        ("Zeit (t)", "time"),
        ("Zeit f", None),
        ("f in mm", "feed"),
        ("f [in]", "feed"),
        ("mm", None),
        ("Insert #", "edge"),
        ("Platte Nr.", "edge"),
        ("P Nr.", None),
    ],
)
def test_headers_name_columns(header: str, column: str | None) -> None:
    assert read_heading(header).column == column


def test_workbooks_are_read(tmp_path: Path) -> None:
    path = tmp_path / "cuts.xlsx"
    path.write_bytes(b"no workbook")
    with pytest.raises(WorkshopError, match=r"openpyxl|no workbook"):
        read_measurements(path)
    book = pytest.importorskip("openpyxl").Workbook()
    book.active.append(["vc", "f", "ap", "P [W]", None])
    book.active.append([100, 0.3, 2.5, 4500, None])
    book.active.append([None] * 5)
    book.active.append([120, "0.4", 3, None, None])
    book.save(path)
    measurements = read_measurements(path)
    assert measurements.columns["feed"].tolist() == [0.3, 0.4]
    assert measurements.columns["power"][0] == 4.5
    assert measurements.lines.tolist() == [2, 4]


LOG = """Versuch 3, Halle 2

SFM,IPR,DOC,VB,Ff,Fp,Fc,note
,,in,um,lbf,lbf,lbf,
500,.012,.1,100,30,40,300,good
550,.012,.1,NaN,-,,,
600,.016,.1,200,60,80,350,
Mean,,,150,45,60,325,
Std. dev.,20,.002,,50,15,20,
Measured by: J. Smith, 2024-05-01,,,,,,
"""


def test_titles_units_means_and_forces_of_a_shops_sheet_are_read(tmp_path: Path) -> None:
    measurements = read_measurements(reading(tmp_path, LOG))
    assert measurements.columns["cutting_speed"] == pytest.approx([152.4, 167.64, 182.88])
    assert measurements.columns["feed"] == pytest.approx([0.3048, 0.3048, 0.4064])
    assert measurements.columns["wear"] == pytest.approx([0.1, np.nan, 0.2], nan_ok=True)
    assert measurements.columns["thrust_force"] == pytest.approx(
        [50 * 4.4482216, np.nan, 100 * 4.4482216], nan_ok=True
    )
    # Power is main force times cutting speed.
    power = np.array([300, 350]) * 4.4482216 * np.array([152.4, 182.88]) / 60e3
    assert measurements.columns["power"][[0, 2]] == pytest.approx(power)
    for note in (
        "header in line 3",
        "units in line 4",
        "without 3 rows of means",
        "resultant of feed_force and back_force",
    ):
        assert any(note in reading for reading in measurements.readings), note


def test_one_component_makes_no_thrust_force(tmp_path: Path) -> None:
    alone = read_measurements(reading(tmp_path, GOOD.replace("power", "Fp")))
    assert "thrust_force" not in alone.columns
    assert any("feed_force, which is not measured" in reading for reading in alone.readings)


def test_endless_files_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    for endless in (Path("/dev/zero"), tmp_path / "pipe.csv"):
        with pytest.raises(WorkshopError, match="a pipe or a device, but must be a regular file"):
            read_measurements(endless)


@pytest.mark.slow
def test_huge_sheets_are_refused(tmp_path: Path) -> None:
    with pytest.raises(WorkshopError, match="is larger than 50000000 bytes"):
        read_measurements(reading(tmp_path, b"0" * 50_000_001))
    with pytest.raises(WorkshopError, match="more than 100000 rows"):
        read_measurements(reading(tmp_path, HEADER + "100,0.3,2.5,0.2,4.5\n" * 100_001))


def with_rows(book: Path, count: int) -> dict[str, bytes]:
    """Return the parts of a workbook, its only row repeated: openpyxl takes seconds to write it."""
    contents = {}
    with zipfile.ZipFile(book) as parts:
        for name in parts.namelist():
            contents[name] = parts.read(name)
    sheet = contents["xl/worksheets/sheet1.xml"]
    row = sheet[sheet.index(b"<row") : sheet.index(b"</sheetData>")]
    unnumbered = re.sub(rb' r="\w+"', b"", row)
    contents["xl/worksheets/sheet1.xml"] = sheet.replace(row, count * unnumbered)
    return contents


@pytest.mark.slow
def test_huge_workbooks_are_refused(tmp_path: Path) -> None:
    book = pytest.importorskip("openpyxl").Workbook()
    book.active.append([1])
    path = tmp_path / "cuts.xlsx"
    book.save(path)
    contents = with_rows(path, 100_003)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as parts:
        for name, content in contents.items():
            parts.writestr(name, content)
    with pytest.raises(WorkshopError, match="more than 100000 rows"):
        read_measurements(path)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as parts:
        parts.writestr("more.xml", "<c/>" * 3_000_000)
    with pytest.raises(WorkshopError, match="million tags"):
        read_measurements(path)


def test_edges_have_any_name(tmp_path: Path) -> None:
    rows = ["A 1,100", "b,100", "A 1 ,100", ",100", ",100", "1,100"]
    content = "edge,cutting_speed,feed,depth_of_cut\n" + "".join(f"{row},0.3,2.5\n" for row in rows)
    edges = read_measurements(reading(tmp_path, content)).edges
    assert edges is not None
    assert edges[0] == edges[2]
    assert len(set(edges)) == 5
    assert read_measurements(reading(tmp_path, GOOD)).edges is None


def test_two_columns_of_edges_are_refused(tmp_path: Path) -> None:
    content = "edge,feed,cutting_speed,edge,depth_of_cut\nA,0.3,100,A,2.5\n"
    with pytest.raises(WorkshopError, match="more than one column edge"):
        read_measurements(reading(tmp_path, content))


FORCES = "150;0.2;2;0.1;900;300;400;1030\n200;0.3;2;0.2;1300;450;600;1500\n"


def test_letters_tell_a_feed_from_a_force(tmp_path: Path) -> None:
    measurements = read_measurements(reading(tmp_path, "vc;f;ap;VB;Fc;Fp;Ff;F\n" + FORCES))
    assert measurements.columns["feed"].tolist() == [0.2, 0.3]
    assert measurements.columns["thrust_force"] == pytest.approx([500, 750])
    capitals = read_measurements(reading(tmp_path, "VC;F;AP;vb;FC;FP;FF;F res\n" + FORCES))
    assert list(capitals.columns) == list(measurements.columns)
    for name, values in measurements.columns.items():
        assert capitals.columns[name].tolist() == values.tolist(), name


def test_forces_along_axes_are_asked_for(tmp_path: Path) -> None:
    sheet = reading(tmp_path, "vc;f;ap;VB;Fx;Fy;Fz [N];F\n" + FORCES)
    with pytest.raises(WorkshopError, match=r"'Fx', 'Fy', 'Fz \[N\]'.* --forces Fc=Fx"):
        read_measurements(sheet)
    measurements = read_measurements(
        sheet, {"main_force": "Fx", "back_force": "Fy", "feed_force": "Fz"}
    )
    assert measurements.columns["thrust_force"] == pytest.approx([500, 750])
    assert measurements.columns["power"] == pytest.approx([900 * 150 / 60e3, 1300 * 200 / 60e3])
    with pytest.raises(WorkshopError, match="no column is headed 'Fq'"):
        read_measurements(sheet, {"main_force": "Fq"})


def with_column(header: str, first: float, second: float) -> str:
    """Return a sheet of two cuts with a column of its own."""
    return f"vc;f;ap;VB;{header}\n150;0.2;2;0.1;{first}\n150;0.3;2;0.2;{second}\n"


@pytest.mark.parametrize(
    ("sheet", "column"),
    [
        pytest.param(with_column("P", 3.1, 5.2), "power", id="P of a few kW"),
        pytest.param(with_column("P [N]", 300, 450), "back_force", id="P in N"),
        pytest.param(with_column("P [W]", 3100, 5200), "power", id="P in W"),
        pytest.param(with_column("T", 5, 9), "time", id="T of some minutes"),
        pytest.param(with_column("T [min]", 5, 9), "time", id="T in min"),
    ],
)
def test_symbols_of_several_quantities_are_read_by_unit_and_size(
    tmp_path: Path, sheet: str, column: str
) -> None:
    assert column in read_measurements(reading(tmp_path, sheet)).columns


@pytest.mark.parametrize("symbol", ["P", "T"])
def test_symbols_with_numbers_of_another_quantity_are_asked_for(
    tmp_path: Path, symbol: str
) -> None:
    sheet = reading(tmp_path, with_column(symbol, 620, 840))
    with pytest.raises(WorkshopError, match=f"column '{symbol}' .*--columns"):
        read_measurements(sheet)


@pytest.mark.parametrize("header", ["T [\N{DEGREE SIGN}C]", "F [N]"])
def test_symbols_of_quantities_that_are_not_read_are_ignored(tmp_path: Path, header: str) -> None:
    sheet = reading(tmp_path, with_column(header, 620, 840))
    assert read_measurements(sheet).ignored == (header,)


def test_of_two_columns_of_one_name_the_user_says_which(tmp_path: Path) -> None:
    sheet = reading(tmp_path, "Vc;vc;f;ap;VB;P\n100;150;0.3;2;0.1;4\n100;160;0.3;2;0.2;4\n")
    with pytest.raises(
        WorkshopError, match=r"more than one column cutting_speed.*--columns cutting_speed="
    ):
        read_measurements(sheet)
    measurements = read_measurements(sheet, {"cutting_speed": "vc"})
    assert measurements.columns["cutting_speed"].tolist() == [150, 160]
