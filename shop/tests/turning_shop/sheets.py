"""Make sheets of cuts by known formulas, with a little scatter, as a shop might write them."""

from collections.abc import Sequence

import numpy as np

SETTINGS = (
    (150, 0.2, 2),
    (150, 0.35, 3),
    (190, 0.25, 1.5),
    (190, 0.4, 2),
    (230, 0.2, 3),
    (230, 0.3, 2.5),
    (270, 0.3, 1.5),
    (270, 0.4, 2),
)
"""Cutting speed [m/min], feed [mm/rev] and depth of cut [mm] of each edge."""


def forces(
    fresh_share: float, wears: Sequence[float], header: str = "edge;vc;f;ap;VB;Fc;Ff;Fp"
) -> str:
    """Return a sheet with forces that are not 0 at a fresh edge.

    They are F0 (1 + b VB), with b for the thrust force such that 1 / ``fresh_share`` = 1 + 0.3 b.
    """
    rng = np.random.default_rng(3)
    slope = (1.0 / fresh_share - 1.0) / 0.3
    rows = [header]
    for edge, (speed, feed, depth) in enumerate(SETTINGS, 1):
        for wear in wears:
            main = 1800 * feed**0.74 * depth * (1 + 0.4 * wear)
            thrust = 900 * feed**0.6 * depth * (1 + slope * wear)
            scatter = np.exp(0.01 * rng.standard_normal(3))
            numbers = np.array([main, 0.8 * thrust, 0.6 * thrust]) * scatter
            cells = [f"{edge};{speed};{feed};{depth};{wear:g}"]
            cells += [f"{number:.1f}" for number in numbers]
            rows.append(";".join(cells))
    return "\n".join(rows) + "\n"


def wear_curves(scatter: float = 0.03) -> str:
    """Return a sheet with wear, thrust force and power of edges at several times."""
    rng = np.random.default_rng(4)
    rows = ["edge;vc;f;ap;time;VB;thrust force;P [kW]"]
    for edge, (speed, feed, depth) in enumerate(SETTINGS, 1):
        life = 18.0 * (200 / speed) ** 4 * (0.3 / feed) ** 1.2
        for share in (0.15, 0.4, 0.7, 1.0):
            wear = 0.3 * share**0.55 * np.exp(scatter * rng.standard_normal())
            thrust = 3400 * feed**0.72 * depth * wear**0.45
            thrust *= np.exp(scatter * rng.standard_normal())
            power = 0.045 * speed * feed**0.74 * depth * wear**0.13
            power *= np.exp(0.3 * scatter * rng.standard_normal())
            settings = f"{edge};{speed};{feed};{depth}"
            readings = f"{share * life:.2f};{wear:.3f};{thrust:.0f};{power:.2f}"
            rows.append(f"{settings};{readings}")
    return "\n".join(rows) + "\n"
