"""Settings of the suite."""

import importlib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.settings import SOAKS


def drawn() -> list[float]:
    """Return the inputs of a property in the suite."""
    inputs: list[float] = []

    @settings(settings.get_profile("suite"))
    @given(st.floats(0.0, 1.0))
    def always_holds(number: float) -> None:
        inputs.append(number)

    always_holds()
    return inputs


@pytest.mark.skipif(SOAKS, reason="a soak draws other inputs every time")
def test_inputs_do_not_depend_on_what_other_tests_import(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A module full of constants may be imported in between."""
    before = drawn()
    constants = [0.123 + number / 1000.0 for number in range(50)]
    (tmp_path / "full_of_constants.py").write_text(f"CONSTANTS = {constants}\n")
    monkeypatch.syspath_prepend(tmp_path)
    importlib.import_module("full_of_constants")
    assert drawn() == before
    assert len(set(before)) > 10
