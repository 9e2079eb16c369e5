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
    assert schema["properties"]["base"]["enum"] == list(presets())
    assert (bar_length["unit"], bar_length["minimum"], bar_length["maximum"]) == ("mm", 1, 1e5)
