"""The low-pass of the servo current; what the rule does with it: golden actions, shipped results and the paper's checks."""

import numpy as np
import pytest
from scipy.signal import butter, sosfreqz

from baselines.current_limit import ORDER, low_pass


@pytest.mark.parametrize("cutoff", [0.1, 0.3, 0.8])
def test_the_filter_is_scipys(cutoff: float) -> None:
    np.testing.assert_allclose(
        sosfreqz(low_pass(cutoff))[1], sosfreqz(butter(ORDER, cutoff, output="sos"))[1], atol=1e-9
    )
