"""Readers of files from elsewhere, with what each promises, and damaged files for them.

A reader gives what the file may hold, or an error of its own that names the file. Damaged files are valid ones with bytes cut
out, put in or doubled, or with a value that is odd, missing or elsewhere, so that they keep their form; and bytes of any kind.
"""

import json
import lzma
import tomllib
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np
import onnx
import tomli_w
from google.protobuf import json_format
from hypothesis import strategies as st
from pydantic import TypeAdapter

from leaderboard.result import Result, ResultError, read_part, read_result, write_part
from leaderboard.trajectories import Trajectories
from train.agents import agent_file
from train.agents import graph as plain_graph
from turning_env import Scenario, ScenarioError
from turning_env.programs.program import NcError
from turning_env.programs.read import read, read_file
from turning_env.programs.write import write
from turning_env.workshop import WorkshopError
from turning_env.workshop.measurements import COLUMNS, EDGE, read_measurements

ROOT = Path(__file__).parents[2]
_RESULTS = ROOT / "leaderboard" / "results"
_ODD = (b"", b"\0", b"\xff", b"\n", b'"', b"[" * 3_000, b"{", b"9" * 5_000, b"1e999", b"nan", b"-1", b"null", b"=", b",")
_ODD_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 7, 65_537, 2**31, 2**63, -(2**63), 10**400, 0.0, -0.0, 5e-324, 1e-12, 1.5, 1e30, 1e308),
    *(float("nan"), float("inf"), "", "nan", "../x", "\0", "\ud800", "x" * 300, [], [[]], {}, {"": None}),
    *("If", "Loop", "Constant", "Reshape", "Expand", "observation", "memory", "action", "ai.onnx"),
)
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


def _load_onnx(content: bytes) -> Any:
    return json_format.MessageToDict(onnx.load_model_from_string(content))


def _dump_onnx(tree: Any) -> bytes:
    return json_format.ParseDict(tree, onnx.ModelProto()).SerializeToString()


FORMS: dict[str, tuple[Callable[[bytes], Any], Callable[[Any], bytes]]] = {
    ".toml": (lambda content: tomllib.loads(content.decode()), lambda tree: tomli_w.dumps(tree).encode()),
    ".json": (json.loads, lambda tree: json.dumps(tree).encode()),
    ".onnx": (_load_onnx, _dump_onnx),
}
"""Functions that load a file's content as a tree, and that write the tree, by suffix."""


@cache
def damages(name: str) -> st.SearchStrategy[bytes]:
    """Return damaged files for a reader of ``READERS``."""

    def strategy() -> st.SearchStrategy[bytes]:
        reader = READERS[name]
        valid, random = st.sampled_from(reader.valid()), st.randoms(use_true_random=False)
        kept = st.builds(partial(_change, reader.suffix, reader.tokens), valid, random)
        return st.one_of(*[kept] * 4, *map(damages_of, reader.valid()))

    return st.deferred(strategy)  # reads files only when inputs are drawn


def damages_of(valid: bytes) -> st.SearchStrategy[bytes]:
    """Return contents with one to four damages to their bytes, or of any other bytes."""
    random = st.randoms(use_true_random=False)
    return st.one_of(*[st.builds(_damage, st.just(valid), random)] * 9, st.binary(max_size=300))


def _damage(content: bytes, random: Random, tokens: tuple[bytes, ...] = ()) -> bytes:
    for _ in range(random.randint(1, 4)):
        place, start = random.randint(0, len(content)), random.randint(0, len(content))
        end = min(place + random.choice((0, 0, 1, 1, 4, 40, len(content))), len(content))
        odd = random.choice(tokens if tokens and random.random() < 0.5 else _ODD)
        new = (odd, random.randbytes(random.randint(0, 6)), content[start : start + random.randint(0, 60)])
        content = content[:place] + random.choice(new) + content[end:]
    return content


def _change(suffix: str, tokens: tuple[bytes, ...], content: bytes, random: Random) -> bytes:
    """Change one value and keep the form; damage the bytes of what has no such form."""
    try:
        load, dump = FORMS[suffix]
        tree = load(content)
        _change_tree(tree, random)
        return dump(tree)
    except Exception:  # what cannot be read or written so: of many types
        return _damage(content, random, tokens)


def _change_tree(tree: Any, random: Random) -> None:
    places = list(_places(tree))
    holder, key = random.choice(places)
    kind = random.randint(0, 4)
    if kind == 0:
        del holder[key]
    elif kind == 1:
        other, its = random.choice(places)
        holder[key] = json.loads(json.dumps(other[its]))  # a copy: a tree has no circles
    elif kind == 2 and isinstance(holder, dict):
        holder[random.choice([its for _, its in places if isinstance(its, str)])] = holder.pop(key)
    elif kind == 3 and isinstance(holder[key], int | float):
        holder[key] *= random.choice((-1, 0.5, 0.99, 1.01, 2, 10, 1e3, 1e9, 1e-9))
    else:
        holder[key] = random.choice(_ODD_VALUES)


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every table and list with each of its keys or indices."""
    for key in list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ():
        yield tree, key
        yield from _places(tree[key])


class Reader(NamedTuple):
    """A reader of files, and files to try it on."""

    suffix: str
    valid: Callable[[], tuple[bytes, ...]]
    """Contents of valid files, to be damaged."""
    check: Callable[[Path, bytes], Any]
    """Have a content read in a folder: what it gives, or None where it refuses; any error is a broken promise."""
    tokens: tuple[bytes, ...] = ()
    """Words of the file's language."""


def attempt(read: Callable[[Path], Any], path: Path, refusal: type[Exception]) -> Any:
    """Return what a reader gives, or None where it refuses with its own error, which names the file."""
    try:
        return read(path)
    except refusal as error:
        complaint = str(error)
    assert str(path) in complaint, f"the file is not named: {complaint[:500]}"
    return None


def _file(folder: Path, content: bytes, suffix: str) -> Path:
    path = folder / f"tried{suffix}"
    path.write_bytes(content)
    return path


def _scenario(folder: Path, content: bytes) -> Scenario | None:
    """A scenario that is read can be built again from its values, and saved."""
    found: Scenario | None = attempt(Scenario.load, _file(folder, content, ".toml"), ScenarioError)
    if found is not None:
        assert Scenario.model_validate(found.model_dump()) == found
        found.save(folder / "again.toml")
        assert Scenario.load(folder / "again.toml") == found
    return found


def _measurements(folder: Path, content: bytes) -> Any:
    """Measurements that are read are as many in each column, and within the column's limits, or missing."""
    table = attempt(read_measurements, _file(folder, content, ".csv"), WorkshopError)
    if table is not None:
        for name, values in table.columns.items():
            assert values.shape == table.lines.shape
            assert (np.isnan(values) | (COLUMNS[name].low <= values) & (values <= COLUMNS[name].high)).all()
        assert table.edges is None or table.edges.shape == table.lines.shape
    return table


def _results(folder: Path, content: bytes) -> Result | Trajectories | None:
    """Results and trajectories that are read are written and read again alike; compressed ones are known by how they begin."""
    path = _file(folder, content, ".json.xz" if content.startswith(b"\xfd7zXZ\0") else ".json")
    found: Result | Trajectories | None = None
    for kind in (Result, Trajectories):
        part = attempt(partial(read_part, kind), path, ResultError)
        if part is not None:
            found = part
            write_part(part, folder / "again.json")
            assert read_part(kind, folder / "again.json") == part
    return found


def _agent(folder: Path, content: bytes) -> agent_file.AgentFile | None:
    """An agent's file that is read has an outline that another process can be sent."""
    file: agent_file.AgentFile | None = attempt(agent_file.read, _file(folder, content, ".onnx"), ValueError)
    if file is not None:
        _, outline = plain_graph.read(content)
        sent = json.dumps(outline._asdict()).encode()
        assert TypeAdapter(plain_graph.Outline).validate_json(sent, strict=True) == outline
    return file


def _program(folder: Path, content: bytes) -> Any:
    """An NC program that is read can be written and read again."""
    found = attempt(read_file, _file(folder, content, ".mpf"), NcError)
    assert found is None or read(write(found)) == found
    return found


def smallest(folder: Path, pattern: str) -> list[Path]:
    """Return the files of a pattern, the smallest first."""
    return sorted(folder.glob(pattern), key=lambda path: (path.stat().st_size, path))


def small_result() -> dict[str, Any]:
    """Return the smallest result that ships, of three seeds, as JSON has it."""
    whole = read_result(next(path for path in smallest(_RESULTS, "*/*/*.json.xz") if path.name != "trajectories.json.xz"))
    episodes = {name: np.array(values[:3]) for name, values in whole.episodes.items()}
    task = whole.task.model_copy(update={"seeds": whole.task.seeds[:3]})
    values: dict[str, Any] = json.loads(Result.of(task, whole.policy, episodes).model_dump_json(by_alias=True))
    return values


def _valid_results() -> tuple[bytes, ...]:
    trajectories = json.loads(lzma.decompress(smallest(_RESULTS, "*/*/trajectories.json.xz")[0].read_bytes()))
    (episode, *_) = trajectories["episodes"]
    episode["series"] = {name: column[:2] for name, column in episode["series"].items()}
    result = json.dumps(small_result()).encode()
    return result, json.dumps(trajectories | {"episodes": [episode]}).encode(), lzma.compress(result, preset=0)


def _valid_scenarios() -> tuple[bytes, ...]:
    own = b'base = "forging"\nname = "mine"\n[limits]\npower = 11.0\n[workpiece]\nbars = 3\n'
    return Scenario.load("override").to_toml().encode(), own


def _valid_measurements() -> tuple[bytes, ...]:
    own = b'edge,cutting_speed,feed,depth_of_cut,time,wear\r\n"a, 1",150,.3,2,1e1,0.1\r\n,120,0.2,2.5,,\r\n'
    return (ROOT / "docs" / "examples" / "cuts.csv").read_bytes(), own


_TOML = (b'"""', b"'''", b"[[", b"1979-05-27T07:32:00Z", b"inf", b"0x7f", b"1_000", b"\\u0000", b"base", b"\n[control]\n")
_CSV = tuple(name.encode() for name in (*COLUMNS, EDGE, "\r\n", "\ufeff", "1e5", '"', '""', ";", "\t", "1,5", "+.5"))
_NC = tuple(
    b"G00 |G01 |G95 |G96 |M00|M03|M05|M30|LIMS=|STOPRE|FCTDEF(|SYNFCT(|ID=| DO | WHENEVER | AND |$AC_OVR|$AC_PARAM[1]|"
    b"$AA_LOAD[S1]|;|\n|\r|N999 |X|Z-|S|F0.001|(|)|+|-|*|/|<=|>=".split(b"|")
)
READERS = {
    "scenario": Reader(".toml", _valid_scenarios, _scenario, _TOML),
    "measurements": Reader(".csv", _valid_measurements, _measurements, _CSV),
    "results": Reader(".json", _valid_results, _results),
    "agent": Reader(".onnx", lambda: (smallest(ROOT / "agents", "*/*/*.onnx")[0].read_bytes(),), _agent),
    "program": Reader(".mpf", lambda: (PROGRAM, PROGRAM_WITH_LAW), _program, _NC),
}
