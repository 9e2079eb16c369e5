"""Cards of a data set: README.md and croissant.json.

A hub shows the first; the second holds metadata in Croissant 1.0.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

CONTEXT = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
}
CONFORMS_TO = [f"http://mlcommons.org/croissant/{name}1.0" for name in ("", "RAI/")]
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


def write(folder: Path, metadata: Mapping[str, Any], checksum: str) -> None:
    """Write both cards of a data set into its folder.

    Args:
        folder: folder of the data set.
        metadata: Minari's metadata.
        checksum: SHA-256 of the arrays.
    """
    name = metadata["dataset_id"]
    rows = "".join(f"* **{field}.** {text}\n" for field, text in RAI.items())
    (folder / "README.md").write_text(
        CARD.format(name=name, checksum=checksum, **metadata) + rows, "utf-8"
    )
    formats = {".hdf5": "application/x-hdf5", ".json": "application/json"}
    files = [
        {
            "@type": "cr:FileObject",
            "@id": path.name,
            "name": path.name,
            "contentUrl": path.relative_to(folder).as_posix(),
            "contentSize": f"{path.stat().st_size} B",
            "encodingFormat": formats[path.suffix],
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        }
        for path in sorted(folder.glob("data/*"))
    ]
    croissant = {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS_TO,
        "name": name,
        "description": metadata["description"],
        "license": LICENCE,
        "version": "0.0.0",
        "creator": {"@type": "Organization", "name": "The RoughTurning authors"},
        "distribution": files,
    } | {f"rai:{field}": text for field, text in RAI.items()}
    (folder / "croissant.json").write_text(json.dumps(croissant, indent=1) + "\n", "utf-8")
