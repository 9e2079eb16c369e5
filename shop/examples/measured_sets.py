"""Fit the laws to a public set of measured cuts, and predict edges that were left out.

    python shop/examples/measured_sets.py vicomtech dataset.csv
    python shop/examples/measured_sets.py h13 FOLDER
    python shop/examples/measured_sets.py aist aist_turning_wear.csv
    python shop/examples/measured_sets.py papers FOLDER

The argument is a file, a folder or a URL of the set as published; shop/docs/measured_data.md names
the sources. For H13, the folder holds Exp1.csv, Exp2.csv and Prep.csv; for the papers, it is
``Arquivos/Dados`` of its repository. Files may be compressed by xz.

The results are a table of the predictions, and how loads grow with wear:

* Exponent e: least squares of log F = a + e log VB with one e for all edges, and an a for each edge
  (Vicomtech) or setting (H13, in which every edge has one wear). Wears of 0.05 to 0.3 mm count.
* Growth: force at 0.3 mm over that at 0.1 mm, interpolated, as the mean over edges or settings with
  readings at both.
* Forms: for each edge of Vicomtech, the median relative error of F = F0 (1 + b VB) and of
  F = k VB^e, both fitted to its own readings from 0.01 mm on.
* Shares (papers, H13): thrust over cutting force by least squares of its logarithm over those of
  speed, feed and depth, at the reference of ``turning_shop/catalogue/thrust.py``.
"""

import argparse
import csv
import lzma
import tempfile
import urllib.request
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from turning_shop import WorkshopError
from turning_shop.calibrate import calibrate, summary
from turning_shop.catalogue import thrust
from turning_shop.hold_out import HeldOut, hold_out
from turning_shop.measurements import Measurements, read_measurements

from turning_env.scenario import Scenario

Row = dict[str, str]

SECONDS = 60  # in a minute
SEEN_FRESH = 10.0  # wear of the first reading, below which an edge was measured from fresh [um]
LOWEST_WEAR = 0.05  # [mm]
FIRST_WEAR = 0.01  # [mm]; a power law has no force at 0
HIGHEST_WEAR = 0.305  # [mm]
AIST_EDGE = (
    "organization",
    "nose_radius_mm",
    "cutting_speed_m_min",
    "feed_mm_rev",
    "depth_of_cut_mm",
)
"""Columns of AIST that are equal in all readings of an edge."""


def csv_rows(source: str) -> list[Row]:
    """Return the rows of a CSV file, which is a path or a URL."""
    if source.startswith("https://"):
        with urllib.request.urlopen(source) as answer:
            content = answer.read()
    else:
        content = Path(source).read_bytes()
    if source.endswith(".xz"):
        content = lzma.decompress(content)
    return list(csv.DictReader(content.decode("utf-8-sig").splitlines()))


def vicomtech(source: str) -> Iterator[tuple[str, list[Row]]]:
    """Yield the sheet of Vicomtech/dataset-machine-tool-wear.

    Each row of the set is the mean over one second. Speed, feed and depth are not stated: with one
    value in all rows, they have no effect. The time of an edge is known if it was seen fresh.
    """
    seconds: dict[str, int] = defaultdict(int)
    from_fresh: dict[str, bool] = {}
    rows = []
    for reading in csv_rows(source):
        tool = reading["tool"]
        wear = float(reading["Vb"])
        known_time = from_fresh.setdefault(tool, wear < SEEN_FRESH)
        rows.append(
            {
                "edge": tool,
                "vc [m/min]": "200",
                "f [mm/rev]": "0.2",
                "ap [mm]": "1.5",
                "time [s]": str(seconds[tool]) if known_time else "",
                "VB [um]": reading["Vb"],
                "Fc [N]": reading["F_c_MEAN"],
                "Ff [N]": reading["F_f_MEAN"],
                "Fp [N]": reading["F_p_MEAN"],
            }
        )
        seconds[tool] += 1
    yield "Vicomtech", rows


def h13(folder: str) -> Iterator[tuple[str, list[Row]]]:
    """Yield the sheets of shay-tham/turning: forces of fresh and worn edges, and wear over time."""
    first = _h13_forces(csv_rows(f"{folder}/Exp1.csv"))
    second = _h13_forces(csv_rows(f"{folder}/Exp2.csv"))
    yield "H13, Exp1 and Exp2", [*first, *second]
    yield "H13, Exp2", second
    rows = {}
    for reading in csv_rows(f"{folder}/Prep.csv"):
        # A reading of wear has several rows, one for each reading of roughness.
        time = reading["CTime"]
        place = (reading["Tool_ID"], time)
        rows[place] = _h13_settings(reading) | {"time [min]": time}
    yield "H13, Prep", list(rows.values())


def _h13_forces(readings: Sequence[Row]) -> list[Row]:
    """Return a row for each run: it has several, one for each reading of roughness."""
    rows = {}
    for reading in readings:
        forces = {"Fc [N]": reading["Fx"], "Fp [N]": reading["Fy"], "Ff [N]": reading["Fz"]}
        rows[reading["Run_ID"]] = _h13_settings(reading) | forces
    return list(rows.values())


def _h13_settings(reading: Row) -> Row:
    return {
        "edge": reading["Tool_ID"],
        "vc [m/min]": reading["vc"],
        "f [mm/rev]": reading["f"],
        "ap [mm]": reading["ap"],
        "VB [mm]": reading["TCond"],
    }


def aist(source: str) -> Iterator[tuple[str, list[Row]]]:
    """Yield a sheet for each pair of work and tool material of AIST."""
    pairs: dict[str, list[Row]] = defaultdict(list)
    for reading in csv_rows(source):
        pair = f"{reading['work_material']} by {reading['tool_material']}"
        pairs[pair].append(
            {
                "edge": " ".join(reading[name] for name in AIST_EDGE),
                "vc [m/min]": reading["cutting_speed_m_min"],
                "f [mm/rev]": reading["feed_mm_rev"],
                "ap [mm]": reading["depth_of_cut_mm"],
                "time [min]": reading["time_min"],
                "VB [mm]": reading["flank_wear_mm"],
            }
        )
    yield from pairs.items()


PAPERS = {
    "Borsos": ("C45 (AISI 1045), CNMG120408-KM", "x"),
    "Chinchanikar 35": ("4340, 35 HRC, coated carbide KC9110", "z"),
    "Chinchanikar 45": ("4340, 45 HRC, coated carbide KC9110", "z"),
    "Keblouti - coated insert": ("52100, coated cermet GC1525", "z"),
    "Keblouti - uncoated insert": ("52100, cermet CT5015", "z"),
    "Aouici": ("H11, 50 HRC, CBN 7020", "x"),
    "Fnides": ("H11, 50 HRC, ceramic CC650", "z"),
    "Lalwani": ("maraging steel MDN250, ceramic TNMA160408S01525", "z"),
    "Bartarya": ("52100 (EN31), 60 HRC, CBN TNGA160408S01525", "z"),
    "Mata": ("PEEK CF30, coated carbide", "z"),
}
"""Sets of bessafelipe by their names: material, tool, and the axis of the cutting force.

The axis is the one whose force grows in proportion to the depth of cut.
"""


def papers(folder: str) -> Iterator[tuple[str, list[Row]]]:
    """Yield the sheets of ten papers, as transcribed by bessafelipe: cuts with three forces."""
    for name, (title, main_axis) in PAPERS.items():
        forces = {axis: _paper_table(Path(folder) / f"{name}_F{axis}_dados.csv") for axis in "xyz"}
        first, second = [axis for axis in "xyz" if axis != main_axis]
        rows = []
        for number, (_, speed, feed, depth) in enumerate(forces[main_axis]):
            rows.append(
                {
                    "vc [m/min]": speed,
                    "f [mm/rev]": feed,
                    "ap [mm]": depth,
                    "VB [mm]": "0",
                    "Fc [N]": forces[main_axis][number][0],
                    "Ff [N]": forces[first][number][0],
                    "Fp [N]": forces[second][number][0],
                }
            )
        yield f"{name.split()[0]}: {title}", rows


def _paper_table(path: Path) -> list[list[str]]:
    """Return force, cutting speed, feed and depth of each cut; decimals may have a comma."""
    lines = path.read_text("utf-8-sig").splitlines()[1:]
    return [line.replace(",", ".").split(";") for line in lines if line]


SETS = {"vicomtech": vicomtech, "h13": h13, "aist": aist, "papers": papers}


def written(rows: Sequence[Row], path: Path) -> Path:
    """Write a sheet of cuts; return its path."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


class Predictions(NamedTuple):
    """Predictions of one response in one set or more."""

    holds: list[Any]
    errors: list[Any]
    factors: list[Any]  # from a prediction to the end of its interval
    unpredicted: list[int]  # numbers of parts

    def add(self, result: HeldOut) -> None:
        """Add the predictions of one sheet."""
        self.holds.append(result.holds)
        self.errors.append(result.errors)
        self.factors.append(np.sqrt(result.high / result.low))
        self.unpredicted.append(len(result.failures))

    def row(self, title: str, response: str) -> str:
        """Return a row of a table in Markdown."""
        holds = np.concatenate(self.holds)
        errors = np.concatenate(self.errors)
        factors = np.concatenate(self.factors)
        cells = [
            title,
            response.replace("_", " "),
            f"{len(holds):,}",
            f"{100 * holds.mean():.1f} %",
            f"{100 * np.median(errors):.1f} %",
            f"{np.median(factors):.2f}",
            str(sum(self.unpredicted)),
        ]
        return f"| {' | '.join(cells)} |"


def predict_all(
    sheets: Mapping[str, Measurements], title: str, left_out: str = "edge"
) -> Iterator[str]:
    """Yield rows of a table on edges, or rows, that were left out, one for each response."""
    responses: dict[str, Predictions] = {}
    for measurements in sheets.values():
        try:
            results = hold_out(measurements, Scenario(), by=left_out)
        except WorkshopError:
            continue  # a sheet of one edge, or of too few rows
        for result in results:
            empty = Predictions(holds=[], errors=[], factors=[], unpredicted=[])
            responses.setdefault(result.response, empty).add(result)
    for response, predictions in responses.items():
        yield predictions.row(title, response)


class MeasuredLoads(NamedTuple):
    """Readings of a load: arrays of the same length."""

    group: Any  # edge or setting
    wear: Any  # [mm]
    force: Any  # [N]


def exponent(loads: MeasuredLoads) -> float:
    """Return the exponent of wear that all groups share."""
    counts = (loads.wear >= LOWEST_WEAR) & (loads.wear <= HIGHEST_WEAR)
    group = loads.group[counts]
    log_wear = np.log(loads.wear[counts])
    log_force = np.log(loads.force[counts])
    for name in np.unique(group):
        members = group == name
        log_wear[members] -= log_wear[members].mean()
        log_force[members] -= log_force[members].mean()
    product = log_wear @ log_force
    square = log_wear @ log_wear
    return float(product / square)


def growth(loads: MeasuredLoads) -> list[float]:
    """Return the growth of force from 0.1 to 0.3 mm [-] of each group with readings at both."""
    ratios = []
    for name in np.unique(loads.group):
        members = loads.group == name
        wear = loads.wear[members]
        force = loads.force[members]
        levels, level_of = np.unique(wear, return_inverse=True)
        if levels[0] > 0.1 or levels[-1] < 0.3:
            continue
        sums = np.bincount(level_of, force)
        means = sums / np.bincount(level_of)
        at_low, at_high = np.interp([0.1, 0.3], levels, means)
        ratios.append(float(at_high / at_low))
    return ratios


def compare_forms(loads: MeasuredLoads) -> str:
    """Return a line that compares both laws on all edges, each fitted alone."""
    affine_errors = []
    power_errors = []
    growths = []  # b of edges whose first reading is of nearly no wear
    for edge in np.unique(loads.group):
        members = (loads.group == edge) & (loads.wear >= FIRST_WEAR)
        wear = loads.wear[members]
        force = loads.force[members]
        slope, fresh = np.polyfit(wear, force, 1)
        power, log_scale = np.polyfit(np.log(wear), np.log(force), 1)
        by_growth = fresh + slope * wear
        by_power = np.exp(log_scale) * wear**power
        affine_error = np.abs(by_growth / force - 1.0)
        power_error = np.abs(by_power / force - 1.0)
        affine_errors.append(np.median(affine_error))
        power_errors.append(np.median(power_error))
        if wear.min() < LOWEST_WEAR:
            growths.append(slope / fresh)
    is_better = np.array(affine_errors) < np.array(power_errors)
    better = int(np.sum(is_better))
    affine = 100.0 * np.median(affine_errors)
    power_law = 100.0 * np.median(power_errors)
    return (
        f"1 + b VB better on {better} of {len(affine_errors)} edges, median error {affine:.1f} "
        f"against {power_law:.1f} %, b {min(growths):.1f} to {max(growths):.1f} per mm on the "
        f"{len(growths)} seen fresh"
    )


def fresh_share(loads: MeasuredLoads) -> float:
    """Return the force of a fresh edge over that at 0.1 mm [-], the mean over settings."""
    ratios = []
    for setting in np.unique(loads.group):
        members = loads.group == setting
        fresh = loads.force[members & (loads.wear == 0.0)]
        worn = loads.force[members & (loads.wear == 0.1)]
        ratios.append(fresh.mean() / worn.mean())
    return float(np.mean(ratios))


def describe_share(title: str, measurements: Measurements) -> str:
    """Return the share of thrust of fresh edges, and how it depends on speed, feed and depth."""
    columns = measurements.columns
    fresh = columns["wear"] == 0.0
    main_force = columns["main_force"][fresh]
    share = columns["thrust_force"][fresh] / main_force
    speed = columns["cutting_speed"][fresh] / 150.0
    feed = columns["feed"][fresh]
    depth = columns["depth_of_cut"][fresh]
    factors = np.column_stack(
        [
            np.ones_like(share),
            np.log(speed),
            np.log(feed / thrust.REFERENCE_FEED),
            np.log(depth / thrust.REFERENCE_DEPTH),
        ]
    )
    (level, by_speed, by_feed, by_depth), *_ = np.linalg.lstsq(factors, np.log(share), rcond=None)
    # Kienzle's kc1.1 with the usual exponent of steel.
    specific_force = np.median(main_force / depth / feed**0.76)
    return (
        f"{title}: thrust {np.median(share):.2f} of the cutting force ({share.min():.2f} to "
        f"{share.max():.2f}), {np.exp(level):.2f} at the reference; exponents of speed "
        f"{by_speed:+.2f}, feed {by_feed:+.2f}, depth {by_depth:+.2f}; kc1.1 about "
        f"{specific_force:.0f} N/mm2"
    )


def describe_loads(title: str, measurements: Measurements) -> Iterator[str]:
    """Yield how the main and the thrust force of a set grow with wear."""
    columns = measurements.columns
    has_edges_over_wear = title == "Vicomtech"
    if has_edges_over_wear:
        group = measurements.edges
    else:
        settings = np.column_stack(
            [columns[name] for name in ("cutting_speed", "feed", "depth_of_cut")]
        )
        group = np.unique(settings, axis=0, return_inverse=True)[1]
    for name in ("main_force", "thrust_force"):
        loads = MeasuredLoads(group, columns["wear"], columns[name])
        ratios = growth(loads)
        line = f"{title}, {name}: exponent {exponent(loads):.2f}"
        yield f"{line}; from 0.1 to 0.3 mm x{np.mean(ratios):.2f} (mean of {len(ratios)})"
        if has_edges_over_wear:
            yield f"{title}, {name}: {compare_forms(loads)}"
        else:
            share = 100.0 * fresh_share(loads)
            yield f"{title}, {name}: a fresh edge has {share:.0f} % of the force at 0.1 mm"


def main(name: str, source: str, folder: Path) -> None:
    """Print the fits, the growth of loads with wear and the table of predictions of a set."""
    sheets: dict[str, Measurements] = {}
    for number, (title, rows) in enumerate(SETS[name](source), 1):
        path = written(rows, folder / f"{name}_{number}.csv")
        sheets[title] = read_measurements(path)
    rows_of_table = []
    if name == "aist":
        rows_of_table += predict_all(sheets, f"AIST, {len(sheets)} pairs of materials")
    else:
        for title, measurements in sheets.items():
            print(title)
            # The sets are shown whole, with what would make ``calibrate`` refuse a sheet.
            calibration = calibrate(measurements, Scenario(), force=True)
            notes = (*calibration.problems, *calibration.warnings)
            for line in (*notes, *summary(calibration)):
                print(f"  {line}")
            left_out = "row" if name == "papers" else "edge"
            rows_of_table += predict_all({title: measurements}, title, left_out)
            if name == "papers" or title == "H13, Exp1 and Exp2":
                print(describe_share(title, measurements))
            if title in ("Vicomtech", "H13, Exp2"):
                print(*describe_loads(title, measurements), sep="\n")
    print("| Data | Law | Readings | 95 % hold | Median error | Ends at | Edges not predicted |")
    print("|---|---|---|---|---|---|---|")
    print("\n".join(rows_of_table))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="fit the laws to a public set, and predict it")
    parser.add_argument("name", choices=SETS)
    parser.add_argument("source", help="file, folder (h13) or URL")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        main(options.name, options.source, Path(temporary))
