"""What is installed beside the project: licences, files as they were published, pinned versions, known vulnerabilities.

Reads what the installed packages say of themselves; looks nothing up, but for vulnerabilities, where pip-audit is installed
(``make audit`` does so). The exit status is 1 if a licence is not one of the allowed, a file is not what its package's record
says, a pin has no hash, or a vulnerability is known; not if vulnerabilities could not be looked up, which is said.

    python -m benchmarks.audit
    python -m benchmarks.audit --constraints constraints.txt
"""

import argparse
import base64
import hashlib
import importlib.util
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, NamedTuple

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

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
    """Installed distributions by name: those that the requirements name, with their extras' needs, and these' needs in turn."""
    found: dict[str, Distribution] = {}
    seen: set[tuple[str, str]] = set()
    waiting = [Requirement(text) for text in roots]
    while waiting:
        wanted = waiting.pop()
        name = canonicalize_name(wanted.name)
        for extra in {"", *wanted.extras} - {extra for other, extra in seen if other == name}:
            seen.add((name, extra))
            try:
                found[name] = distribution(name)
            except PackageNotFoundError:
                continue  # of an extra that is not installed, or of another platform
            needs = [Requirement(text) for text in found[name].requires or []]
            waiting += [need for need in needs if need.marker is None or need.marker.evaluate({"extra": extra})]
    return found


def everything() -> str:
    """The project with all its extras, as a requirement."""
    return f"{PROJECT}[{','.join(distribution(PROJECT).metadata.get_all('Provides-Extra') or [])}]"


def published(found: Distribution) -> str:
    """A distribution's version without what names its build, as in torch's ``2.13.0+cpu``."""
    return found.version.partition("+")[0]


def licence(found: Distribution) -> str:
    """What a distribution says its licence is, or else the heads of the licence files in it; empty if it says nothing."""
    data = found.metadata
    classified = [text.rpartition(" :: ")[2] for text in data.get_all("Classifier") or [] if text.startswith("License ::")]
    expression, said = ((data.get_all(name) or [""])[0] for name in ("License-Expression", "License"))
    heads = [
        (found.read_text(f"licenses/{name}") or "").strip().partition("\n")[0] for name in data.get_all("License-File") or []
    ]
    told = (expression, *classified, said.strip().partition("\n")[0], ", ".join(heads))
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


class Pin(NamedTuple):
    """A line of a constraints file."""

    version: str
    hashes: tuple[str, ...]
    """SHA-256 of the files that may be installed."""


def pinned(constraints: Path) -> dict[str, Pin]:
    """Pins of a constraints file by name."""
    text = re.sub(r"\\\n|#.*", "", constraints.read_text("utf-8"))
    pairs = re.findall(r"^([\w.-]+)==([^\s;]+)(.*)$", text, re.MULTILINE)
    return {canonicalize_name(name): Pin(version, tuple(re.findall(r"sha256:(\w+)", rest))) for name, version, rest in pairs}


def vulnerable(installed: Mapping[str, str]) -> tuple[list[str], list[str]]:
    """What pip-audit knows of versions by name: vulnerabilities, and names that it could not look up.

    Raises:
        subprocess.CalledProcessError: it could not look up anything.
    """
    with tempfile.TemporaryDirectory() as folder:
        asked = Path(folder) / "asked.txt"
        asked.write_text("".join(f"{name}=={version}\n" for name, version in installed.items()), "utf-8")
        command = [sys.executable, "-m", "pip_audit", "--no-deps", "--disable-pip", "--progress-spinner", "off", "-f", "json"]
        finished = subprocess.run([*command, "-r", str(asked)], capture_output=True, text=True, check=False)
    try:
        told = json.loads(finished.stdout)["dependencies"]
    except (ValueError, KeyError) as error:
        raise subprocess.CalledProcessError(finished.returncode, command, finished.stdout, finished.stderr) from error
    return read(told)


def read(told: Iterable[Mapping[str, Any]]) -> tuple[list[str], list[str]]:
    """What pip-audit's report says of each package: vulnerabilities, and names that it could not look up."""
    known, unknown = [], []
    for package in told:
        if "skip_reason" in package:
            unknown.append(package["name"])
        for each in package.get("vulns", []):
            mended = ", ".join(each["fix_versions"]) or "no version yet"
            known.append(f"{package['name']} {package['version']}: {each['id']}, mended in {mended}")
    return known, unknown


def look_up(installed: Mapping[str, str]) -> list[str]:
    """Known vulnerabilities of versions by name; says on stderr what could not be looked up."""
    if importlib.util.find_spec("pip_audit") is None:
        print("known vulnerabilities: not looked up, as pip-audit is not installed (make audit)", file=sys.stderr)
        return []
    try:
        known, unknown = vulnerable(installed)
    except subprocess.CalledProcessError as error:
        known, unknown = [], list(installed)
        print((error.stderr or "").strip().rpartition("\n")[2], file=sys.stderr)
    if len(unknown) == len(installed):
        print("known vulnerabilities: none looked up: the service does not answer, or knows none of them", file=sys.stderr)
    else:
        print(f"known vulnerabilities: {len(known)} in {len(installed) - len(unknown)} distributions")
        if unknown:
            print(f"known vulnerabilities: the service does not know {', '.join(sorted(unknown))}", file=sys.stderr)
    return known


@exits(checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Audit and print; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.audit", **described(__doc__))
    parser.add_argument("--constraints", type=Path, default=Path("constraints.txt"), help="default: %(default)s")
    parsed = parser.parse_args(arguments)
    pins = pinned(parsed.constraints)
    installed = closure([everything(), *pins])
    complaints = [f"{name}: pinned without a hash" for name, pin in pins.items() if not pin.hashes]
    for name, found in sorted(installed.items()):
        told = licence(found)
        print(f"{name} {found.version}: {told or 'says no licence'}")
        if name != PROJECT and not allowed(told):
            complaints.append(f"{name}: its licence, {told!r}, is not one of the allowed")
        if name != PROJECT and (name not in pins or published(found) != pins[name].version):
            print(f"note: {name} is {f'pinned to {pins[name].version}' if name in pins else 'not pinned'}", file=sys.stderr)
        complaints += changed(found)
    print(f"{len(installed)} distributions")
    complaints += look_up({name: published(found) for name, found in sorted(installed.items()) if name != PROJECT})
    for complaint in complaints:
        print(complaint)
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
