"""A reader of the shop gives what a file may hold, or an error of its own, whatever it holds."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from shop.tests.soundness.readers import READERS
from tests.soundness.acting import tried
from tests.soundness.readers import damages


@pytest.mark.parametrize("name", READERS)
def test_what_is_valid_is_read(name: str, tmp_path: Path) -> None:
    for content in READERS[name].valid():
        assert READERS[name].check(tmp_path, content) is not None


@pytest.mark.parametrize("name", READERS)
@tried(short=50, soak=15_000)
@given(st.data())
def test_a_damaged_file_is_read_or_refused(name: str, tmp_path: Path, data: st.DataObject) -> None:
    reader = READERS[name]
    reader.check(tmp_path, data.draw(damages(reader.valid, reader.suffix)))
