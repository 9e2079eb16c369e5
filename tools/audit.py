"""Check the licences and the versions of the installed packages.

``make audit`` then looks up their known vulnerabilities with pip-audit. The exit status is 1 if a
licence is not allowed, or if a package has another version than ``packaging/constraints.txt`` pins.

    python -m tools.audit
"""

import argparse
import re
import sys
from collections.abc import Iterable, Sequence
from importlib.metadata import Distribution, distributions
from pathlib import Path

from turning_env.console import described, exits

ALLOWED = re.compile(
    r"MIT|BSD|Apache|\bPSF|Python Software Foundation|\bISC\b|MPL|Mozilla Public|HPND|Zlib|CC0"
    r"|Unlicense|LGPL|Lesser General",
    re.IGNORECASE,
)
"""Allowed licences; LGPL and MPL are among them because their code is not changed."""
REFUSED = re.compile(
    r"\bA?GPL(?!\S* WITH )|Affero|(?<!Lesser )General Public|Proprietary|Commercial", re.IGNORECASE
)
"""Licences that must not be named beside an allowed one."""


# Texts in place of a licence that name none.
NO_LICENCES = ("", "OSI Approved", "DFSG approved", "UNKNOWN")


def licence_of(distribution: Distribution) -> str:
    """Return the licence that a distribution states, or the heads of its licence files; or ""."""
    metadata = distribution.metadata
    stated = [_first(metadata.get_all("License-Expression"))]
    for classifier in metadata.get_all("Classifier") or []:
        if classifier.startswith("License ::"):
            stated.append(classifier.rpartition(" :: ")[2])
    stated.append(_head(_first(metadata.get_all("License"))))
    heads = []
    for name in metadata.get_all("License-File") or []:
        heads.append(_head(distribution.read_text(f"licenses/{name}") or ""))
    stated.append(", ".join(heads))
    named = [text for text in stated if text not in NO_LICENCES]
    return _first(named)


def _first(texts: Sequence[str] | None) -> str:
    return texts[0] if texts else ""


def _head(text: str) -> str:
    """Return the first line of a text that is not empty."""
    return text.strip().partition("\n")[0]


def pinned(constraints: str) -> dict[str, str]:
    """Return the versions by name in the text of a constraints file."""
    return dict(re.findall(r"^([\w.-]+)==([^\s;]+)", constraints, re.MULTILINE))


def complaints(installed: Iterable[Distribution], pins: dict[str, str]) -> list[str]:
    """Print the licence of each distribution, and return the faults of licences and versions."""
    by_name = {}
    for distribution in installed:
        name = re.sub(r"[-_.]+", "-", distribution.name).lower()
        by_name[name] = distribution
    wrong = []
    for name, distribution in sorted(by_name.items()):
        licence = licence_of(distribution)
        # Without the build, as in torch's 2.13.0+cpu.
        version = distribution.version.partition("+")[0]
        print(f"{name} {distribution.version}: {licence or 'states no licence'}")
        if not ALLOWED.search(licence) or REFUSED.search(licence):
            wrong.append(f"{name}: its licence, {licence!r}, is not one of the allowed")
        if name != "rough-turning" and version != pins.get(name):
            pin = f"pinned to {pins[name]}" if name in pins else "not pinned"
            wrong.append(f"{name} is {version}, but {pin}")
    return wrong


@exits(checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Audit and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.audit", **described(__doc__))
    parser.parse_args(arguments)
    constraints = Path("packaging/constraints.txt").read_text("utf-8")
    wrong = complaints(distributions(), pinned(constraints))
    print(*wrong, sep="\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
