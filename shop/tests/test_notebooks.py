"""The shop's notebooks run to the last cell, and git holds no outputs."""

from pathlib import Path

import pytest

from tests.notebooks import assert_holds_no_outputs, run
from tests.walking import ROOT

NOTEBOOKS = sorted((ROOT / "shop" / "examples" / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_holds_no_outputs(path: Path) -> None:
    assert_holds_no_outputs(path)


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path) -> None:
    run(path, tmp_path)
