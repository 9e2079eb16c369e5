"""Tool libraries are read, written and read again; FreeCAD gets turning from its presets."""

import importlib.util
import json
import math
import sys
import types
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import turning_shop
from turning_shop import WorkshopError
from turning_shop.tool_library import Tool, csv_of, read_tools, toolbit_of

from turning_env.__main__ import main

# FreeCAD's own iso_shape_c.fctb (src/Mod/CAM/Tools/Bit) has this structure.
TOOLBIT = {
    "version": 2,
    "name": "CCMT060204",
    "shape": "Iso_Shape_C.fcstd",
    "parameter": {"EdgeLength": "6.45 mm", "TipAngle": "80.00 °", "TipRadius": "0.40 mm"},
    "attribute": {},
}
# Entities and their parameters as ISO 13399 has them; numbers of a CNMG120408.
P21 = """ISO-10303-21;
HEADER;
FILE_SCHEMA(('CUTTING_TOOL_SCHEMA_ARM'));
ENDSEC;
DATA;
#1=LANGUAGE($,'eng');
#2=STRING_WITH_LANGUAGE('CNMG120408-PM',#1);
#3=MULTI_LANGUAGE_STRING($,#2);
#4=ITEM('5733498',$,#3);
#5=UNIT('mm',$,.MILLI.,.METRE.);
#6=PLIB_PROPERTY_REFERENCE('71D084653E57F','001',#20);
#7=PROPERTY((#5),$,'RE',#6,'length',$);
#8=NUMERICAL_VALUE('RE',2,#5,RADIUS);
#9=PROPERTY_VALUE_REPRESENTATION(#7,$,.NOMINAL_VALUE.,#8);
#10=STRING_WITH_LANGUAGE('4325 (P25)',#1);
#11=MULTI_LANGUAGE_STRING($,#10);
#12=STRING_VALUE('GRADE',#11);
ENDSEC;
END-ISO-10303-21;
"""
PM = Tool(
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


def test_a_tool_bit_of_freecad_is_read(tmp_path: Path) -> None:
    (tool,) = read_tools(written(tmp_path, "c.fctb", json.dumps(TOOLBIT)))
    assert tool.designation == "CCMT060204"
    assert tool.nose_radius == 0.4
    assert tool.edge_length == 6.45


def test_a_p21_file_is_read(tmp_path: Path) -> None:
    text = P21.replace("RADIUS", "0.7938")
    (tool,) = read_tools(written(tmp_path, "insert.p21", text))
    assert tool.designation == "CNMG120408-PM"
    assert tool.grade == "4325 (P25)"
    assert tool.nose_radius == 0.7938
    inches = text.replace("0.7938", "0.03125").replace("UNIT('mm'", "UNIT('in'")
    (tool,) = read_tools(written(tmp_path, "inch.p21", inches))
    assert tool.nose_radius == pytest.approx(0.79375)


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
        pytest.param("fctb", "{}", "no tool bit", id="empty tool bit"),
        pytest.param("fctb", "CNMG", "no tool bit", id="text as a tool bit"),
        pytest.param("p21", "CNMG", "ISO-10303-21", id="text as a P21 file"),
        pytest.param(
            "p21",
            "ISO-10303-21;\nDATA;\nENDSEC;\n",
            "no item",
            id="empty P21 file",
        ),
        pytest.param("xml", "<a/>", "suffix", id="another format"),
    ],
)
def test_a_file_that_is_no_library_is_refused(
    tmp_path: Path, suffix: str, text: str, complaint: str
) -> None:
    with pytest.raises(WorkshopError, match=complaint):
        read_tools(written(tmp_path, f"tools.{suffix}", text))


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    other = Tool(**{**PM.__dict__, "material": "1.4301", "cutting_speed": 140.0})
    assert read_tools(written(tmp_path, "t.csv", csv_of([PM, other]))) == [PM, other]
    assert read_tools(written(tmp_path, "t.fctb", toolbit_of([PM, other]))) == [PM, other]


def test_lengths_that_a_table_lacks_are_on_the_tool_bit() -> None:
    parameters = json.loads(toolbit_of([Tool(designation="CNMG120408")]))["parameter"]
    assert parameters["TipRadius"] == "0.80 mm"
    assert parameters["EdgeLength"] == "12.90 mm"


def test_a_shape_that_freecad_lacks_is_refused() -> None:
    with pytest.raises(WorkshopError, match="C, D, S, T"):
        toolbit_of([Tool(designation="WNMG080408")])


def test_the_command_converts_what_it_can(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = written(tmp_path, "t.csv", csv_of([PM, Tool(designation="WNMG080408")]))
    folder = tmp_path / "Bit"
    assert main(["tools", str(table), "--out", str(folder)]) == 0
    assert "WNMG080408" in capsys.readouterr().err
    assert [path.name for path in folder.iterdir()] == ["CNMG120408_PM.fctb"]
    assert main(["tools", str(table), "--out", str(folder)]) == 2


@dataclass(frozen=True)
class PartialResult:
    """FreeCAD's, with the fields of its ``Path/Tool/FeedsSpeeds/types.py``."""

    horiz_feed: float | None = None
    vert_feed: float | None = None
    spindle_speed: float | None = None
    chipload: float | None = None
    surface_speed: float | None = None
    source: str = ""
    confidence: float = 0.0
    warnings: tuple[str, ...] = ()


@pytest.fixture
def turning_feeds(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the provider's module, loaded as FreeCAD does: from its file."""
    for name in ("Path", "Path.Tool", "Path.Tool.FeedsSpeeds"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    contexts = types.ModuleType("Path.Tool.FeedsSpeeds.types")
    contexts.PartialResult = PartialResult  # type: ignore[attr-defined]
    resolver = types.ModuleType("Path.Tool.FeedsSpeeds.resolver")
    resolver.default_providers = lambda: ("preset",)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "Path.Tool.FeedsSpeeds.types", contexts)
    monkeypatch.setitem(sys.modules, "Path.Tool.FeedsSpeeds.resolver", resolver)
    package = sys.modules["Path.Tool.FeedsSpeeds"]
    package.resolver = resolver  # type: ignore[attr-defined]
    path = Path(turning_shop.__file__).parent / "freecad" / "turning_feeds.py"
    spec = importlib.util.spec_from_file_location("turning_feeds", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def suggested(turning_feeds: Any, material: str, shape: str = "Iso_Shape_C") -> Any:
    presets = tuple(json.loads(toolbit_of([PM]))["presets"])
    tool = SimpleNamespace(
        diameter=1.48,
        flutes=None,
        presets=presets,
        shape_id=shape,
    )
    context = SimpleNamespace(name=material, uuid=None)
    return turning_feeds.TurningProvider().suggest(tool, context, SimpleNamespace(op_type=None))


def test_freecad_gets_turning_by_the_diameter_of_the_bar(turning_feeds: Any) -> None:
    result = suggested(turning_feeds, "42crmo4")
    assert result.spindle_speed == pytest.approx(1000 * 168 / (math.pi * 80))
    assert result.horiz_feed == pytest.approx(0.4 * result.spindle_speed)
    assert result.surface_speed == 168.0
    assert suggested(turning_feeds, "GG25") is None
    assert suggested(turning_feeds, "42CrMo4", shape="endmill") is None


def test_the_provider_stands_before_those_of_freecad_once(turning_feeds: Any) -> None:
    turning_feeds.install()
    turning_feeds.install()
    resolver = sys.modules["Path.Tool.FeedsSpeeds.resolver"]
    first, *others = resolver.default_providers()
    assert first.name == "turning"
    assert others == ["preset"]
