"""The low-pass of the servo current.

Golden actions, shipped results and the paper's checks cover what the rule does with it.
"""

import numpy as np
import pytest
from scipy.signal import butter, sosfreqz

from baselines.current_limit import ORDER, low_pass


@pytest.mark.parametrize("cutoff", [0.1, 0.3, 0.8])
def test_the_filter_is_scipys(cutoff: float) -> None:
    _, response = sosfreqz(low_pass(cutoff))
    _, expected = sosfreqz(butter(ORDER, cutoff, output="sos"))
    np.testing.assert_allclose(response, expected, atol=1e-9)
