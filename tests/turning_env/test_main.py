import json
from pathlib import Path

import pytest

from turning_env import Scenario, presets
from turning_env.__main__ import main


def test_presets_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["presets"]) == 0
    assert capsys.readouterr().out.split() == list(presets())


def test_a_shown_scenario_can_be_loaded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "forging"]) == 0
    path = tmp_path / "mine.toml"
    path.write_text(capsys.readouterr().out)
    assert Scenario.load(path) == Scenario.load("forging")


def test_the_schema_says_unit_and_range(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    bar_length = schema["$defs"]["Workpiece"]["properties"]["bar_length"]
    assert schema["properties"]["base"]["anyOf"][0]["enum"] == list(presets())
    assert (bar_length["unit"], bar_length["minimum"], bar_length["maximum"]) == ("mm", 1, 1e5)


def test_cuts_beyond_the_machine_are_predicted_with_a_warning(capsys: pytest.CaptureFixture[str]) -> None:
    table = ["whatif", "rough_turning", "--wear", "0.1", "--cutting-speed"]
    assert main([*table, "150", "500", "--feed", "0.05", "0.3", "--csv"]) == 0
    printed = capsys.readouterr()
    assert len(printed.out.splitlines()) == 5
    assert "--cutting-speed 500 is outside the machine's 50 to 200 m/min" in printed.err
    assert "--feed 0.05 is outside the machine's 0.06 to 0.6 mm/rev" in printed.err
    assert main([*table, "200", "--feed", "0.6"]) == 0
    assert capsys.readouterr().err == ""
