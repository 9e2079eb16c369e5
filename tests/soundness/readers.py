"""Readers of files from elsewhere, with what each promises, and damaged files for them.

A reader gives what the file may hold, or an error of its own that names the file. Most damaged
files are valid ones in which bytes are cut out, put in or doubled. Others keep their form, but one
value is odd, missing or in another place. The rest are bytes of any kind.
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

from leaderboard.agents import agent_file, network
from leaderboard.agents.messages import Outline
from leaderboard.result import Result, ResultError, ResultFile, read_part, write_part
from leaderboard.trajectories import Trajectories
from turning_env import Family, Scenario, ScenarioError

ROOT = Path(__file__).parents[2]
_RESULTS = ROOT / "leaderboard" / "results"
_COMPRESSED = b"\xfd7zXZ\0"  # first bytes of an xz file
_ODD_BYTES = (
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
    # Operators and names of ONNX.
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
SHARE_OF_FORM = 0.8
"""Share of damaged files of a known form that keep it."""


class Form(NamedTuple):
    """How files of a suffix are read as a tree of tables and lists, and written from it."""

    load: Callable[[bytes], Any]
    dump: Callable[[Any], bytes]


FORMS: dict[str, Form] = {
    ".toml": Form(
        load=lambda content: tomllib.loads(content.decode()),
        dump=lambda tree: tomli_w.dumps(tree).encode(),
    ),
    ".json": Form(
        load=json.loads,
        dump=lambda tree: json.dumps(tree).encode(),
    ),
    ".onnx": Form(
        load=lambda content: json_format.MessageToDict(onnx.load_model_from_string(content)),
        dump=lambda tree: json_format.ParseDict(tree, onnx.ModelProto()).SerializeToString(),
    ),
}
"""Forms by suffix."""


def damages(valid: Callable[[], tuple[bytes, ...]], suffix: str = "") -> st.SearchStrategy[bytes]:
    """Return damaged forms of valid files. Of a suffix in ``FORMS``, most keep their form.

    ``valid`` is called when inputs are drawn, as reading the files takes time.
    """
    contents = st.deferred(lambda: st.sampled_from(valid()))
    damaged = st.builds(partial(_damage, suffix), contents, st.randoms(use_true_random=False))
    # One file in ten holds bytes of any kind.
    choices = [damaged] * 9
    choices.append(st.binary(max_size=300))
    return st.one_of(choices)


def _damage(suffix: str, content: bytes, random: Random) -> bytes:
    """Change one value and keep the form, or damage the bytes.

    Bytes are also damaged if the content cannot be read, or the changed tree not be written.
    """
    if suffix in FORMS and random.random() < SHARE_OF_FORM:
        form = FORMS[suffix]
        try:
            tree = form.load(content)
            _change_tree(tree, random)
            return form.dump(tree)
        except Exception:  # of many types
            pass
    for _ in range(random.randint(1, 4)):
        content = _damage_bytes(content, random)
    return content


def _damage_bytes(content: bytes, random: Random) -> bytes:
    """Put odd bytes, any bytes or a copy of some in the place of some bytes, or between two."""
    place = random.randint(0, len(content))
    start = random.randint(0, len(content))
    end = min(place + random.choice((0, 0, 1, 1, 4, 40, len(content))), len(content))
    odd = random.choice(_ODD_BYTES)
    any_bytes = random.randbytes(random.randint(0, 6))
    copied = content[start : start + random.randint(0, 60)]
    return content[:place] + random.choice((odd, any_bytes, copied)) + content[end:]


class Place(NamedTuple):
    """A value's place in a tree."""

    holder: Any  # the table or list that holds it
    key: Any  # or index

    @property
    def value(self) -> Any:
        """Return the value."""
        return self.holder[self.key]


def _change_tree(tree: Any, random: Random) -> None:
    """Delete a value, put a copy of another in its place, scale it, or make it odd."""
    places = list(_places(tree))
    place = random.choice(places)
    source = random.choice(places)
    change = random.choice(("delete", "copy", "scale", "replace"))
    if change == "delete":
        del place.holder[place.key]
    elif change == "copy":
        place.holder[place.key] = json.loads(json.dumps(source.value))
    elif change == "scale" and isinstance(place.value, int | float):
        place.holder[place.key] *= random.choice((-1, 0.5, 0.99, 1.01, 2, 10, 1e3, 1e9, 1e-9))
    else:
        place.holder[place.key] = random.choice(_ODD_VALUES)


def _places(tree: Any) -> Iterator[Place]:
    """Yield the place of every value in tables and lists."""
    keys: list[Any] = []
    if isinstance(tree, dict):
        keys = list(tree)
    elif isinstance(tree, list):
        keys = list(range(len(tree)))
    for key in keys:
        yield Place(tree, key)
        yield from _places(tree[key])


def attempt(read: Callable[[Path], Any], path: Path, refusal: type[Exception]) -> Any:
    """Return what a reader gives, or None if it refuses the file.

    It must refuse with its own error, which names the file.
    """
    try:
        return read(path)
    except refusal as error:
        complaint = str(error)
    assert str(path) in complaint, f"the file is not named: {complaint[:500]}"
    return None


def _check_scenario(scenario: Scenario, folder: Path) -> None:
    """Check that a scenario is the same after it was written."""
    assert Scenario.model_validate(scenario.model_dump()) == scenario
    scenario.save(folder / "again.toml")
    assert Scenario.load(folder / "again.toml") == scenario


def _check_family(family: Family, folder: Path) -> None:
    """Check that a family is the same after it was sent, and that its jobs are scenarios."""
    assert Family.load(family.portable()) == family
    job = family.job(3)
    assert np.isfinite(job.context).all()
    assert Scenario.load(job.scenario.portable()) == job.scenario


def _check_part(part: ResultFile | Trajectories, folder: Path) -> None:
    """Check that results or trajectories are the same after they were written."""
    write_part(part, folder / "again.json")
    assert read_part(type(part), folder / "again.json") == part


def _check_agent(file: agent_file.AgentFile, folder: Path) -> None:
    """Check that the outline of an agent can be sent to another process."""
    _, outline = network.read((folder / "tried.onnx").read_bytes())
    sent = json.dumps(outline._asdict()).encode()
    assert TypeAdapter(Outline).validate_json(sent, strict=True) == outline


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
    """Return the smallest trajectories that ship, of one episode of two steps."""
    path = smallest(_RESULTS, "*/*/trajectories.json.xz")[0]
    trajectories = json.loads(lzma.decompress(path.read_bytes()))
    episode = trajectories["episodes"][0]
    episode["series"] = {name: column[:2] for name, column in episode["series"].items()}
    return json.dumps(trajectories | {"episodes": [episode]}).encode()


class Reader(NamedTuple):
    """A reader of files, and files to try it on."""

    suffix: str
    read: Callable[[Path], Any]
    refusal: type[Exception]
    valid: Callable[[], tuple[bytes, ...]]
    """Return the contents of valid files, to be damaged."""
    check_content: Callable[[Any, Path], None]
    """Check what must hold for all that is read, given the file's folder."""

    def check(self, folder: Path, content: bytes) -> Any:
        """Return what is read from a content, or None if it is refused.

        Any error but the reader's own is a broken promise.
        """
        name = f"tried{self.suffix}"
        if content.startswith(_COMPRESSED):
            name += ".xz"
        path = folder / name
        path.write_bytes(content)
        value = attempt(self.read, path, self.refusal)
        if value is not None:
            self.check_content(value, folder)
        return value


_OWN_SCENARIO = b'base = "forging"\nname = "mine"\n[limits]\npower = 11.0\n[workpiece]\nbars = 3\n'
_OWN_FAMILY = b"""
base = "shift"
jobs = 8
held_out_jobs = 8
shown = ["hardness"]

[variables]
size = { uniform = [90.0, 110.0], unit = "mm", source = "assumption" }

[variables.hardness]
log_normal = [1.0, 0.1]
unit = "-"
source = "assumption"
truth = { log_normal = [1.0, 0.05] }

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


def _valid_scenarios() -> tuple[bytes, ...]:
    return Scenario.load("override").to_toml().encode(), _OWN_SCENARIO


def _valid_results() -> tuple[bytes, ...]:
    return small_result(), lzma.compress(small_result(), preset=0)


def _valid_agents() -> tuple[bytes, ...]:
    return (smallest(ROOT / "agents", "*/*/*.onnx")[0].read_bytes(),)


READERS = {
    "scenario": Reader(
        suffix=".toml",
        read=Scenario.load,
        refusal=ScenarioError,
        valid=_valid_scenarios,
        check_content=_check_scenario,
    ),
    "family": Reader(
        suffix=".toml",
        read=Family.load,
        refusal=ScenarioError,
        valid=lambda: (_OWN_FAMILY,),
        check_content=_check_family,
    ),
    "result": Reader(
        suffix=".json",
        read=partial(read_part, ResultFile),
        refusal=ResultError,
        valid=_valid_results,
        check_content=_check_part,
    ),
    "trajectories": Reader(
        suffix=".json",
        read=partial(read_part, Trajectories),
        refusal=ResultError,
        valid=lambda: (_small_trajectories(),),
        check_content=_check_part,
    ),
    "agent": Reader(
        suffix=".onnx",
        read=agent_file.read,
        refusal=ValueError,
        valid=_valid_agents,
        check_content=_check_agent,
    ),
}
