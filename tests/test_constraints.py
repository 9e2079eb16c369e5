"""Every installed package is pinned with hashes."""

import hashlib
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from tests.walking import ROOT
from tools.requirements import requirements

CONSTRAINTS = (ROOT / "packaging/constraints.txt").read_text("utf-8")
PINS = set(re.findall(r"^([\w.-]+)==", CONSTRAINTS, re.MULTILINE))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
SHOP = tomllib.loads((ROOT / "shop" / "pyproject.toml").read_text("utf-8"))

UV = Path(sys.executable).with_name("uv")
HASHED_PIN = re.compile(r"^[\w.-]+==.*\\\n    --hash=sha256:[0-9a-f]{64}", re.MULTILINE)
USED_BY_OTHERS = {
    "onnxscript": "torch.onnx",
    "tensorboard": "Stable-Baselines3, for its curves",
    "h5py": "Minari, for its files",
    "dask": "distributed, its scheduler",
    "rl-zoo3": "its own commands (docs/ecosystem.md)",
}
"""Distributions of extras that no module of the project imports, and what does."""
OF_THE_CLONE = {"peers", "docs", "test"}
"""Extras of tools, whose packages are commands."""
ON_OTHER_PLATFORMS = {"colorama", "triton"}


def distribution_of(requirement: str) -> str:
    """Return the name of the distribution that a requirement starts with."""
    name = re.match(r"[\w-]+", requirement)
    assert name is not None, requirement
    return name[0].lower().replace("_", "-")


def test_every_requirement_of_the_set_up_is_pinned() -> None:
    """Direct requirements: ``make constraints`` resolves theirs."""
    extras = {*PROJECT["project"]["optional-dependencies"]}
    extras |= {*SHOP["project"]["optional-dependencies"]}
    extras -= {"peers"}
    wanted = requirements(sorted(extras))
    for group in PROJECT["dependency-groups"].values():
        wanted += group
    names = {distribution_of(requirement) for requirement in wanted}
    assert names
    assert names <= PINS
    assert ON_OTHER_PLATFORMS | {"pip"} <= PINS


def test_every_pin_has_a_hash() -> None:
    assert len(HASHED_PIN.findall(CONSTRAINTS)) == len(PINS) > 0


def wheel(folder: Path) -> Path:
    """Write a package without code, and return its wheel."""
    path = folder / "tiny-1.0-py3-none-any.whl"
    about = "tiny-1.0.dist-info"
    contents = {
        f"{about}/METADATA": "Metadata-Version: 2.1\nName: tiny\nVersion: 1.0\n",
        f"{about}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{about}/RECORD": f"{about}/METADATA,,\n{about}/WHEEL,,\n{about}/RECORD,,\n",
    }
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in contents.items():
            archive.writestr(name, content)
    return path


@pytest.mark.slow
@pytest.mark.skipif(not UV.exists() or shutil.which("make") is None, reason="needs uv and make")
@pytest.mark.parametrize("same", [True, False])
def test_the_set_up_refuses_a_file_with_another_hash(same: bool, tmp_path: Path) -> None:
    """The command is that of the Makefile, with a package that lies on this machine."""
    content = wheel(tmp_path).read_bytes()
    digest = hashlib.sha256(content if same else b"another file").hexdigest()
    pin = f"tiny==1.0 --hash=sha256:{digest}\n"
    (tmp_path / "packaging").mkdir()
    (tmp_path / "packaging" / "constraints.txt").write_text(pin)
    (tmp_path / "tiny.mk").write_text("tiny:\n\t$(INSTALL) tiny\n")
    uv = f"{UV} pip install --python {sys.executable} --no-cache --no-index"
    command = ["make", "-C", str(tmp_path), "-f", str(ROOT / "Makefile"), "-f", "tiny.mk", "tiny"]
    command += ["PIP=true"]
    command += [f"UV={uv} --find-links {tmp_path} --target {tmp_path / 'installed'}"]
    finished = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (finished.returncode == 0) == same, finished.stderr
    assert (tmp_path / "installed" / "tiny-1.0.dist-info").exists() == same
    assert same or "Hash mismatch" in finished.stderr


def test_conda_gets_the_same_requirements() -> None:
    needs = PROJECT["project"]["dependencies"]
    assert needs
    # Conda's Matplotlib without a window is called matplotlib-base.
    shop_needs = [
        need.replace("matplotlib", "matplotlib-base")
        for need in SHOP["project"]["dependencies"]
        if not need.startswith("rough-turning")
    ]
    assert shop_needs
    files = {
        "packaging/environment.yml": needs + shop_needs,
        "packaging/recipe.yaml": needs,
    }
    for file, file_needs in files.items():
        text = (ROOT / file).read_text("utf-8").replace(" ", "")
        for need in file_needs:
            assert f"-{need}\n" in text, (file, need)


def test_all_files_state_the_same_version() -> None:
    version = PROJECT["project"]["version"]
    assert SHOP["project"]["version"] == version
    assert f"rough-turning=={version}" in SHOP["project"]["dependencies"]
    recipe = (ROOT / "packaging" / "recipe.yaml").read_text("utf-8")
    assert f'  version: "{version}"\n' in recipe
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"\nversion: {version}\n" in citation


@pytest.mark.slow
def test_every_package_of_an_extra_is_imported() -> None:
    sources = []
    for folder in ("turning_env", "baselines", "train", "leaderboard", "research", "examples"):
        sources += (ROOT / folder).rglob("*.py")
    for package in SHOP["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]:
        sources += (ROOT / "shop" / package).rglob("*.py")
    code = "\n".join(path.read_text("utf-8") for path in sources)
    imported = set(re.findall(r"^ *(?:from|import) (\w+)", code, re.MULTILINE))
    imported |= set(re.findall(r'import_module\("(\w+)', code))
    distributions_of = packages_distributions()
    used = set()
    for module in imported:
        for name in distributions_of.get(module, []):
            used.add(name.lower().replace("_", "-"))
    for project in (PROJECT, SHOP):
        for extra, needs in project["project"]["optional-dependencies"].items():
            if extra not in OF_THE_CLONE:
                needed = {distribution_of(need) for need in needs}
                unused = needed - used - USED_BY_OTHERS.keys()
                assert not unused, extra
