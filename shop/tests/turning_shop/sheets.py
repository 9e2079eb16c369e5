"""Make sheets of cuts by known formulas, with a little scatter, as a shop might write them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class Setting(NamedTuple):
    """The setting of an edge."""

    speed: float  # [m/min]
    feed: float  # [mm/rev]
    depth: float  # [mm]


SETTINGS = (
    Setting(150, 0.2, 2),
    Setting(150, 0.35, 3),
    Setting(190, 0.25, 1.5),
    Setting(190, 0.4, 2),
    Setting(230, 0.2, 3),
    Setting(230, 0.3, 2.5),
    Setting(270, 0.3, 1.5),
    Setting(270, 0.4, 2),
)
"""Settings of the edges of all sheets."""


def forces(
    fresh_share: float, wears: Sequence[float], header: str = "edge;vc;f;ap;VB;Fc;Ff;Fp"
) -> str:
    """Return a sheet with forces that are not 0 at a fresh edge.

    They are F0 (1 + b VB), with b for the thrust force such that 1 / ``fresh_share`` = 1 + 0.3 b.
    """
    rng = np.random.default_rng(3)
    slope = (1.0 / fresh_share - 1.0) / 0.3
    rows = [header]
    for edge, setting in enumerate(SETTINGS, 1):
        fresh_main = 1800 * setting.feed**0.74 * setting.depth
        fresh_thrust = 900 * setting.feed**0.6 * setting.depth
        for wear in wears:
            main = fresh_main * (1 + 0.4 * wear)
            thrust = fresh_thrust * (1 + slope * wear)
            # Feed force and back force are sides of a right triangle.
            measured = np.array([main, 0.8 * thrust, 0.6 * thrust])
            measured *= np.exp(0.01 * rng.standard_normal(3))
            cells = _first_cells(edge, setting)
            cells.append(f"{wear:g}")
            cells += [f"{force:.1f}" for force in measured]
            rows.append(";".join(cells))
    return "\n".join(rows) + "\n"


def wear_curves(scatter: float = 0.03) -> str:
    """Return a sheet with wear, thrust force and power of edges at several times."""
    rng = np.random.default_rng(4)

    def with_scatter(value: float, scatter: float) -> float:
        return float(value * np.exp(scatter * rng.standard_normal()))

    rows = ["edge;vc;f;ap;time;VB;thrust force;P [kW]"]
    for edge, setting in enumerate(SETTINGS, 1):
        life = 18.0 * (200 / setting.speed) ** 4 * (0.3 / setting.feed) ** 1.2
        for share in (0.15, 0.4, 0.7, 1.0):
            # Loads follow the wear as it is, with its scatter.
            wear = with_scatter(0.3 * share**0.55, scatter)
            thrust = 3400 * setting.feed**0.72 * setting.depth * wear**0.45
            power = 0.045 * setting.speed * setting.feed**0.74 * setting.depth * wear**0.13
            thrust = with_scatter(thrust, scatter)
            power = with_scatter(power, 0.3 * scatter)
            cells = _first_cells(edge, setting)
            cells.append(f"{share * life:.2f}")
            cells.append(f"{wear:.3f}")
            cells.append(f"{thrust:.0f}")
            cells.append(f"{power:.2f}")
            rows.append(";".join(cells))
    return "\n".join(rows) + "\n"


def _first_cells(edge: int, setting: Setting) -> list[str]:
    """Return the cells of an edge and its setting."""
    return [str(edge), str(setting.speed), str(setting.feed), str(setting.depth)]
