"""Names are the field's words: those on the left of the project's list of terms do not come back."""

import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = (
    "turning_env",
    "turning_render",
    "turning_shop",
    "turning_nc",
    "turning_control",
    "baselines",
    "train",
    "leaderboard",
    "papers",
    "studies",
    "examples",
)
# word -> what to write instead
WORDS = {
    "lane": "environment, env_index",
    "lanes": "num_envs",
    "draws": "seeds",
    "contestant": "policy",
    "productivity": "removal_rate",
    "admissible": "feasible",
    "fifths": "DEVIATION_SCALE",
    "odometer": "distance",
    "habits": "behaviour",
    "victims": "targets",
    "accounts": "summary",
    "as_told": "nominal",
    "made_for": "tuned_for",
    "way_gone": "gap_closed",
}


def names(path: Path) -> set[str]:
    with path.open("rb") as stream:
        return {token.string for token in tokenize.tokenize(stream.readline) if token.type == tokenize.NAME}


@pytest.mark.parametrize("package", PACKAGES)
def test_names_are_the_fields_words(package: str) -> None:
    for path in sorted((ROOT / package).rglob("*.py")):
        for name in names(path):
            found = WORDS.keys() & {name.lower().strip("_"), *name.lower().split("_")}
            assert not found, f"{path}: {name}: write {', '.join(WORDS[word] for word in found)}"
            assert not re.search(r"(^|_)(MOST|LEAST)(_|$)", name), f"{path}: {name}: write MAX or MIN"
