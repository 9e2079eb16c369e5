"""The command line of the environment."""

import json

import pytest

from turning_env import presets
from turning_env.__main__ import main


def test_the_schema_says_unit_and_range(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", "--schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    bar_length = schema["$defs"]["Workpiece"]["properties"]["bar_length"]
    assert bar_length["unit"] == "mm"
    assert bar_length["minimum"] == 1
    assert bar_length["maximum"] == 1e5
    assert schema["properties"]["base"]["anyOf"][0]["enum"] == list(presets())
