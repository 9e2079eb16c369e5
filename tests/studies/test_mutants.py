"""Mutants differ from their file in one place."""

import ast

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
