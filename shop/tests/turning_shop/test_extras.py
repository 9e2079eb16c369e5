"""Messages for optional packages of the shop."""

import pytest
from turning_shop.extras import register

from tests.extras import check_extra
from tests.test_constraints import SHOP


@pytest.mark.parametrize("extra", ["programs", "opcua", "xlsx", "onnx"])
def test_a_missing_package_of_an_extra_is_explained(extra: str) -> None:
    register()
    check_extra(SHOP, extra)
