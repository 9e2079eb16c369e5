"""Compare the power law of wear with laws that have a running-in or a tertiary phase.

The data are measured wear over time.

    python shop/examples/wear_phases.py aist_turning_wear.csv

Edges of one pair of materials share the exponent of time n; each has a scale of its own. With D =
W^(1/n), dD/dt is 1 + size exp(-W / 0.05 mm) times as large while an edge runs in, or exp(size (W -
0.2 mm)) times beyond 0.2 mm. A phase is better for a pair if its corrected Akaike criterion
(Hurvich and Tsai 1989) is lower. The common size is the likeliest for all pairs.
"""

import csv
import sys
from collections import defaultdict
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

WEAR = np.geomspace(1e-4, 5.0, 2000)  # [mm] at which curves are integrated
PHASES = {
    "running in": lambda size: 1.0 + size * np.exp(-WEAR / 0.05),
    "tertiary": lambda size: np.exp(np.minimum(size * np.maximum(WEAR - 0.2, 0.0), 50.0)),
}
SIZES = 0.0, 0.3, 0.6, 1.2, 2.5, 5.0, 8.0, 12.0, 20.0, 40.0
EDGE = "organization", "nose_radius_mm", "cutting_speed_m_min", "feed_mm_rev", "depth_of_cut_mm"


def misfit(edges: Any, exponent: float, factor: Any) -> float:
    """Return the mean squared deviation of edges' log wear, each with its best scale.

    An edge is its arrays of log time and log wear.
    """
    life, deviations = WEAR ** (1.0 / exponent), []
    time = np.log(
        life[0]
        + np.concatenate([[0.0], np.cumsum(2.0 * np.diff(life) / (factor[1:] + factor[:-1]))])
    )
    for log_time, log_wear in edges:
        scale = np.mean(np.interp(log_wear, np.log(WEAR), time) - log_time)
        for _ in range(8):  # Gauss-Newton
            low, at, high = (
                np.interp(log_time + scale + step, time, np.log(WEAR))
                for step in (-1e-3, 0.0, 1e-3)
            )
            slope = (high - low) / 2e-3
            scale += slope @ (log_wear - at) / max(slope @ slope, 1e-9)
        deviations.append(log_wear - np.interp(log_time + scale, time, np.log(WEAR)))
    return float(np.mean(np.concatenate(deviations) ** 2))


def least(edges: Any, factor: Any) -> float:
    """Return the misfit with the best exponent of time."""
    return float(
        minimize_scalar(
            lambda exponent: misfit(edges, exponent, factor), bounds=(0.1, 1.5), method="bounded"
        ).fun
    )


def main(path: str) -> None:
    """Fit the pairs that have at least five readings more than edges, and print."""
    pairs: Any = defaultdict(lambda: defaultdict(list))
    with open(path, encoding="utf-8-sig", newline="") as file:
        for row in csv.DictReader(file):
            edge = pairs[row["work_material"], row["tool_material"]][
                tuple(row[name] for name in EDGE)
            ]
            edge.append(np.log([float(row["time_min"]), float(row["flank_wear_mm"])]))
    curves = [
        [np.array(edge).T for edge in edges.values() if len(edge) > 1] for edges in pairs.values()
    ]
    curves = [edges for edges in curves if sum(edge.shape[1] - 1 for edge in edges) > 4]
    count, free = np.array(
        [(sum(edge.shape[1] for edge in edges), len(edges) + 2) for edges in curves]
    ).T
    plain, more = (2.0 * k * count / (count - k - 1.0) for k in (free, free + 1))
    print(f"{len(pairs)} pairs, {len(curves)} of them with readings enough")
    for name, phase in PHASES.items():
        deviance = count * np.log(
            [[max(least(edges, phase(size)), 1e-9) for edges in curves] for size in SIZES]
        )
        common, better = deviance.sum(axis=1), deviance.min(axis=0) + more < deviance[0] + plain
        own = [SIZES[k] for k in deviance.argmin(axis=0)[better]]
        print(
            f"{name}: better for {better.sum()} pairs, of sizes {own}; "
            f"common size {SIZES[common.argmin()]}"
        )
        print(
            "  deviance by size:",
            ", ".join(
                f"{size}: {value:.1f}"
                for size, value in zip(SIZES, common - common[0], strict=True)
            ),
        )


if __name__ == "__main__":
    main(sys.argv[1])
