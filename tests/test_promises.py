"""Every test that the page of promises names is there, and tries as many inputs as it says."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "soundness.md").read_text("utf-8")
TESTS = {path.relative_to(ROOT).as_posix(): path.read_text("utf-8") for path in (ROOT / "tests").rglob("test_*.py")}


def test_every_file_that_it_names_is_there() -> None:
    named = set(re.findall(r"`((?:tests|benchmarks|baselines|train)/[\w/.]+)`", PAGE))
    assert len(named) > 20
    assert {path for path in named if not (ROOT / path).exists()} == set()


def test_every_test_that_it_names_is_there() -> None:
    named = set(re.findall(r"`(test_\w+)`", PAGE))
    assert len(named) > 30
    defined = {name for text in TESTS.values() for name in re.findall(r"^def (test_\w+)", text, re.MULTILINE)}
    assert named - defined == set()


def test_a_test_named_behind_a_file_is_in_it() -> None:
    pairs = re.findall(r"`(tests/[\w/]+\.py)`: `(test_\w+)`", PAGE)
    assert len(pairs) > 5
    assert [pair for pair in pairs if f"def {pair[1]}(" not in TESTS[pair[0]]] == []


def test_inputs_are_as_many_as_it_says() -> None:
    told = re.compile(r"@tried\(short=([\d_]+), soak=([\d_]+)\)\n(?:(?!def ).*\n)*?def (test_\w+)")
    properties = [found for path, text in TESTS.items() if path.startswith("tests/soundness/") for found in told.findall(text)]
    assert len(properties) > 17
    for short, soak, name in properties:
        (row,) = (line for line in PAGE.splitlines() if f"`{name}`" in line)
        assert f" | {int(short):,} | {int(soak):,} |" in row, row
