"""Walks of pages leave the environment alone that they share with the repository."""

import os
import shutil
from pathlib import Path

from tests.walking import ROOT, run, small

REQUIREMENTS = ("pyproject.toml", "shop/pyproject.toml", "packaging/constraints.txt")


def test_new_requirements_of_a_copy_are_not_installed(tmp_path: Path) -> None:
    for name in ("Makefile", *REQUIREMENTS):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    set_up = tmp_path / ".venv" / "run"
    set_up.parent.mkdir()
    set_up.touch()
    # Older than all requirements.
    os.utime(set_up, (0, 0))
    finished = run(small("make setup", {}), tmp_path)
    assert finished.returncode == 0, finished.stderr
    # What installs touches the file.
    assert set_up.stat().st_mtime == 0
