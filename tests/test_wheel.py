"""What is published: the packages of a user, with their data."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from studies.wheel import built

ROOT = Path(__file__).parents[1]
PACKAGES = {"turning_env", "turning_render", "turning_shop", "turning_nc", "turning_control"}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("wheel"))


def test_the_wheel_holds_the_packages_of_a_user_and_nothing_else(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    names = archive.namelist()
    (licence,) = (name for name in names if name.endswith("licenses/LICENSE"))
    assert archive.read(licence).startswith(b"MIT License")
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == PACKAGES
    packaged = {name for name in names if ".dist-info/" not in name}
    ends = ("py", "toml", "xz", "hal", "ini", "tbl", "html", "js")
    sources = {str(path.relative_to(ROOT)) for end in ends for package in PACKAGES for path in (ROOT / package).rglob(f"*.{end}")}
    assert packaged == sources


@pytest.mark.slow
def test_the_wheel_alone_is_the_environment(wheel: Path, tmp_path: Path) -> None:
    installed, empty = tmp_path / "installed", tmp_path / "empty"
    zipfile.ZipFile(wheel).extractall(installed)  # as an installer does with a wheel that has no scripts
    empty.mkdir()
    code = (
        "import gymnasium, turning_env; env = gymnasium.make('turning_env:RoughTurning-v0'); env.reset(seed=0); "
        "env.step(env.action_space.sample()); print(turning_env.__file__)"
    )
    # Interpreted: here it matters that it runs, and compiling would take half a minute.
    variables = os.environ | {"PYTHONPATH": str(installed), "NUMBA_DISABLE_JIT": "1"}
    finished = subprocess.run([sys.executable, "-c", code], cwd=empty, env=variables, capture_output=True, text=True)
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout.strip() == str(installed / "turning_env" / "__init__.py")
