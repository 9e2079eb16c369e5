"""The wheel: the packages of a user, with their data."""

import zipfile

import pytest

from tests.walking import ROOT
from tools.wheel import built

PACKAGES = ("turning_env", "baselines", "leaderboard")
LEFT_OUT = "leaderboard/results/"  # whole results; what scoring needs of them is packed elsewhere
PACKAGED = ("py", "toml", "json", "xz", "hal", "ini", "tbl", "html", "js", "j2", "css", "typed")
"""Suffixes of the files that a package holds."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    folder = tmp_path_factory.mktemp("wheel")
    return zipfile.ZipFile(built(folder))


def files_of(package: str) -> set[str]:
    """Return the names of the files that a package must bring along."""
    names = set()
    for suffix in PACKAGED:
        for path in (ROOT / package).rglob(f"*.{suffix}"):
            names.add(path.relative_to(ROOT).as_posix())
    return {name for name in names if not name.startswith(LEFT_OUT)}


@pytest.mark.slow
def test_the_wheel_holds_the_packages_of_a_user_and_nothing_else(wheel: zipfile.ZipFile) -> None:
    packaged = {name for name in wheel.namelist() if ".dist-info/" not in name}
    expected = set()
    for package in PACKAGES:
        files = files_of(package)
        assert files
        expected |= files
    assert packaged == expected


@pytest.mark.slow
def test_the_wheel_holds_the_licence(wheel: zipfile.ZipFile) -> None:
    licences = [name for name in wheel.namelist() if name.endswith("licenses/LICENSE")]
    assert len(licences) == 1
    assert wheel.read(licences[0]).startswith(b"MIT License")
