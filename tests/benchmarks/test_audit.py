"""The audit of what is installed."""

from importlib.metadata import Distribution, PathDistribution
from pathlib import Path

import pytest

from benchmarks import audit


def installed(folder: Path, metadata: str, record: str = "") -> Distribution:
    information = folder / "made_up-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text(f"Metadata-Version: 2.4\nName: made-up\nVersion: 1.0\n{metadata}\n")
    (information / "RECORD").write_text(record)
    return PathDistribution(information)


@pytest.mark.parametrize(
    ("metadata", "told", "allowed"),
    [
        ("License-Expression: BSD-3-Clause", "BSD-3-Clause", True),
        ("Classifier: License :: OSI Approved :: MIT License", "MIT License", True),
        ("License: Apache-2.0", "Apache-2.0", True),
        ("License: Proprietary", "Proprietary", False),
        ("License-Expression: AGPL-3.0-only", "AGPL-3.0-only", False),
        ("License: UNKNOWN", "", False),
        ("Summary: MIT", "", False),
        ("License-Expression: MIT AND GPL-3.0-only", "MIT AND GPL-3.0-only", False),
        ("License-Expression: BSD-3-Clause AND GPL-3.0-or-later WITH GCC-exception-3.1", None, True),
    ],
)
def test_licences_are_read_and_judged(metadata: str, told: str | None, allowed: bool, tmp_path: Path) -> None:
    found = audit.licence(installed(tmp_path, metadata))
    assert told is None or found == told
    assert audit.allowed(found) == allowed


def test_a_licence_may_stand_in_its_file_alone(tmp_path: Path) -> None:
    found = installed(tmp_path, "License-File: LICENSE\nLicense-File: NOTICE")
    folder = tmp_path / "made_up-1.0.dist-info" / "licenses"
    folder.mkdir()
    (folder / "LICENSE").write_text("\nMIT License\n\nCopyright\n")
    (folder / "NOTICE").write_text("GNU General Public License\n")
    assert audit.licence(found) == "MIT License, GNU General Public License"
    assert not audit.allowed(audit.licence(found))


def test_what_has_been_changed_is_named(tmp_path: Path) -> None:
    for name in ("whole.py", "changed.py"):
        (tmp_path / name).write_text("one")
    digest = "sha256=dpLDrTVAu4A8Ags67mbNiIcSMjTqDG5xQ8Ct1z_0Me0"
    wrong = digest[:-3] + "abc"
    record = f"whole.py,{digest},3\nchanged.py,{wrong},3\nmissing.py,{digest},3\nmade_up-1.0.dist-info/RECORD,,\n"
    complaints = list(audit.changed(installed(tmp_path, "", record)))
    assert complaints == [
        f"{tmp_path / 'changed.py'} has been changed since it was installed",
        f"{tmp_path / 'missing.py'} is missing",
    ]


def test_all_that_the_project_needs_is_found_with_what_that_needs() -> None:
    found = audit.closure([audit.everything()])
    assert {"rough-turning", "gymnasium", "numba", "llvmlite", "torch", "pytest"} <= found.keys()
    assert "torch" not in audit.closure([audit.PROJECT])


def test_extras_of_what_is_needed_are_needed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    inside = {"whole": "Requires-Dist: part; extra == 'more'\nRequires-Dist: other; extra == 'most'", "part": "", "other": ""}
    for name in inside:
        (tmp_path / name).mkdir()
    found = {name: installed(tmp_path / name, needs) for name, needs in inside.items()}
    monkeypatch.setattr(audit, "distribution", found.__getitem__)
    assert audit.closure(["whole"]).keys() == {"whole"}
    assert audit.closure(["whole", "whole[more]"]).keys() == {"whole", "part"}


def test_vulnerabilities_are_told_from_what_could_not_be_looked_up(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    hole = {"id": "CVE-1", "fix_versions": ["1.1"], "aliases": []}
    report = [{"name": "holed", "version": "1.0", "vulns": [hole]}, {"name": "unheard", "skip_reason": "not there"}]
    assert audit.read(report) == (["holed 1.0: CVE-1, mended in 1.1"], ["unheard"])
    monkeypatch.setattr(audit.importlib.util, "find_spec", lambda name: object())
    monkeypatch.setattr(audit, "vulnerable", lambda installed: ([], list(installed)))
    assert audit.look_up({"unheard": "1.0"}) == []
    assert "none looked up" in capsys.readouterr().err
