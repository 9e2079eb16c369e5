"""The machinability models, against the tables that they were recovered from."""

import numpy as np
import pytest

from turning_env import Scenario

MATERIAL = Scenario().material

# Alaskari and Oraby 2018, Table 1, at 1 min and 2.5 mm: speed [m/min], feed [mm/rev], wear [mm], power [kW], force [N].
TABLE_1 = np.array(
    [
        (50, 0.6, 0.083884, 2.33315679, 931.248196),
        (100, 0.6, 0.125133, 4.72271758, 1033.78604),
        (150, 0.58, 0.157219, 6.97040767, 1083.35819),
        (170, 0.48, 0.163705, 6.9551237, 1019.48205),
        (200, 0.38, 0.172879, 6.99304131, 946.940685),
    ]
)


def test_published_table_in_one_broadcast_call():
    speed, feed, wear, power, force = TABLE_1.T
    assert MATERIAL.wear(speed, feed, 2.5, time=1.0) == pytest.approx(wear, rel=1e-5)
    assert MATERIAL.power(speed, feed, 2.5, wear=wear) == pytest.approx(power, rel=1e-5)
    assert MATERIAL.thrust_force(speed, feed, 2.5, wear=wear) == pytest.approx(force, rel=1e-5)
