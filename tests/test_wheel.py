"""The wheel: the packages of a user, with their data."""

import zipfile

import pytest

from tests.walking import ROOT
from tools.wheel import built

PACKAGES = ("turning_env", "baselines")
PACKAGED = ("py", "toml", "json", "xz", "hal", "ini", "tbl", "html", "js", "typed")
"""Ends of the names of files that a package holds."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    return zipfile.ZipFile(built(tmp_path_factory.mktemp("wheel")))


def test_the_wheel_holds_the_packages_of_a_user_and_nothing_else(wheel: zipfile.ZipFile) -> None:
    packaged = {name for name in wheel.namelist() if ".dist-info/" not in name}
    sources = set()
    for package in PACKAGES:
        for end in PACKAGED:
            paths = (ROOT / package).rglob(f"*.{end}")
            sources |= {path.relative_to(ROOT).as_posix() for path in paths}
    assert packaged == sources
    assert {name.split("/")[0] for name in packaged} == set(PACKAGES)


def test_the_wheel_holds_the_licence(wheel: zipfile.ZipFile) -> None:
    (licence,) = [name for name in wheel.namelist() if name.endswith("licenses/LICENSE")]
    assert wheel.read(licence).startswith(b"MIT License")
