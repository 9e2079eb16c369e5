"""The wheel: the packages of a user, with their data."""

import zipfile
from pathlib import Path

import pytest

from tools.wheel import built

ROOT = Path(__file__).parents[1]
PACKAGES = {"turning_env", "baselines"}


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
    ends = ("py", "toml", "json", "xz", "hal", "ini", "tbl", "html", "js", "typed")
    sources = {
        str(path.relative_to(ROOT))
        for end in ends
        for package in PACKAGES
        for path in (ROOT / package).rglob(f"*.{end}")
    }
    assert packaged == sources
