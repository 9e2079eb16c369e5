"""Every installed package is pinned with hashes."""

import re
import tomllib

from tests.walking import ROOT
from tools.audit import pinned

TEXT = (ROOT / "packaging/constraints.txt").read_text("utf-8")
PINS = pinned(TEXT)


def test_all_that_the_set_up_asks_for_is_pinned_with_hashes() -> None:
    """Direct requirements: ``make constraints`` resolves theirs, and ``make audit`` compares all with what is installed."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    extras = project["project"]["optional-dependencies"]
    groups = project["dependency-groups"] | {
        name: needs for name, needs in extras.items() if name != "peers"
    }
    wanted = [
        *project["project"]["dependencies"],
        *(need for needs in groups.values() for need in needs),
    ]
    names = {re.match(r"[\w-]+", need)[0].lower().replace("_", "-") for need in wanted}  # type: ignore[index]
    assert len(re.findall(r"(?m)^[\w.-]+==.*\\\n    --hash=sha256:[0-9a-f]{64}", TEXT)) == len(PINS)
    assert names | {"pip", "colorama", "triton"} <= PINS.keys()  # the last two are other platforms'


def test_conda_gets_the_same_requirements() -> None:
    needs = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["dependencies"]
    for file in ("environment.yml", ".conda/recipe.yaml"):
        text = (ROOT / file).read_text("utf-8").replace(" ", "")
        assert [need for need in needs if f"-{need}\n" not in text] == []
