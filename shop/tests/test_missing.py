"""Optional packages of the shop that are not installed: one line that says what to do."""

from pathlib import Path

import pytest

from tests.faults.missing import check_missing

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("package", "command"),
    [
        ("scipy", "turning_shop calibrate shop/examples/cuts.csv --out FILE"),
        (
            "asyncua",
            "turning_control drive --url opc.tcp://127.0.0.1:1 --nodes FILE --policy programmed",
        ),
    ],
)
def test_what_is_missing_is_said_in_one_line(package: str, command: str, tmp_path: Path) -> None:
    check_missing(tmp_path, package, command)
