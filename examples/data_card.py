"""Cards of a data set: README.md and croissant.json, with a table of the episodes.

A hub shows the first; the second holds metadata in Croissant 1.1. Croissant cannot read HDF5, so
the metadata hold tables of what lies in Minari's file, and episodes.csv one of the episodes.
"""

import csv
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

TERMS = (
    "annotation arrayShape citeAs column containedIn equivalentProperty excludes extract field "
    "fileObject fileProperty fileSet format includes isArray isLiveDataset jsonPath key md5 "
    "parentField path readLines recordSet references regex repeated replace samplingRate sdVersion "
    "separator source subField transform unArchive value"
)
"""Croissant's terms. Its library warns if a context lacks one."""
CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
} | {term: f"cr:{term}" for term in TERMS.split()}
CONFORMS_TO = [f"http://mlcommons.org/croissant/{version}" for version in ("1.1", "RAI/1.0")]
LICENCE = "https://spdx.org/licenses/MIT.html"
RAI = {
    "dataCollection": "Synthetic: policies played a simulation of a lathe. "
    "Nothing was measured on a machine.",
    "dataBiases": "States are those that the named policies visit; others are rare or absent. "
    "One lathe, one steel and one insert, or a family of lathes, as the description says.",
    "dataLimitations": "The simulation leaves out collisions, chatter and chips, and its laws come "
    "from few cuts. Do not control a machine with what was learned from these data unless people "
    "responsible for it have reviewed it.",
    "dataUseCases": "Offline reinforcement learning and imitation, scored in the same simulation.",
    "dataSocialImpact": "Faster research on machining. "
    "Advice for real machines would need measurements of them.",
    "personalSensitiveInformation": "None.",
}
"""Responsible-AI fields by name."""
CARD = """---
license: mit
pretty_name: {name}
task_categories: [reinforcement-learning]
tags: [minari, offline-rl, gymnasium, machining]
---

# {name}

{description} Minari's format; {total_episodes} episodes, {total_steps} steps, \
seeds {first_seed} to {last_seed}, {seeds_are}.
Standard deviation of the noise on actions: {action_noise}. SHA-256 of all arrays: `{checksum}`.

```python
import minari

dataset = minari.load_dataset("{name}")  # in a folder below MINARI_DATASETS_PATH
env = dataset.recover_environment()  # pip install rough-turning
```

"""


FORMATS = {
    ".csv": "text/csv",
    ".hdf5": "application/x-hdf5",
    ".json": "application/json",
}
EPISODES_FILE = "episodes.csv"


class Column(NamedTuple):
    """A column of a table."""

    name: str
    data_type: str  # of schema.org
    meaning: str


class Table(NamedTuple):
    """A table that the metadata describe; its first column is its key."""

    name: str
    meaning: str
    columns: tuple[Column, ...]


class Episode(NamedTuple):
    """A row of the table of episodes."""

    episode: int
    seed: int
    behaviour: str
    steps: int
    total_reward: float  # [s]


class ObservationEntry(NamedTuple):
    """A row of the table of observation entries."""

    place: int
    name: str
    meaning: str
    low: float
    high: float


class StoredArray(NamedTuple):
    """A row of the table of arrays."""

    name: str
    path: str
    dtype: str
    shape: str
    meaning: str


EPISODES = Table(
    "episodes",
    "One row per episode.",
    (
        Column("episode", "sc:Integer", "number of the episode in Minari's file"),
        Column("seed", "sc:Integer", "seed that resets the environment to the episode"),
        Column("behaviour", "sc:Text", "policy that acts"),
        Column("steps", "sc:Integer", "number of steps"),
        Column("total_reward", "sc:Float", "sum of the rewards [s of machine time]"),
    ),
)
OBSERVATION = Table(
    "observation",
    "Entries of an observation, in order.",
    (
        Column("place", "sc:Integer", "index in the observation, from 0"),
        Column("name", "sc:Text", "name of the entry"),
        Column("meaning", "sc:Text", "what it is, and its scale"),
        Column("low", "sc:Float", "lowest value"),
        Column("high", "sc:Float", "highest value"),
    ),
)
ARRAYS = Table(
    "arrays",
    "Arrays of an episode in Minari's HDF5 file; N is the number of the episode.",
    (
        Column("name", "sc:Text", "name of the array"),
        Column("path", "sc:Text", "path in the file"),
        Column("dtype", "sc:Text", "type of the numbers"),
        Column("shape", "sc:Text", "shape"),
        Column("meaning", "sc:Text", "what it holds"),
    ),
)


def write(
    folder: Path,
    metadata: Mapping[str, Any],
    checksum: str,
    episodes: Sequence[Episode],
    observation: Sequence[ObservationEntry],
    action_size: int,
) -> None:
    """Write both cards of a data set, and the table of its episodes, into its folder.

    Args:
        folder: folder of the data set.
        metadata: Minari's metadata.
        checksum: SHA-256 of the arrays.
        episodes: rows of the table of episodes.
        observation: entries of an observation, in order.
        action_size: number of entries of an action.
    """
    name = metadata["dataset_id"]
    rows = "".join(f"* **{field}.** {text}\n" for field, text in RAI.items())
    (folder / "README.md").write_text(
        CARD.format(name=name, checksum=checksum, **metadata) + rows, "utf-8"
    )
    with (folder / EPISODES_FILE).open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(Episode._fields)
        table.writerows(episodes)
    croissant = {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS_TO,
        "name": name,
        "description": metadata["description"],
        "license": LICENCE,
        "version": "0.0.0",
        "creator": {"@type": "Organization", "name": "The RoughTurning authors"},
        "distribution": _files(folder),
        "recordSet": [
            _record_set(EPISODES, file=EPISODES_FILE),
            _record_set(ARRAYS, rows=_arrays(len(observation), action_size)),
            _record_set(OBSERVATION, rows=observation),
        ],
    } | {f"rai:{field}": text for field, text in RAI.items()}
    (folder / "croissant.json").write_text(json.dumps(croissant, indent=1) + "\n", "utf-8")


def _files(folder: Path) -> list[dict[str, Any]]:
    """Return the descriptions of a data set's files."""
    files = []
    for path in [folder / EPISODES_FILE, *sorted(folder.glob("data/*"))]:
        files.append(
            {
                "@type": "cr:FileObject",
                "@id": path.name,
                "name": path.name,
                "contentUrl": path.relative_to(folder).as_posix(),
                "contentSize": f"{path.stat().st_size} B",
                "encodingFormat": FORMATS[path.suffix],
                "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
            }
        )
    return files


def _arrays(observation_size: int, action_size: int) -> list[StoredArray]:
    """Return the rows of the table of arrays."""
    return [
        StoredArray(
            name="observations",
            path="episode_N/observations",
            dtype="float32",
            shape=f"steps + 1, {observation_size}",
            meaning="observations, with that after the last step",
        ),
        StoredArray(
            name="actions",
            path="episode_N/actions",
            dtype="float32",
            shape=f"steps, {action_size}",
            meaning="actions, -1 to 1",
        ),
        StoredArray(
            name="rewards",
            path="episode_N/rewards",
            dtype="float64",
            shape="steps",
            meaning="rewards [s of machine time]",
        ),
        StoredArray(
            name="terminations",
            path="episode_N/terminations",
            dtype="bool",
            shape="steps",
            meaning="true at the last step if the episode terminates",
        ),
        StoredArray(
            name="truncations",
            path="episode_N/truncations",
            dtype="bool",
            shape="steps",
            meaning="true at the last step if the episode is truncated",
        ),
    ]


def _record_set(
    table: Table, file: str | None = None, rows: Sequence[tuple[Any, ...]] = ()
) -> dict[str, Any]:
    """Return the description of a table whose rows are in a CSV file, or are given."""
    fields = []
    for column in table.columns:
        field: dict[str, Any] = {
            "@type": "cr:Field",
            "@id": f"{table.name}/{column.name}",
            "name": column.name,
            "description": column.meaning,
            "dataType": column.data_type,
        }
        if file is not None:
            field["source"] = {
                "fileObject": {"@id": file},
                "extract": {"column": column.name},
            }
        fields.append(field)
    record_set: dict[str, Any] = {
        "@type": "cr:RecordSet",
        "@id": table.name,
        "name": table.name,
        "description": table.meaning,
        "key": {"@id": fields[0]["@id"]},
        "field": fields,
    }
    if rows:
        names = [field["@id"] for field in fields]
        record_set["data"] = [dict(zip(names, row, strict=True)) for row in rows]
    return record_set
