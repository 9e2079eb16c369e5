"""Every installed package is pinned with hashes."""

import re
import tomllib
from importlib.metadata import packages_distributions

from tests.walking import ROOT
from tools.requirements import requirements

CONSTRAINTS = (ROOT / "packaging/constraints.txt").read_text("utf-8")
PINS = set(re.findall(r"^([\w.-]+)==", CONSTRAINTS, re.MULTILINE))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
SHOP = tomllib.loads((ROOT / "shop" / "pyproject.toml").read_text("utf-8"))

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
