"""Licences are read and judged, and versions compared with the pins."""

from importlib.metadata import PathDistribution
from pathlib import Path

import pytest

from studies import audit


def installed(folder: Path, metadata: str) -> PathDistribution:
    information = folder / "made_up-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text(f"Metadata-Version: 2.4\nName: made-up\nVersion: 1.0\n{metadata}\n")
    return PathDistribution(information)


@pytest.mark.parametrize(
    ("metadata", "licence", "allowed"),
    [
        ("License-Expression: BSD-3-Clause", "BSD-3-Clause", True),
        ("Classifier: License :: OSI Approved :: MIT License", "MIT License", True),
        ("License: Apache-2.0", "Apache-2.0", True),
        ("License: Proprietary", "Proprietary", False),
        ("License-Expression: AGPL-3.0-only", "AGPL-3.0-only", False),
        ("License: UNKNOWN", "", False),
        ("License-Expression: MIT AND GPL-3.0-only", "MIT AND GPL-3.0-only", False),
        ("License-Expression: GPL-3.0-or-later WITH GCC-exception AND MIT", "GPL-3.0-or-later WITH GCC-exception AND MIT", True),
    ],
)
def test_licences_are_read_and_judged(metadata: str, licence: str, allowed: bool, tmp_path: Path) -> None:
    assert audit.licence_of(installed(tmp_path, metadata)) == licence
    assert audit.allowed(licence) == allowed


def test_a_licence_may_stand_in_its_file_alone(tmp_path: Path) -> None:
    found = installed(tmp_path, "License-File: LICENSE\nLicense-File: NOTICE")
    (folder := tmp_path / "made_up-1.0.dist-info" / "licenses").mkdir()
    (folder / "LICENSE").write_text("\nMIT License\n\nCopyright\n")
    (folder / "NOTICE").write_text("GNU General Public License\n")
    assert audit.licence_of(found) == "MIT License, GNU General Public License"


def test_another_version_is_a_complaint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = installed(tmp_path, "License: MIT")
    monkeypatch.setattr(audit, "distributions", lambda: [found])
    for version, status in (("1.0", 0), ("1.1", 1)):
        (tmp_path / "pins.txt").write_text(f"made-up=={version} \\\n    --hash=sha256:0\n")
        assert audit.main(["--constraints", str(tmp_path / "pins.txt")]) == status
        assert ("made-up is 1.0, but pinned to 1.1" in capsys.readouterr().out) == bool(status)
