"""The site and its tutorials: what they say works, and links lead somewhere."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.walking import ROOT, Smaller, copy_to, walk

SMALLER: Smaller = {
    "python -m train.ppo": ("--intervals 20000", {}),
    "python -m baselines.tune": ("--draws 1 --trials 2", {"rough_turning": "short.toml"}),
    "python -m leaderboard run --policies steady_load": ("--draws 2 --scenario short.toml", {}),
    "python -m leaderboard run": ("--draws 2", {}),
}
SHORT = 'base = "rough_turning"\nname = "short"\n[control]\ntime_limit = 0.2\n'


@pytest.mark.parametrize("page", sorted(path.name for path in (ROOT / "docs" / "tutorials").glob("*.md")))
def test_a_tutorial_can_be_walked(page: str, tmp_path: Path) -> None:
    copy_to(tmp_path)
    (tmp_path / "short.toml").write_text(SHORT)
    walk((ROOT / "docs" / "tutorials" / page).read_text("utf-8"), tmp_path, SMALLER)


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path)]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    for page in ("index.html", "tasks/index.html", "scenario/index.html", "api/index.html", "leaderboard-page.html"):
        text = (tmp_path / page).read_text("utf-8")
        assert "RoughTurning" in text
        assert "fonts.googleapis.com" not in text
