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


def licence_of(found: Distribution) -> str:
    """Return the licence that a distribution states, or the heads of its licence files; or ""."""
    data = found.metadata
    classified = [
        text.rpartition(" :: ")[2]
        for text in data.get_all("Classifier") or []
        if text.startswith("License ::")
    ]
    expression, said = (
        (data.get_all(name) or [""])[0] for name in ("License-Expression", "License")
    )
    files = data.get_all("License-File") or []
    heads = [
        (found.read_text(f"licenses/{name}") or "").strip().partition("\n")[0] for name in files
    ]
    stated = (expression, *classified, said.strip().partition("\n")[0], ", ".join(heads))
    return next(
        (
            text
            for text in stated
            if text and text not in ("OSI Approved", "DFSG approved", "UNKNOWN")
        ),
        "",
    )


def pinned(constraints: str) -> dict[str, str]:
    """Return the versions by name in the text of a constraints file."""
    return dict(re.findall(r"^([\w.-]+)==([^\s;]+)", constraints, re.MULTILINE))


def complaints(installed: Iterable[Distribution], pins: dict[str, str]) -> list[str]:
    """Print the licence of each distribution, and return the faults of licences and versions."""
    wrong = []
    for name, found in sorted(
        {re.sub(r"[-_.]+", "-", each.name).lower(): each for each in installed}.items()
    ):
        licence, version = (
            licence_of(found),
            found.version.partition("+")[0],
        )  # without the build, as in torch's 2.13.0+cpu
        print(f"{name} {found.version}: {licence or 'states no licence'}")
        if not ALLOWED.search(licence) or REFUSED.search(licence):
            wrong.append(f"{name}: its licence, {licence!r}, is not one of the allowed")
        if name != "rough-turning" and version != pins.get(name):
            wrong.append(
                f"{name} is {version}, but "
                + (f"pinned to {pins[name]}" if name in pins else "not pinned")
            )
    return wrong


@exits(checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Audit and print; return the exit status."""
    argparse.ArgumentParser(prog="python -m tools.audit", **described(__doc__)).parse_args(
        arguments
    )
    wrong = complaints(
        distributions(), pinned(Path("packaging/constraints.txt").read_text("utf-8"))
    )
    print(*wrong, sep="\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
