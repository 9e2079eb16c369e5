"""Whatever stands in a file: its reader gives what the file may hold, or an error of the reader's own."""

import json
import lzma
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from leaderboard.results import Result, ResultError, read_part, read_result
from leaderboard.trajectories import Trajectories
from tests.soundness.effort import tried
from tests.soundness.mutation import damaged
from train import onnx_policy
from train.nc.program import NcError
from train.nc.read import read, read_file
from train.nc.write import write
from turning_env import Scenario, ScenarioError
from turning_env.calibration.columns import MeasurementError
from turning_env.calibration.reading import read_measurements

ROOT = Path(__file__).parents[2]
TOML = Scenario.load("override").to_toml().encode()
CSV = (ROOT / "docs" / "examples" / "cuts.csv").read_bytes()
AGENT = (ROOT / "agents" / "RoughTurning-Override-v0" / "override" / "ppo-seed0.onnx").read_bytes()
ROW = next(path for path in sorted((ROOT / "leaderboard" / "rows").glob("*/*/*.json.xz")) if path.name != "trajectories.json.xz")
PROGRAM = b"""\
N10 G18 G40 G54 G64 G90 G95 G710 DIAMON
N20 T1 D1
N30 STOPRE
N40 G96 S150.0 F0.300 LIMS=636.6 M03 ; bar 1
N50 G00 X120.000 Z3.000
N60 G00 X100.000
N70 G01 Z-10.000
N80 G01 Z-20.500 S140.0
N90 G00 X120.000
N100 G00 Z3.000
N110 M05
N120 M30
"""


def shortened() -> bytes:
    """A result with three of its draws; its digests no longer match, as of a file that was tampered with."""
    values = json.loads(lzma.decompress(ROW.read_bytes()))
    values["task"]["draws"] = values["task"]["draws"][:3]
    values["episodes"] = {name: column[:3] for name, column in values["episodes"].items()}
    return json.dumps(values).encode()


JSON = shortened()


def attempt(read: Callable[[Path], Any], path: Path, refusal: type[Exception]) -> Any:
    """What a reader gives, None where it refuses: with an error of its own, which names the file."""
    try:
        return read(path)
    except refusal as error:
        complaint = str(error)
    assert str(path) in complaint
    return None


@pytest.mark.parametrize("text", ["x = " + "[" * 5_000, "x = " + "9" * 5_000, "name" + ".a" * 5_000 + " = 1"])
def test_a_scenario_file_beyond_python_s_limits_is_a_scenario_error(text: str, tmp_path: Path) -> None:
    (tmp_path / "deep.toml").write_text(text)
    with pytest.raises(ScenarioError, match="deep"):
        Scenario.load(tmp_path / "deep.toml")


@tried(short=150, soak=100_000)
@given(damaged(TOML))
def test_a_scenario_file_is_read_or_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "damaged.toml"
    path.write_bytes(content)
    scenario = attempt(Scenario.load, path, ScenarioError)
    assert scenario is None or Scenario.model_validate(scenario.model_dump()) == scenario


@tried(short=150, soak=100_000)
@given(damaged(CSV))
def test_a_table_of_measurements_is_read_or_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "damaged.csv"
    path.write_bytes(content)
    table = attempt(read_measurements, path, MeasurementError)
    assert table is None or not any(np.isinf(column).any() for column in table.columns.values())


@tried(short=60, soak=20_000)
@given(damaged(JSON), st.booleans())
def test_results_and_trajectories_that_were_tampered_with_are_refused(tmp_path: Path, content: bytes, compressed: bool) -> None:
    path = tmp_path / ("damaged.json.xz" if compressed else "damaged.json")
    path.write_bytes(lzma.compress(content, preset=0) if compressed else content)
    assert attempt(lambda path: read_part(Result, path), path, ResultError) is None
    assert attempt(lambda path: read_part(Trajectories, path), path, ResultError) is None


@tried(short=40, soak=10_000)
@given(damaged(ROW.read_bytes()))
def test_a_compressed_row_is_read_or_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path.joinpath(*ROW.parts[-3:])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    result = attempt(read_result, path, ResultError)
    assert result is None or result == read_result(ROW)


@tried(short=80, soak=30_000)
@given(damaged(AGENT))
def test_an_agent_is_read_and_acts_or_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "damaged.onnx"
    path.write_bytes(content)
    agent = attempt(onnx_policy.load, path, ValueError)
    if agent is not None:
        actions = agent.make(2).act(np.zeros((2, 11), np.float32))
        assert actions.shape == (2, 1)
        assert np.abs(actions).max() <= 1.0


@tried(short=150, soak=200_000)
@given(damaged(PROGRAM))
def test_an_nc_program_is_read_or_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "damaged.mpf"
    path.write_bytes(content)
    program = attempt(read_file, path, NcError)
    assert program is None or read(write(program)) == program
