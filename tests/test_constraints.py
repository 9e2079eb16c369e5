"""Every installed package is pinned with hashes."""

import re
import tomllib

from tests.walking import ROOT
from tools.audit import pinned
from tools.requirements import requirements

CONSTRAINTS = (ROOT / "packaging/constraints.txt").read_text("utf-8")
PINS = pinned(CONSTRAINTS)
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
SHOP = tomllib.loads((ROOT / "shop" / "pyproject.toml").read_text("utf-8"))

HASHED_PIN = re.compile(r"^[\w.-]+==.*\\\n    --hash=sha256:[0-9a-f]{64}", re.MULTILINE)
ON_OTHER_PLATFORMS = {"colorama", "triton"}


def distribution_of(requirement: str) -> str:
    """Return the name of the distribution that a requirement starts with."""
    name = re.match(r"[\w-]+", requirement)
    assert name is not None, requirement
    return name[0].lower().replace("_", "-")


def test_every_requirement_of_the_set_up_is_pinned() -> None:
    """Direct requirements: ``make constraints`` resolves theirs.

    ``make audit`` compares all pins with what is installed.
    """
    extras = {*PROJECT["project"]["optional-dependencies"]}
    extras |= {*SHOP["project"]["optional-dependencies"]}
    extras -= {"peers"}
    wanted = requirements(sorted(extras))
    for group in PROJECT["dependency-groups"].values():
        wanted += group
    names = {distribution_of(requirement) for requirement in wanted}
    assert names
    assert names <= PINS.keys()
    assert ON_OTHER_PLATFORMS | {"pip"} <= PINS.keys()


def test_every_pin_has_a_hash() -> None:
    assert len(HASHED_PIN.findall(CONSTRAINTS)) == len(PINS) > 0


def test_conda_gets_the_same_requirements() -> None:
    needs = PROJECT["project"]["dependencies"]
    assert needs
    for file in ("packaging/environment.yml", "packaging/recipe.yaml"):
        text = (ROOT / file).read_text("utf-8").replace(" ", "")
        for need in needs:
            assert f"-{need}\n" in text, (file, need)
