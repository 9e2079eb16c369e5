"""Print the requirements of both distributions, and of the extras that are named.

    python tools/requirements.py benchmark test

Only the standard library is needed: this runs before anything is installed.
"""

import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECTS = (ROOT / "pyproject.toml", ROOT / "shop" / "pyproject.toml")


def requirements(extras: list[str]) -> list[str]:
    """Return the requirements in the order of the files, without the project's own distributions.

    Args:
        extras: names of extras, each of which at least one of the distributions must have.

    Raises:
        ValueError: no distribution has an extra of that name.
    """
    needed = []
    unknown = set(extras)
    for path in PROJECTS:
        project = tomllib.loads(path.read_text("utf-8"))["project"]
        needed += project["dependencies"]
        for extra in extras:
            if extra in project["optional-dependencies"]:
                needed += project["optional-dependencies"][extra]
                unknown.discard(extra)
    if unknown:
        raise ValueError(f"no distribution has the extra {', '.join(sorted(unknown))}")
    return [need for need in needed if not need.startswith("rough-turning")]


if __name__ == "__main__":
    print(*requirements(sys.argv[1:]), sep="\n")
