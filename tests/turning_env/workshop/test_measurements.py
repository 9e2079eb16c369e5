"""Reading measurements: every mistake is named. Damaged files: ``tests/soundness/test_readers.py``."""

from pathlib import Path

import numpy as np
import pytest

from turning_env.workshop import WorkshopError
from turning_env.workshop.measurements import read_measurements

HEADER = "cutting_speed,feed,depth_of_cut,wear,power\n"
GOOD = HEADER + "100,0.3,2.5,0.2,4.5\n"


def reading(folder: Path, content: str | bytes) -> Path:
    path = folder / "cuts.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is empty: a header and rows"),
        (HEADER, "has a header but no rows"),
        ("feed,power\n1,2\n", "no column cutting_speed, depth_of_cut; it has 'feed', 'power', and the columns understood are"),
        ("speed,feed,depth_of_cut\n1,1,1\n", r"no column cutting_speed;.*cutting_speed \[m/min\], feed \[mm/rev\]"),
        (GOOD.replace(",", ";"), "cells are separated by semicolons: save it with commas between cells, and points"),
        (GOOD.replace(",", "\t"), "separated by tabs"),
        (GOOD.replace("wear", "feed"), "more than one column feed"),
        (GOOD + "fast,0.3,2.5,0.2,4.5\n", "line 3, column cutting_speed: 'fast' is not a number; allowed is 0.1 to 5000 m/min"),
        (GOOD + '100,"0,3",2.5,0.2,4.5\n', "line 3, column feed: '0,3' has a comma: write decimals with a point"),
        (GOOD + "100,-0.3,2.5,0.2,4.5\n", "line 3, column feed: -0.3 is outside the allowed range 0.001 to 10 mm/rev"),
        (GOOD + "100,0.3,2.5,nan,4.5\n", "line 3, column wear: 'nan' is not a number"),
        (GOOD + "1_00,0.3,2.5,0.2,4.5\n", "'1_00' is not a number"),
        (GOOD + "\n\n100,0.3,2.5,0.2\n", "line 5 has 4 cells, but the header has 5"),
        ("cutting_speed,feed,depth_of_cut,hardness\n100,0.3,2.5,260\n", "hardness: 260 is outside .*: 1 is nominal"),
        (GOOD.encode("utf-16"), "is not text in UTF-8: save the sheet as CSV, in UTF-8"),
        (HEADER + '"100', "is not CSV"),
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
    found = read_measurements(reading(tmp_path, content))
    assert found.ignored == ("note, of mine",)
    assert found.columns["cutting_speed"].tolist() == [100, 120]
    assert found.columns["feed"].tolist() == [0.3, 0.4]
    assert np.isnan(found.columns["wear"]).tolist() == [True, False]
    assert found.lines.tolist() == [3, 5]
    assert len(read_measurements(reading(tmp_path, GOOD.replace("\n", "\r"))).lines) == 1  # old line ends


def test_edges_have_any_name(tmp_path: Path) -> None:
    rows = ["A 1,100", "b,100", "A 1 ,100", ",100", ",100", "1,100"]
    content = "edge,cutting_speed,feed,depth_of_cut\n" + "".join(f"{row},0.3,2.5\n" for row in rows)
    edges = read_measurements(reading(tmp_path, content)).edges
    assert edges is not None
    assert edges[0] == edges[2]
    assert len(set(edges)) == 5
    assert read_measurements(reading(tmp_path, GOOD)).edges is None
    with pytest.raises(WorkshopError, match="more than one column edge"):
        read_measurements(reading(tmp_path, content.replace("feed", "edge").replace("edge,cutting", "edge,feed,cutting")))
