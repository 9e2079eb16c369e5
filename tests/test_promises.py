"""Every file that the page of promises names is there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_every_file_that_the_page_names_is_there() -> None:
    named = set(
        re.findall(r"`((?:tests|benchmarks|train|turning_env)/[\w/.]+)`", (ROOT / "docs" / "soundness.md").read_text("utf-8"))
    )
    assert len(named) > 20
    assert {path for path in named if not (ROOT / path).exists()} == set()
