"""What is published: the environment alone, with its presets."""

import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_the_wheel_holds_the_environment_and_nothing_else(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path], cwd=ROOT, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"turning_env"}
    packaged = {name for name in names if name.startswith("turning_env/")}
    sources = {str(path.relative_to(ROOT)) for end in ("py", "toml") for path in (ROOT / "turning_env").rglob(f"*.{end}")}
    assert packaged == sources
