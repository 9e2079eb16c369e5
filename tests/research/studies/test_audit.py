"""Licences are read and judged, and versions compared with the pins."""

from importlib.metadata import PathDistribution
from pathlib import Path

import pytest

from tools.audit import complaints


def installed(folder: Path, metadata: str, **licences: str) -> PathDistribution:
    """Return a made-up distribution with metadata and files of licences."""
    information = folder / "made_up-1.0.dist-info"
    (information / "licenses").mkdir(parents=True)
    lines = ["Metadata-Version: 2.4", "Name: made-up", "Version: 1.0", metadata, ""]
    (information / "METADATA").write_text("\n".join(lines))
    for name, text in licences.items():
        (information / "licenses" / name).write_text(text)
    return PathDistribution(information)


@pytest.mark.parametrize(
    ("metadata", "allowed"),
    [
        ("License-Expression: BSD-3-Clause", True),
        ("Classifier: License :: OSI Approved :: MIT License", True),
        ("License: Apache-2.0", True),
        ("License: Proprietary", False),
        ("License-Expression: AGPL-3.0-only", False),
        ("License: UNKNOWN", False),
        ("License-Expression: MIT AND GPL-3.0-only", False),
        ("License-Expression: GPL-3.0-or-later WITH GCC-exception AND MIT", True),
        ("License-File: LICENSE", True),
        ("License-File: LICENSE\nLicense-File: NOTICE", False),
    ],
)
def test_licences_are_read_and_judged(metadata: str, allowed: bool, tmp_path: Path) -> None:
    distribution = installed(
        tmp_path, metadata, LICENSE="\nMIT License\n", NOTICE="GNU General Public License\n"
    )
    is_allowed = complaints([distribution], {"made-up": "1.0"}) == []
    assert is_allowed == allowed


def test_another_version_is_a_complaint(tmp_path: Path) -> None:
    distribution = installed(tmp_path, "License: MIT")
    pinned_to_another = complaints([distribution], {"made-up": "1.1"})
    assert pinned_to_another == ["made-up is 1.0, but pinned to 1.1"]
    assert complaints([distribution], {}) == ["made-up is 1.0, but not pinned"]
