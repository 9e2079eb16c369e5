"""Mutants differ from their file in one place, and none that survives goes unsaid."""

import ast
from pathlib import Path

import pytest

from studies import mutants


def test_expressions_are_changed_and_nothing_else() -> None:
    source = 'def f(a: int = 1) -> "x":\n    """One."""\n    if a < 2.0:\n        raise ValueError(f"{a + 1}")\n'
    source += "    return min(a, b) + 3"
    found = {ast.unparse(changed) for _, changed in mutants.places(ast.parse(source))}
    assert found == {
        *("2", "not a < 2.0", "a <= 2.0", "a > 2.0", "2.2", "4"),
        *("min(a, b) - 3", "min(a, b)", "max(a, b)"),
    }


def test_all_mutants_are_programs_that_differ() -> None:
    found = mutants.mutants()
    assert len(found) > 500
    assert len({mutant.key for mutant in found}) == len(found)
    for mutant in found[::50]:
        ast.parse(mutant.text)
        assert mutant.text != (mutants.ROOT / mutant.path).read_text("utf-8")


@pytest.mark.parametrize(("alive", "status"), [(False, 0), (True, 1)])
def test_survivors_are_shown_and_outcomes_kept(
    alive: bool, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tried = []
    monkeypatch.setattr(mutants, "survives", lambda mutant, copies, limit: tried.append(mutant) or alive)
    monkeypatch.setattr(mutants, "passes", lambda copy, path: True)
    monkeypatch.setattr(mutants.shutil, "copytree", lambda *arguments, **options: tmp_path)
    arguments = ["--count", "4", "--out", str(tmp_path / "outcomes.jsonl")]
    for _ in range(2):  # the second time nothing is left to try
        assert mutants.main(arguments) == status
        printed = capsys.readouterr().out
        assert printed.count("\n  +") == (4 if alive else 0)
        assert f"{0 if alive else 4} of 4 mutants found" in printed
    assert len(tried) == 4
