"""Every file that the pages of guarantees name is there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_every_file_that_the_pages_name_is_there() -> None:
    pages = "".join((ROOT / "docs" / f"{page}.md").read_text("utf-8") for page in ("soundness", "security"))
    named = set(re.findall(r"`((?:tests|studies|train|turning_env)/[\w/.]+)`", pages))
    assert len(named) > 20
    assert {path for path in named if not (ROOT / path).exists()} == set()
