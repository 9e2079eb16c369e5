"""What is installed beside the project: licences, files as they were published, pinned versions, known vulnerabilities.

Reads what the installed packages say of themselves; looks nothing up, but for vulnerabilities, where pip-audit is installed.
The exit status is 1 if a licence is not one of the allowed, or a file is not what its package's record says.

    python -m benchmarks.audit
    python -m benchmarks.audit --constraints constraints.txt
"""

import argparse
import base64
import hashlib
import importlib.util
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

from turning_env.console import described, exits

PROJECT = "rough-turning"
ALLOWED = re.compile(
    r"MIT|BSD|Apache|\bPSF|Python Software Foundation|\bISC\b|MPL|Mozilla Public|HPND|Zlib|CC0|Unlicense|LGPL|Lesser General",
    re.IGNORECASE,
)
"""Licences under which the project may be used and passed on beside them; LGPL and MPL as nothing of them is changed."""


REFUSED = re.compile(r"\bA?GPL(?!\S* WITH )|Affero|(?<!Lesser )General Public|Proprietary|Commercial", re.IGNORECASE)
"""What a licence must not name beside an allowed one."""


def allowed(told: str) -> bool:
    """Whether a licence is one of the allowed."""
    return ALLOWED.search(told) is not None and REFUSED.search(told) is None


def closure(roots: Iterable[str]) -> dict[str, Distribution]:
    """Installed distributions that the named ones need, with all their extras' needs, and what these need in turn."""
    found: dict[str, Distribution] = {}
    waiting = [(name, True) for name in roots]
    while waiting:
        name, extras = waiting.pop()
        key = re.sub(r"[-_.]+", "-", name).lower()
        if key in found:
            continue
        try:
            found[key] = distribution(name)
        except PackageNotFoundError:
            continue  # of an extra that is not installed, or of another platform
        for text in found[key].requires or []:
            needed = Requirement(text)
            if extras or needed.marker is None or needed.marker.evaluate({"extra": ""}):
                waiting.append((needed.name, False))
    return found


def licence(found: Distribution) -> str:
    """What a distribution says its licence is; empty if it says nothing."""
    data = found.metadata
    classified = [text.rpartition(" :: ")[2] for text in data.get_all("Classifier") or [] if text.startswith("License ::")]
    expression, said = ((data.get_all(name) or [""])[0] for name in ("License-Expression", "License"))
    told = (expression, *classified, said.strip().partition("\n")[0])
    return next((text for text in told if text and text not in ("OSI Approved", "UNKNOWN")), "")


def changed(found: Distribution) -> Iterator[str]:
    """Files that are missing or not what the distribution's record says; those without a digest there are passed over."""
    for file in found.files or []:
        if file.hash is None:
            continue
        path = Path(str(file.locate()))
        if not path.is_file():
            yield f"{path} is missing"
            continue
        digest = hashlib.new(file.hash.mode, path.read_bytes()).digest()
        if base64.urlsafe_b64encode(digest).rstrip(b"=").decode() != file.hash.value:
            yield f"{path} has been changed since it was installed"


def pinned(constraints: Path) -> dict[str, str]:
    """Versions of a constraints file by name."""
    lines = (line.partition("#")[0].strip() for line in constraints.read_text("utf-8").splitlines())
    pairs = (line.split("==") for line in lines if "==" in line)
    return {re.sub(r"[-_.]+", "-", name).lower(): version for name, version in pairs}


@exits(checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Audit and print; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.audit", **described(__doc__))
    parser.add_argument("--constraints", type=Path, default=Path("constraints.txt"), help="default: %(default)s")
    parsed = parser.parse_args(arguments)
    versions = pinned(parsed.constraints)
    installed = closure([PROJECT])
    complaints = []
    for name, found in sorted(installed.items()):
        told = licence(found)
        print(f"{name} {found.version}: {told or 'says no licence'}")
        if name != PROJECT and not allowed(told):
            complaints.append(f"{name}: its licence, {told!r}, is not one of the allowed")
        if (wanted := versions.get(name)) is not None and found.version.partition("+")[0] != wanted:
            print(f"note: {name} is pinned to {wanted}", file=sys.stderr)
        complaints += changed(found)
    print(f"{len(installed)} distributions")
    if importlib.util.find_spec("pip_audit") is None:
        print("known vulnerabilities: not checked, as pip-audit is not installed", file=sys.stderr)
    elif subprocess.run([sys.executable, "-m", "pip_audit", "--local", "--progress-spinner", "off"]).returncode:
        complaints.append("pip-audit found vulnerabilities, or could not look for them")
    for complaint in complaints:
        print(complaint)
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
