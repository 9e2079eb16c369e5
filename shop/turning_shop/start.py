"""Advise a cut from a catalogue: material, insert, grade, machine and stock, but no measured cut.

The laws are those of ``catalogue``, with the width of their sources. Search and costs are those of
``advise.py``. ``start_question.py`` reads the question, ``start_window.py`` finds where it may be
cut, and ``start_answer.py`` prints the answer.
"""

import math
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w
from turning_shop.advise import Advice, advise
from turning_shop.allowed import FEED_PER_NOSE, MAX_DEFLECTION, bending_parts, with_roughness
from turning_shop.catalogue import UNMEASURED, groups, laws, materials, thrust
from turning_shop.catalogue.inserts import Insert
from turning_shop.catalogue.materials import NamedMaterial
from turning_shop.catalogue.start_values import (
    CONDITIONS,
    DEPTH_EXPONENT,
    FEED_EXPONENT,
    FEEDS_SOURCE,
    LIFE,
    Start,
    feeds_of,
)
from turning_shop.fit import TYPICAL_EDGE_SPREAD
from turning_shop.prediction import Evidence
from turning_shop.provenance import TAYLOR, Stated, for_advice
from turning_shop.start_question import USUAL_ENTERING_ANGLE, Question, Setup, setup_of
from turning_shop.start_window import CutWindow, cut_window_of

from turning_env.scenario import Scenario
from turning_env.scenario.scenario import flat, merged

QUANTILE = 1.96  # half the 95 % interval over the standard deviation [-]
SUPPORT_ASSUMED = "the chuck alone holds the bar: --support states another"


class CatalogueJob(NamedTuple):
    """A job as a scenario with laws of a catalogue."""

    question: Question
    material: NamedMaterial
    insert: Insert
    grade: str
    start: Start
    window: CutWindow
    scenario: Scenario
    evidence: Evidence
    values: dict[str, Any]  # that the catalogue and the question state, by section
    support_assumed: bool
    efficiency_assumed: bool
    edge_spread: float  # log standard deviation of wear from edge to edge, stated or typical [-]

    @property
    def sources(self) -> Iterator[str]:
        """Sentences on where the numbers come from."""
        group = self.material.group
        insert = self.insert
        speeds = self.start.speeds
        yield f"{self.material.described} ({materials.SOURCE})"
        yield (
            f"kc1.1 {group.kc11:g} N/mm2 within {_percent(group.force_deviation)}, "
            f"mc {group.mc:g} ({groups.SOURCE})"
        )
        share = thrust.share_of(group)
        yield (
            f"thrust is {share.value:g} of the cutting force at {thrust.REFERENCE_FEED:g} mm/rev "
            f"and {thrust.REFERENCE_DEPTH:g} mm, within {_percent(share.deviation)} "
            f"({share.source})"
        )
        yield (
            f"{speeds.usual:.0f} m/min ({speeds.low:.0f} to {speeds.high:.0f}) "
            f"for a life of {LIFE:g} min with {self.grade} ({'; '.join(self.start.sources)})"
        )
        yield (
            f"Taylor's n {TAYLOR:g} (Dormer Pramet 2024, p. 76); V f^{FEED_EXPONENT:g} "
            f"ap^{DEPTH_EXPONENT:g} is constant (handbooks, adaptive part programming paper)"
        )
        prepared = f", {insert.edge}" if insert.edge.letter else ""
        yield (
            f"{insert.name}: {insert.shape.name}, edge {insert.edge_length:.1f} mm, "
            f"nose radius {insert.nose_radius:g} mm, {insert.edges} edges{prepared} (ISO 1832); "
            f"{insert.cut.name} ({insert.cut.source}), scaled to its size, nose and clearance"
        )
        if feeds := feeds_of(group):
            low, high = feeds
            yield f"feeds of {low:g} to {high:g} mm/rev in {group.name} ({FEEDS_SOURCE})"
        yield f"modulus of elasticity {group.modulus:.0f} N/mm2 of the bar (handbooks)"

    @property
    def assumptions(self) -> Iterator[str]:
        """Sentences on numbers without a source, and on the user's own that are missing."""
        if not self.material.number and self.material.name != self.material.group.name:
            yield f"{self.material.name} is taken as the usual alloy: its number tells it exactly"
        if not self.question.conditions:
            names = ", ".join(CONDITIONS)
            yield f"the cut is smooth, clean, firm and wet: --cut states what it is not ({names})"
        if self.start.interrupted and "interrupted" not in self.question.conditions:
            yield (
                f"the start value of {self.grade} is the maker's for interrupted cuts, as it has "
                "none of this grade for smooth ones"
            )
        if self.question.entering_angle is None and not self.insert.is_round:
            yield (
                f"the entering angle is {USUAL_ENTERING_ANGLE:g} degrees: --entering-angle states "
                "another"
            )
        yield from self.start.assumptions
        yield from self.insert.assumptions
        yield from self.window.assumptions
        if self.support_assumed:
            yield SUPPORT_ASSUMED
        yield from laws.ASSUMED
        yield (
            f"feeds up to {FEED_PER_NOSE:g} of the nose radius, depths up to "
            f"{self.insert.shape.usable:.2g} of the edge's length (rules of thumb)"
        )
        if bending_parts(self.scenario):
            yield f"the thrust may bend {bending_parts(self.scenario)} by {MAX_DEFLECTION:g} mm"
        for warning in self.evidence.warnings:
            if UNMEASURED not in warning:
                yield warning


def _percent(log_deviation: float) -> str:
    """Return a 95 % interval for people, from a log standard deviation."""
    return f"{100 * math.expm1(QUANTILE * log_deviation):.0f} %"


def job_of(question: Question) -> CatalogueJob:
    """Return the job of a question.

    Raises:
        WorkshopError: A designation is unknown, or insert, material and machine do not meet.
        ScenarioError: The machine's file is invalid.
    """
    setup = setup_of(question)
    window = cut_window_of(setup)
    group = setup.material.group
    insert = setup.insert
    criterion = setup.machine.tool.wear_criterion
    fitted = laws.material_of(group, setup.start, criterion, entering_sine=setup.entering_sine)
    values = _values(setup, window)
    values["material"] = fitted.model_dump()
    values["limits"] = _limits(setup, window, fitted)
    if values["limits"]["thrust_force"] != setup.machine.limits.thrust_force:
        window = window._replace(catalogue_ends=window.catalogue_ends | {"limits.thrust_force"})
    if "economics.edges_per_insert" not in setup.stated:
        values["economics"] = {"edges_per_insert": float(insert.edges)}
    scenario = _scenario(setup, values)
    if question.roughness is not None:
        scenario = with_roughness(scenario, question.roughness, wiper=insert.cut.wiper)
        roughness = scenario.limits.roughness.model_dump(exclude_defaults=True)
        values["limits"]["roughness"] = roughness

    evidence = Evidence(
        source="catalogue",
        tool=f"{insert.name} {setup.grade.name} in {setup.material.name}",
        hardness=group.hardness,
        laws=laws.catalogue_evidence(
            fitted, group, setup.start, feeds=window.feeds, depths=window.depths
        ),
    )
    stated = Stated(set(setup.stated) | set(flat(values)), setup.preset)
    scenario, evidence = for_advice(scenario, evidence, stated, is_simulated=False)
    is_reduced = scenario.spindle.efficiency < 1.0
    edge_spread = TYPICAL_EDGE_SPREAD["wear"]
    if "tool.wear_factor_spread" in setup.stated:
        edge_spread = scenario.tool.wear_factor_spread
    return CatalogueJob(
        question=question,
        material=setup.material,
        insert=insert,
        grade=setup.grade.name,
        start=setup.start,
        window=window,
        scenario=scenario,
        evidence=evidence,
        values=values,
        support_assumed=values["workpiece"].get("support") != question.support,
        efficiency_assumed=is_reduced and "spindle.efficiency" not in setup.stated,
        edge_spread=edge_spread,
    )


def _scenario(setup: Setup, values: dict[str, Any]) -> Scenario:
    """Return the machine's scenario with the values of a job."""
    name = f"{setup.material.name}_{setup.insert.name}_{setup.grade.name}"
    allowed_name = re.sub(r"[^A-Za-z0-9.-]+", "_", name)[:64]
    allowed_name = allowed_name.strip("_.")
    base = setup.machine.model_dump(exclude={"name"})
    for start_name in ("initial_cutting_speed", "initial_feed"):
        # A start that only the preset states moves into the range.
        if f"control.{start_name}" not in setup.stated:
            del base["control"][start_name]
    job_values = merged(base, values)
    return Scenario.load({"name": allowed_name} | job_values)


def _values(setup: Setup, window: CutWindow) -> dict[str, Any]:
    """Return the values of the question and the catalogue, by section."""
    stock = setup.question.stock
    group = setup.material.group
    # The bar's second moment of area is that of a solid one: a tube gets a smaller modulus.
    hollow = stock.bore / stock.diameter
    workpiece: dict[str, Any] = {
        "diameter": stock.diameter,
        "bar_length": stock.length,
        "depth_of_cut": setup.depth,
        "elastic_modulus": (1.0 - hollow**4) * group.modulus,
    }
    if "workpiece.radial_share" not in setup.stated:
        # The more the edge leans, the more of the thrust is radial.
        usual_share = setup.machine.workpiece.radial_share
        leaning_share = math.sqrt(1.0 - setup.entering_sine**2)
        workpiece["radial_share"] = max(usual_share, leaning_share)
    if setup.question.support:
        workpiece["support"] = setup.question.support
    elif "workpiece.support" not in setup.stated:
        workpiece["support"] = "chuck"
    return {
        "machine": {
            "cutting_speed_min": window.speeds[0],
            "cutting_speed_max": window.speeds[1],
            "feed_min": window.feeds[0],
            "feed_max": window.feeds[1],
        },
        "workpiece": workpiece,
        "tool": {"nose_radius": setup.insert.nose_radius},
    }


def _limits(setup: Setup, window: CutWindow, fitted: Any) -> dict[str, Any]:
    """Return the limits of force and power: those of the machine, and the insert's strength.

    The insert bears the thrust of its highest feed and depth in this material, worn out.
    """
    machine = setup.machine
    stated = setup.stated
    bearable = float(
        fitted.thrust_force(
            window.speeds[0],
            window.feeds[1],
            window.depths[1],
            wear=machine.tool.wear_criterion,
        )
    )
    limits: dict[str, Any] = {"thrust_force": bearable}
    if "limits.thrust_force" in stated:
        limits["thrust_force"] = min(bearable, machine.limits.thrust_force)
    if "limits.power" not in stated and "machine.rated_power" in stated:
        limits["power"] = machine.machine.rated_power
    return limits


def start_advice(job: CatalogueJob) -> list[Advice]:
    """Return the advice on a job, the least cost first."""
    return advise(job.scenario, job.evidence)


def toml_of(job: CatalogueJob, out: Path) -> str:
    """Return the job as a scenario's file, with its evidence; ``calibrate`` can take it as base."""
    lines = [f"# Laws of a catalogue, not measured: {job.material.described}."]
    for line in (*job.sources, *job.assumptions):
        lines.append(f"# {line}")
    comment = "\n".join(lines)

    base = job.question.machine
    path = Path(job.question.machine)
    if path.suffix == ".toml":
        base = os.path.relpath(path, out.parent)
    warnings = (
        *job.start.assumptions,
        *job.insert.assumptions,
        *job.window.assumptions,
    )
    if job.support_assumed:
        warnings += (SUPPORT_ASSUMED,)
    evidence = job.evidence.model_copy(update={"warnings": warnings})
    values = {"base": base} | job.values
    values["calibration"] = evidence.model_dump(mode="json")
    return f"{comment}\n\n{tomli_w.dumps(values)}"
