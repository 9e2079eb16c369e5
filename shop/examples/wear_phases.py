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

    An edge is its arrays of log time and log wear. The curve has the rate of a power law with this
    exponent of time, times ``factor`` at each of ``WEAR``.
    """
    log_curve = np.log(WEAR)
    # Time to each wear of the curve, at the mean rate of each of its steps.
    life = WEAR ** (1.0 / exponent)
    steps = 2.0 * np.diff(life) / (factor[1:] + factor[:-1])
    time = np.log(life[0] + np.concatenate([[0.0], np.cumsum(steps)]))
    deviations = []
    for log_time, log_wear in edges:
        scale = np.mean(np.interp(log_wear, log_curve, time) - log_time)
        for _ in range(8):  # Gauss-Newton
            scaled = log_time + scale
            low = np.interp(scaled - 1e-3, time, log_curve)
            at = np.interp(scaled, time, log_curve)
            high = np.interp(scaled + 1e-3, time, log_curve)
            slope = (high - low) / 2e-3
            scale += slope @ (log_wear - at) / max(slope @ slope, 1e-9)
        fitted = np.interp(log_time + scale, time, log_curve)
        deviations.append(log_wear - fitted)
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
            edges_of_pair = pairs[row["work_material"], row["tool_material"]]
            edge = edges_of_pair[tuple(row[name] for name in EDGE)]
            time = float(row["time_min"])
            wear = float(row["flank_wear_mm"])
            edge.append(np.log([time, wear]))

    curves = []
    counts = []
    parameters = []
    for edges_of_pair in pairs.values():
        edges = [np.array(edge).T for edge in edges_of_pair.values() if len(edge) > 1]
        readings = sum(edge.shape[1] for edge in edges)
        if readings - len(edges) > 4:
            curves.append(edges)
            counts.append(readings)
            parameters.append(len(edges) + 2)
    print(f"{len(pairs)} pairs, {len(curves)} of them with readings enough")

    # Akaike's corrected criterion, without and with the size of a phase as a parameter.
    count = np.array(counts)
    free = np.array(parameters)
    plain = 2.0 * free * count / (count - free - 1.0)
    more_free = free + 1
    more = 2.0 * more_free * count / (count - more_free - 1.0)
    for name, phase in PHASES.items():
        misfits = []
        for size in SIZES:
            misfits.append([max(least(edges, phase(size)), 1e-9) for edges in curves])
        deviance = count * np.log(misfits)
        common = deviance.sum(axis=1)
        better = deviance.min(axis=0) + more < deviance[0] + plain
        best_sizes = [SIZES[k] for k in deviance.argmin(axis=0)[better]]
        print(
            f"{name}: better for {better.sum()} pairs, of sizes {best_sizes}; "
            f"common size {SIZES[common.argmin()]}"
        )
        by_size = []
        for size, value in zip(SIZES, common - common[0], strict=True):
            by_size.append(f"{size}: {value:.1f}")
        print("  deviance by size:", ", ".join(by_size))


if __name__ == "__main__":
    main(sys.argv[1])
