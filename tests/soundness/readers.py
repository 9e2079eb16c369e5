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
from turning_nc.program import Program, read, read_file, write
from turning_nc.words import NcError
from turning_shop import WorkshopError
from turning_shop.headers import COLUMNS
from turning_shop.measurements import Measurements, read_measurements

from leaderboard.result import Result, ResultError, ResultFile, read_part, write_part
from leaderboard.trajectories import Trajectories
from shop.tests.turning_nc.test_program import TEXT
from train.agents import agent_file, network
from turning_env import Family, Scenario, ScenarioError
from turning_env.scoring.sandbox_child import Outline

ROOT = Path(__file__).parents[2]
_RESULTS = ROOT / "leaderboard" / "results"
_COMPRESSED = b"\xfd7zXZ\0"
_ODD = (
    b"",
    b"\0",
    b"\xff",
    b"\n",
    b'"',
    b"[" * 3_000,
    b"{",
    b"9" * 5_000,
    b"1e999",
    b"nan",
    b"-1",
    b"null",
    b"=",
    b",",
    b"(",
)
_ODD_VALUES: tuple[Any, ...] = (
    *(
        None,
        True,
        False,
        0,
        -1,
        1,
        7,
        65_537,
        2**31,
        2**63,
        -(2**63),
        10**400,
        0.0,
        -0.0,
        5e-324,
        1e-12,
        1.5,
        1e30,
        1e308,
    ),
    *(
        float("nan"),
        float("inf"),
        "",
        "nan",
        "../x",
        "\0",
        "\ud800",
        "x" * 300,
        [],
        [[]],
        {},
        {"": None},
    ),
    "If",
    "Loop",
    "Constant",
    "Reshape",
    "Expand",
    "observation",
    "memory",
    "action",
    "ai.onnx",
)
FORMS: dict[str, tuple[Callable[[bytes], Any], Callable[[Any], bytes]]] = {
    ".toml": (
        lambda content: tomllib.loads(content.decode()),
        lambda tree: tomli_w.dumps(tree).encode(),
    ),
    ".json": (json.loads, lambda tree: json.dumps(tree).encode()),
    ".onnx": (
        lambda content: json_format.MessageToDict(onnx.load_model_from_string(content)),
        lambda tree: json_format.ParseDict(tree, onnx.ModelProto()).SerializeToString(),
    ),
}
"""Functions that load a file's content as a tree, and that write the tree, by suffix."""


def damages(valid: Callable[[], tuple[bytes, ...]], suffix: str = "") -> st.SearchStrategy[bytes]:
    """Return damaged forms of valid files, which are read only when inputs are drawn; of a suffix in ``FORMS`` most keep it."""
    contents = st.deferred(lambda: st.sampled_from(valid()))
    damaged = st.builds(partial(_damage, suffix), contents, st.randoms(use_true_random=False))
    return st.one_of(*[damaged] * 9, st.binary(max_size=300))


def _damage(suffix: str, content: bytes, random: Random) -> bytes:
    """Change one value and keep the form; or damage the bytes, also of what cannot be read or written so."""
    if suffix in FORMS and random.random() < 0.8:
        load, dump = FORMS[suffix]
        try:
            tree = load(content)
            _change_tree(tree, random)
            return dump(tree)
        except Exception:  # of many types
            pass
    for _ in range(random.randint(1, 4)):
        place, start = random.randint(0, len(content)), random.randint(0, len(content))
        end = min(place + random.choice((0, 0, 1, 1, 4, 40, len(content))), len(content))
        new = (
            random.choice(_ODD),
            random.randbytes(random.randint(0, 6)),
            content[start : start + random.randint(0, 60)],
        )
        content = content[:place] + random.choice(new) + content[end:]
    return content


def _change_tree(tree: Any, random: Random) -> None:
    """Delete a value, put a copy of another in its place, scale it, or replace it with an odd one."""
    places = list(_places(tree))
    (holder, key), (other, its) = random.choice(places), random.choice(places)
    kind = random.randint(0, 3)
    if kind == 0:
        del holder[key]
    elif kind == 1:
        holder[key] = json.loads(json.dumps(other[its]))
    elif kind == 2 and isinstance(holder[key], int | float):
        holder[key] *= random.choice((-1, 0.5, 0.99, 1.01, 2, 10, 1e3, 1e9, 1e-9))
    else:
        holder[key] = random.choice(_ODD_VALUES)


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Yield every table and list with each of its keys or indices."""
    for key in (
        list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ()
    ):
        yield tree, key
        yield from _places(tree[key])


def attempt(read: Callable[[Path], Any], path: Path, refusal: type[Exception]) -> Any:
    """Return what a reader gives, or None where it refuses with its own error, which names the file."""
    try:
        return read(path)
    except refusal as error:
        complaint = str(error)
    assert str(path) in complaint, f"the file is not named: {complaint[:500]}"
    return None


def _scenario(found: Scenario, folder: Path) -> None:
    assert Scenario.model_validate(found.model_dump()) == found
    found.save(folder / "again.toml")
    assert Scenario.load(folder / "again.toml") == found


def _family(found: Family, folder: Path) -> None:
    assert Family.load(found.portable()) == found
    job = found.job(3)
    assert np.isfinite(job.context).all()
    assert Scenario.load(job.scenario.portable()) == job.scenario


def _measurements(table: Measurements, folder: Path) -> None:
    for name, values in table.columns.items():
        assert values.shape == table.lines.shape
        zero = (values == 0.0) & COLUMNS[name].may_be_zero
        assert (
            np.isnan(values) | zero | (COLUMNS[name].low <= values) & (values <= COLUMNS[name].high)
        ).all()
    assert table.edges is None or table.edges.shape == table.lines.shape


def _part(part: ResultFile | Trajectories, folder: Path) -> None:
    write_part(part, folder / "again.json")
    assert read_part(type(part), folder / "again.json") == part


def _agent(file: agent_file.AgentFile, folder: Path) -> None:
    """Its outline can be sent to another process."""
    _, outline = network.read((folder / "tried.onnx").read_bytes())
    sent = json.dumps(outline._asdict()).encode()
    assert TypeAdapter(Outline).validate_json(sent, strict=True) == outline


def _program(found: Program, folder: Path) -> None:
    assert read(write(found)) == found


def smallest(folder: Path, pattern: str) -> list[Path]:
    """Return the files of a pattern, the smallest first."""
    return sorted(folder.glob(pattern), key=lambda path: (path.stat().st_size, path))


@cache
def small_result() -> bytes:
    """Return the smallest result that ships, of three seeds."""
    whole = read_part(ResultFile, smallest(_RESULTS, "*/*/results.json.xz")[0]).results[0]
    episodes = {name: np.array(values[:3]) for name, values in whole.episodes.items()}
    task = whole.task.model_copy(update={"seeds": whole.task.seeds[:3]})
    file = ResultFile(task=task, results=[Result.of(task, whole.policy, episodes)])
    return file.model_dump_json(by_alias=True).encode()


@cache
def _small_trajectories() -> bytes:
    trajectories = json.loads(
        lzma.decompress(smallest(_RESULTS, "*/*/trajectories.json.xz")[0].read_bytes())
    )
    (episode, *_) = trajectories["episodes"]
    episode["series"] = {name: column[:2] for name, column in episode["series"].items()}
    return json.dumps(trajectories | {"episodes": [episode]}).encode()


class Reader(NamedTuple):
    """A reader of files, and files to try it on."""

    suffix: str
    read: Callable[[Path], Any]
    refusal: type[Exception]
    valid: Callable[[], tuple[bytes, ...]]
    """Contents of valid files, to be damaged."""
    holds: Callable[[Any, Path], None]
    """Assert what holds of all that is read; the folder is that of the file."""

    def check(self, folder: Path, content: bytes) -> Any:
        """Return what a content gives, or None where it is refused; any other error is a broken promise."""
        path = folder / ("tried" + self.suffix + (".xz" if content.startswith(_COMPRESSED) else ""))
        path.write_bytes(content)
        found = attempt(self.read, path, self.refusal)
        if found is not None:
            self.holds(found, folder)
        return found


_OWN_SCENARIO = b'base = "forging"\nname = "mine"\n[limits]\npower = 11.0\n[workpiece]\nbars = 3\n'
_OWN_TABLE = b'edge,cutting_speed,feed,depth_of_cut,time,wear\r\n"a, 1",150,.3,2,1e1,0.1\r\n,120,0.2,2.5,,\r\n'
_OWN_FAMILY = b"""
base = "shift"
jobs = 8
held_out_jobs = 8
shown = ["hardness"]

[variables]
hardness = { log_normal = [1.0, 0.1], unit = "-", source = "assumption", truth = { log_normal = [1.0, 0.05] } }
size = { uniform = [90.0, 110.0], unit = "mm", source = "assumption" }

[tables.machine]
columns = ["rated_power", "torque"]
source = "assumption"
held_out = ["large"]

[tables.machine.rows]
small = [6.5, 200.0]
usual = [7.0, 250.0]
large = [7.5, 300.0]

[tables.machine.truth]
rated_power = { normal = [0.0, 0.01] }

[derived]
ratio = "minimum(hardness, 1.2) / 1.1"

[fields]
"material.power.coefficient" = "0.3034 * hardness ** 0.75"
"workpiece.diameter" = "size"
"limits.power" = "rated_power * exp(-0.1 * ratio)"
"sensors.probe" = false

[hidden]
"mismatch.wear_factor" = "sqrt(hardness)"

[planned]
"control.initial_cutting_speed" = "maximum(0.9 * best_cutting_speed, 60)"

[splits]
train = []
large_machines = ["machine"]
"""
READERS = {
    "scenario": Reader(
        ".toml",
        Scenario.load,
        ScenarioError,
        lambda: (Scenario.load("override").to_toml().encode(), _OWN_SCENARIO),
        _scenario,
    ),
    "family": Reader(".toml", Family.load, ScenarioError, lambda: (_OWN_FAMILY,), _family),
    "measurements": Reader(
        ".csv",
        read_measurements,
        WorkshopError,
        lambda: ((ROOT / "shop" / "examples" / "cuts.csv").read_bytes(), _OWN_TABLE),
        _measurements,
    ),
    "result": Reader(
        ".json",
        partial(read_part, ResultFile),
        ResultError,
        lambda: (small_result(), lzma.compress(small_result(), preset=0)),
        _part,
    ),
    "trajectories": Reader(
        ".json",
        partial(read_part, Trajectories),
        ResultError,
        lambda: (_small_trajectories(),),
        _part,
    ),
    "agent": Reader(
        ".onnx",
        agent_file.read,
        ValueError,
        lambda: (smallest(ROOT / "agents", "*/*/*.onnx")[0].read_bytes(),),
        _agent,
    ),
    "program": Reader(".mpf", read_file, NcError, lambda: (TEXT.encode(),), _program),
}
