"""What every reader of files from elsewhere promises: what the file may hold, or an error of its own, which names the file."""

import json
import lzma
from collections.abc import Callable
from functools import partial
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from leaderboard.result import Digests, Result, ResultError, Task, read_part, write_part
from leaderboard.trajectories import Trajectories
from tests.soundness.damage import damaged, damaged_json, damaged_onnx, damaged_toml
from train.agents import agent_file
from train.agents import graph as plain_graph
from turning_env import Scenario, ScenarioError
from turning_env.programs.program import NcError
from turning_env.programs.read import read, read_file
from turning_env.programs.write import write
from turning_env.workshop import WorkshopError
from turning_env.workshop.measurements import COLUMNS, EDGE, read_measurements

ROOT = Path(__file__).parents[2]
TRIED = "tried"
"""What a file with the content to be tried is called, without its suffix."""
_ROWS = ROOT / "leaderboard" / "results"
_XZ = b"\xfd7zXZ\0"
_OUTLINE = TypeAdapter(plain_graph.Outline)

PROGRAM = b"""\
N10 G18 G40 G54 G64 G90 G95 G710 DIAMON
N20 T1 D1
N30 G96 S150.0 F0.300 LIMS=636.6 M03 ; bar 1
N40 G00 X120.000 Z3.000
N50 G00 X100.000
N60 G01 Z-10.000
N70 G01 Z-20.500 S140.0
N80 G00 X120.000
N90 G00 Z3.000
N100 M05
N110 M00 ; the next bar is put in
N120 G96 S150.0 F0.300 M03
N130 G00 X120.000 Z3.000
N140 G00 X100.000
N150 G01 Z-10.000 F0.2
N160 G00 X120.000
N170 G00 Z3.000
N180 M05
N190 M30
"""
PROGRAM_WITH_LAW = b"""\
N10 G18 G40 G54 G64 G90 G95 G710 DIAMON
N20 T1 D1
N30 STOPRE
N40 $AC_PARAM[0]=100.0
N50 FCTDEF(1,0.0,150.0,200.0,-1.0,0.0,0.0)
N60 ID=1 DO $AC_PARAM[0]=$AC_PARAM[0]+0.25*(100.0-$AA_LOAD[S1])
N70 ID=2 WHENEVER ($AC_PARAM[0]>150.0) AND ($AA_LOAD[S1]<=2.0*$AC_PARAM[0]) DO $AC_PARAM[0]=150.0
N80 ID=3 DO SYNFCT(1,$AC_OVR,$AA_LOAD[S1])
N90 G96 S150.0 F0.300 LIMS=636.6 M03
N100 G00 X120.000 Z3.000
N110 G00 X100.000
N120 G01 Z-100.000
N130 G00 X120.000
N140 G00 Z3.000
N150 M05
N160 M30
"""


class Reader(NamedTuple):
    """A reader, what it promises, and what to try it on."""

    suffix: str
    """Of its files."""
    valid: Callable[[], tuple[bytes, ...]]
    """What files may hold, to be damaged."""
    check: Callable[[Path, bytes], Any]
    """Have a content read from a file in a folder: what it gives, None where it refuses; any error is a broken promise."""
    damaged: Callable[[bytes, Random], bytes]
    """Damages a content, mostly so that it keeps its form."""
    tokens: tuple[bytes, ...]
    """Words of the file's language."""


def attempt(read: Callable[[Path], Any], path: Path, refusal: type[Exception]) -> Any:
    """What a reader gives, None where it refuses: with an error of its own, which names the file."""
    try:
        return read(path)
    except refusal as error:
        complaint = str(error)
    assert str(path) in complaint, f"the file is not named: {complaint[:500]}"
    return None


def scenario(folder: Path, content: bytes) -> Scenario | None:
    """A scenario that is read can be built again from its values, and saved."""
    path, again = _file(folder, content, ".toml"), folder / "again.toml"
    found: Scenario | None = attempt(Scenario.load, path, ScenarioError)
    if found is not None:
        assert Scenario.model_validate(found.model_dump()) == found
        found.save(again)
        assert Scenario.load(again) == found
    return found


def measurements(folder: Path, content: bytes) -> Any:
    """Measurements that are read are as many in each column, and as is believed of it, or missing."""
    table = attempt(read_measurements, _file(folder, content, ".csv"), WorkshopError)
    if table is not None:
        for name, values in table.columns.items():
            assert values.shape == table.lines.shape
            assert (np.isnan(values) | (COLUMNS[name].low <= values) & (values <= COLUMNS[name].high)).all()
        assert table.edges is None or table.edges.shape == table.lines.shape
    return table


def results(folder: Path, content: bytes) -> Result | Trajectories | None:
    """Results and trajectories that are read are written and read again alike; compressed ones are known by how they begin."""
    path, again = _file(folder, content, ".json.xz" if content.startswith(_XZ) else ".json"), folder / "again.json"
    found: Result | Trajectories | None = None
    for kind in (Result, Trajectories):
        part = attempt(partial(read_part, kind), path, ResultError)
        if part is not None:
            found = part
            write_part(part, again)
            assert read_part(kind, again) == part
    return found


def agent(folder: Path, content: bytes) -> agent_file.AgentFile | None:
    """An agent's file that is read says of itself what another process can be told.

    This goes as far as what this project does in its own code. A stranger's network is built and run in a process of its own
    (``train/agents/sandbox.py``): if ONNX Runtime crashes on it, that process ends, and the file is refused. Here it would end the
    fuzzer; ``tests/soundness/test_readers.py`` tries that part.
    """
    file: agent_file.AgentFile | None = attempt(agent_file.read, _file(folder, content, ".onnx"), ValueError)
    if file is not None:
        _, outline = plain_graph.read(content)
        told = json.dumps(outline._asdict()).encode()
        assert _OUTLINE.validate_json(told, strict=True) == outline
    return file


def program(folder: Path, content: bytes) -> Any:
    """An NC program that is read can be written and read again."""
    found = attempt(read_file, _file(folder, content, ".mpf"), NcError)
    assert found is None or read(write(found)) == found
    return found


def rows() -> list[Path]:
    """The files of results that come with the project, the smallest first."""
    return sorted(
        (path for path in _ROWS.glob("*/*/*.json.xz") if path.name != "trajectories.json.xz"),
        key=lambda path: (path.stat().st_size, path),
    )


def small_result() -> dict[str, Any]:
    """A result of three draws, in the form that is kept in JSON."""
    values: dict[str, Any] = json.loads(lzma.decompress(rows()[0].read_bytes()))
    values["task"]["draws"] = values["task"]["draws"][:3]
    values["episodes"] = {name: column[:3] for name, column in values["episodes"].items()}
    digests = Digests.of(Task.model_validate(values["task"]), values["versions"]["rough-turning"], values["digests"]["code"])
    return values | {"digests": digests.model_dump()}


def _small_trajectories() -> dict[str, Any]:
    path = min(_ROWS.glob("*/*/trajectories.json.xz"), key=lambda path: (path.stat().st_size, path))
    values: dict[str, Any] = json.loads(lzma.decompress(path.read_bytes()))
    episode = values["episodes"][0]
    episode["series"] = {name: column[:2] for name, column in episode["series"].items()}
    return values | {"episodes": [episode]}


def _valid_scenarios() -> tuple[bytes, ...]:
    return (
        Scenario.load("override").to_toml().encode(),
        b'base = "forging"\nname = "mine"\n[limits]\npower = 11.0\n[workpiece]\nbars = 3\n',
    )


def _valid_measurements() -> tuple[bytes, ...]:
    return (
        (ROOT / "docs" / "examples" / "cuts.csv").read_bytes(),
        b'edge,cutting_speed,feed,depth_of_cut,time,wear\r\n"a, 1",150,.3,2,1e1,0.1\r\n,120,0.2,2.5,,\r\n',
    )


def _valid_results() -> tuple[bytes, ...]:
    whole = (json.dumps(small_result()).encode(), json.dumps(_small_trajectories()).encode())
    return (*whole, lzma.compress(whole[0], preset=0))


def _valid_agents() -> tuple[bytes, ...]:
    path = min((ROOT / "agents").glob("*/*/*.onnx"), key=lambda path: (path.stat().st_size, path))
    return (path.read_bytes(),)


def _file(folder: Path, content: bytes, suffix: str) -> Path:
    path = folder / f"{TRIED}{suffix}"
    path.write_bytes(content)
    return path


def _quoted(names: object) -> tuple[bytes, ...]:
    return tuple(f'"{name}"'.encode() for name in names)  # type: ignore[attr-defined]


_SECTIONS = tuple(Scenario.model_fields)
_TOML_TOKENS = (b"base", b"name", b'"""', b"'''", b"[[", b"1979-05-27T07:32:00Z", b"inf", b"0x7f", b"1_000", b"\\u0000")
_CSV_TOKENS = tuple(name.encode() for name in (*COLUMNS, EDGE, "\r\n", "\ufeff", "1e5", '"', '""', ";", "\t", "1,5", "+.5"))
_NC_TOKENS = tuple(
    b"G00 |G01 |G95 |G96 |M00|M03|M05|M30|LIMS=|STOPRE|FCTDEF(|SYNFCT(|ID=| DO | WHENEVER | AND |$AC_OVR|$AC_PARAM[1]|"
    b"$AA_LOAD[S1]|;|\n|\r|N999 |X|Z-|S|F0.001|(|)|+|-|*|/|<=|>=".split(b"|")
)

READERS = {
    "scenario": Reader(
        ".toml",
        _valid_scenarios,
        scenario,
        damaged_toml,
        (*_TOML_TOKENS, *(f"\n[{name}]\n".encode() for name in _SECTIONS)),
    ),
    "measurements": Reader(".csv", _valid_measurements, measurements, partial(damaged, tokens=_CSV_TOKENS), _CSV_TOKENS),
    "results": Reader(
        ".json", _valid_results, results, damaged_json, _quoted((*Result.model_fields, *Task.model_fields, *_SECTIONS))
    ),
    "agent": Reader(".onnx", _valid_agents, agent, damaged_onnx, tuple(name.encode() for name in sorted(plain_graph.OPERATORS))),
    "program": Reader(".mpf", lambda: (PROGRAM, PROGRAM_WITH_LAW), program, partial(damaged, tokens=_NC_TOKENS), _NC_TOKENS),
}
