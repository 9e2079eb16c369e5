"""Every installed package is pinned with hashes."""

import re
import tomllib

from tests.walking import ROOT
from tools.audit import pinned
from tools.requirements import requirements

TEXT = (ROOT / "packaging/constraints.txt").read_text("utf-8")
PINS = pinned(TEXT)


def test_all_that_the_set_up_asks_for_is_pinned_with_hashes() -> None:
    """Direct requirements: ``make constraints`` resolves theirs, and ``make audit`` compares all with what is installed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    shop = tomllib.loads((ROOT / "shop" / "pyproject.toml").read_text("utf-8"))
    extras = project["project"]["optional-dependencies"] | shop["project"]["optional-dependencies"]
    wanted = requirements([name for name in extras if name != "peers"])
    for group in project["dependency-groups"].values():
        wanted += group
    names = {re.match(r"[\w-]+", need)[0].lower().replace("_", "-") for need in wanted}  # type: ignore[index]
    assert len(re.findall(r"(?m)^[\w.-]+==.*\\\n    --hash=sha256:[0-9a-f]{64}", TEXT)) == len(PINS)
    assert names | {"pip", "colorama", "triton"} <= PINS.keys()  # the last two are other platforms'


def test_conda_gets_the_same_requirements() -> None:
    needs = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
    for file in ("packaging/environment.yml", "packaging/recipe.yaml"):
        text = (ROOT / file).read_text("utf-8").replace(" ", "")
        assert [need for need in needs if f"-{need}\n" not in text] == []
