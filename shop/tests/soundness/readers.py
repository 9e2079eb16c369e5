"""Readers of the shop's files, with what each promises, and damaged files for them."""

from pathlib import Path

import numpy as np
from turning_shop import WorkshopError
from turning_shop.headers import COLUMNS
from turning_shop.measurements import Measurements, read_measurements

from tests.soundness.readers import ROOT, Reader

_OWN_TABLE = (
    b"edge,cutting_speed,feed,depth_of_cut,time,wear\r\n"
    b'"a, 1",150,.3,2,1e1,0.1\r\n'
    b",120,0.2,2.5,,\r\n"
)


def _check_measurements(table: Measurements, folder: Path) -> None:
    """Check that every value is missing or in its range."""
    for name, values in table.columns.items():
        assert values.shape == table.lines.shape
        column = COLUMNS[name]
        missing = np.isnan(values)
        zero = (values == 0.0) & column.may_be_zero
        in_range = (column.low <= values) & (values <= column.high)
        assert (missing | zero | in_range).all()
    assert table.edges is None or table.edges.shape == table.lines.shape


def _valid_measurements() -> tuple[bytes, ...]:
    return (ROOT / "shop" / "examples" / "cuts.csv").read_bytes(), _OWN_TABLE


READERS = {
    "measurements": Reader(
        suffix=".csv",
        read=read_measurements,
        refusal=WorkshopError,
        valid=_valid_measurements,
        check_content=_check_measurements,
    ),
}
