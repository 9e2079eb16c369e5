"""Settings for the tests of examples."""

import pytest
import torch


@pytest.fixture(autouse=True)
def _one_thread() -> None:
    """As the scripts set it."""
    torch.set_num_threads(1)
