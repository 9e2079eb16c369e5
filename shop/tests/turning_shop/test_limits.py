"""The spindle's curve, the bar's bending and the surface limit every command alike."""

import json
from pathlib import Path

import numpy as np
import pytest
from turning_shop import WorkshopError
from turning_shop.__main__ import main
from turning_shop.advise import MIN_COST, advise, best_plan, headline, tried_plans
from turning_shop.advise_play import clocked
from turning_shop.allowed import (
    MAX_DEFLECTION,
    allowed_loads,
    feed_range,
    limited_by_strength,
    theoretical_roughness,
    without_bending,
)
from turning_shop.plots import draw_map
from turning_shop.prediction import Evidence
from turning_shop.provenance import load
from turning_shop.whatif import Cuts, what_if

from turning_env import Scenario, ScenarioError

PROGRAM = "G21 G99 T0101\nG50 S4000\nG96 S120 M3\nG0 X41. Z2.\nG1 Z-150. F0.3\nG0 X100.\nZ5.\nM30\n"
SLENDER = """
[workpiece]
diameter = 45.0
bar_length = 300.0
depth_of_cut = 2.0
support = "chuck"
[tool]
nose_radius = 1.2
"""


@pytest.fixture
def slender(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Scenario:
    """Return the scenario of ``slender.toml``, in the current folder with ``part.nc``."""
    monkeypatch.chdir(tmp_path)
    Path("slender.toml").write_text(SLENDER)
    Path("part.nc").write_text(PROGRAM)
    return load("slender.toml")[0]


def cheapest(scenario: Scenario) -> Cuts:
    """Return the cheapest cut within the limits."""
    best = best_plan(
        scenario,
        Evidence(),
        tried_plans(scenario, Evidence()),
        aim=MIN_COST,
    )
    assert best
    return best.cuts


def test_below_the_base_speed_the_spindle_has_less_power() -> None:
    scenario = Scenario.load(
        {
            "spindle": {"base_speed": 700.0},
            "limits": {"power": 5.0, "thrust_force": 1e6},
            "tool": {"edge_strength": 1e6},
        }
    )
    best = advise(scenario, Evidence())[0]
    cuts = best.plan.cuts
    assert cuts.spindle_speed < 700.0
    assert cuts.power <= 5.0 * cuts.spindle_speed / 700.0
    (bound,) = [bound for bound in best.bounds if bound.name == "limits.power"]
    assert "below spindle.base_speed" in bound.limit


def test_a_bar_in_the_chuck_bends_as_a_cantilever(slender: Scenario) -> None:
    inertia = np.pi * 45.0**4 / 64.0
    per_newton = 300.0**3 / (3.0 * 210_000.0 * inertia)
    force = MAX_DEFLECTION / (0.7 * per_newton)
    assert allowed_loads(slender).thrust_force == pytest.approx(force)
    assert allowed_loads(slender).by_deflection
    assert cheapest(slender).thrust_force <= force


def test_a_tailstock_holds_more_and_a_rigid_bar_does_not_bend(slender: Scenario) -> None:
    forces = []
    for support in ("chuck", "tailstock", "rigid"):
        work = slender.workpiece.model_copy(update={"support": support})
        held = slender.model_copy(update={"workpiece": work})
        forces.append(allowed_loads(held).thrust_force)
    assert forces[1] > 10.0 * forces[0]
    assert forces[2] == np.inf


def with_fields(scenario: Scenario, section: str, **values: float | str) -> Scenario:
    """Return a scenario with other values in a section."""
    changed = getattr(scenario, section).model_copy(update=values)
    return scenario.model_copy(update={section: changed})


def test_a_boring_bar_bends_as_a_cantilever_beside_the_bar(slender: Scenario) -> None:
    holder = {"overhang": 120.0, "shank_diameter": 25.0}
    bored = with_fields(slender, "tool", **holder)
    both = allowed_loads(bored).thrust_force
    bar = allowed_loads(slender).thrust_force
    rigid_bar = with_fields(bored, "workpiece", support="rigid")
    tool = allowed_loads(rigid_bar).thrust_force
    per_newton = 120.0**3 / (3.0 * 210_000.0 * np.pi * 25.0**4 / 64.0)
    assert tool == pytest.approx(MAX_DEFLECTION / (0.7 * per_newton))
    # Compliances add, and so do the reciprocal forces.
    assert 1.0 / both == pytest.approx(1.0 / bar + 1.0 / tool)


def test_a_shorter_overhang_of_the_bar_is_stiffer_by_its_cube(slender: Scenario) -> None:
    longer = with_fields(slender, "workpiece", overhang=450.0)
    ratio = allowed_loads(slender).thrust_force / allowed_loads(longer).thrust_force
    assert ratio == pytest.approx(1.5**3)


def test_an_overhang_without_its_diameter_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"tool\.shank_diameter"):
        Scenario.load({"tool": {"overhang": 100.0}})


def test_a_bar_that_is_cut_beyond_its_overhang_is_refused(slender: Scenario) -> None:
    Path("short.toml").write_text(SLENDER.replace("[tool]", "overhang = 80.0\n[tool]"))
    with pytest.raises(WorkshopError, match=r"workpiece\.overhang is 80 mm"):
        load("short.toml")


def test_assumed_and_long_overhangs_are_said(slender: Scenario) -> None:
    warnings = "\n".join(load("slender.toml")[1].warnings)
    assert "workpiece.overhang: the bar is taken as free over workpiece.bar_length" in warnings
    stated = SLENDER.replace("[tool]", "overhang = 310.0\n[tool]")
    Path("stated.toml").write_text(f"{stated}overhang = 130.0\nshank_diameter = 25.0\n")
    warnings = "\n".join(load("stated.toml")[1].warnings)
    assert "taken as free" not in warnings
    assert "tool.overhang is 5.2 diameters" in warnings
    assert "it bends the bar over workpiece.bar_length, and no tool" in warnings


def test_bending_limits_the_thrust_force_in_the_simulation(slender: Scenario) -> None:
    best = best_plan(
        slender,
        Evidence(),
        tried_plans(slender, Evidence()),
        aim=MIN_COST,
    )
    assert best
    force = allowed_loads(slender).thrust_force
    assert clocked(slender, best).limits.thrust_force == pytest.approx(force)

    # Bars that vary keep the limit for the allowed share of the time, as they keep others.
    varied = with_fields(slender, "workpiece", depth_along_spread=1.0)
    played = clocked(varied, best)
    assert played.limits.thrust_force > 1.02 * force
    factor = allowed_loads(without_bending(played)).overload_factors["thrust_force"]
    assert factor * played.limits.thrust_force == pytest.approx(force)


def test_an_overhang_of_the_tool_binds_the_advice_and_is_named(slender: Scenario) -> None:
    holder = {"overhang": 150.0, "shank_diameter": 20.0}
    bored = with_fields(slender, "tool", **holder)
    bored = with_fields(bored, "workpiece", support="rigid")
    best = advise(bored, Evidence())
    (bound,) = [bound for bound in best[0].bounds if bound.name == "tool.overhang"]
    assert "the tool bends by 0.1 mm" in bound.limit


def test_the_strength_of_edges_limits_programs_whose_scenario_has_a_slender_bar(
    slender: Scenario,
) -> None:
    Path("strong.toml").write_text(f"{SLENDER}edge_strength = 2000.0\n")
    strong, _ = load("strong.toml")
    assert allowed_loads(strong).by_deflection
    limited, note = limited_by_strength(strong)
    assert "tool.edge_strength" in note
    assert limited.limits.thrust_force < 2000.0


def test_overhangs_limit_programs_in_place_of_the_stock(
    slender: Scenario, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("shapely")
    stated = SLENDER.replace("[tool]", "overhang = 200.0\n[tool]")
    Path("stated.toml").write_text(f"{stated}overhang = 120.0\nshank_diameter = 25.0\n")
    command = ["program", "part.nc", "--stock", "bar:45x300", "--json", "--scenario"]
    notes = []
    for name in ("slender.toml", "stated.toml"):
        assert main([*command, name]) == 0
        notes.append("\n".join(json.loads(capsys.readouterr().out)["notes"]))
    assert "free over 300 mm, its whole length (assumption: workpiece.overhang)" in notes[0]
    assert "bar and tool bend by 0.1 mm" in notes[1]
    assert "free over 200 mm" in notes[1]


def test_the_bending_binds_the_advice_and_is_named(slender: Scenario) -> None:
    best = advise(slender, Evidence())
    (bound,) = [bound for bound in best[0].bounds if bound.name == "workpiece.support"]
    assert bound.without.cost < best[0].plan.cost
    assert "chuck" in "\n".join(headline(slender, Evidence(), best))
    work = slender.workpiece.model_copy(update={"bar_length": 900.0})
    with pytest.raises(WorkshopError, match="or support the bar"):
        advise(slender.model_copy(update={"workpiece": work}), Evidence())


def test_the_bending_limits_programs_by_their_stock(
    slender: Scenario, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("shapely")
    command = ["program", "part.nc", "--scenario", "slender.toml", "--stock", "bar:45x300"]
    assert main([*command, "--wear", "0.3", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    force = float(what_if(slender, 120.0, 0.3, wear=0.3).thrust_force)
    share = force / allowed_loads(slender).thrust_force
    assert result["totals"]["max_load"] == pytest.approx(share, rel=0.01)
    assert any("workpiece.support" in note for note in result["notes"])


NOSE_RADIUS = 1.2  # of ``slender`` [mm]
ROUGHNESS = 6.0  # limit [um]


@pytest.mark.slow
def test_a_roughness_limits_the_feed_of_advice_and_map(slender: Scenario) -> None:
    limited, _ = load("slender.toml", roughness=ROUGHNESS)
    low, high = feed_range(limited)
    assert theoretical_roughness(high, NOSE_RADIUS) == pytest.approx(ROUGHNESS)
    assert low <= cheapest(limited).feed <= high * (1 + 1e-9)
    axes = draw_map(limited, Evidence(), wear=0.1).axes[0]
    _, highest_drawn = axes.get_ylim()
    assert highest_drawn == pytest.approx(high)


def test_a_cut_that_is_too_rough_is_noted(
    slender: Scenario, capsys: pytest.CaptureFixture[str]
) -> None:
    cuts = ["--cutting-speed", "120", "--feed", "0.3", "--wear", "0.1"]
    assert main(["whatif", "slender.toml", *cuts, "--roughness", "6"]) == 0
    assert "limits.roughness, 6 um" in capsys.readouterr().err


ROUGH_PROGRAM = [
    "program",
    "part.nc",
    "--scenario",
    "slender.toml",
    "--stock",
    "bar:45x300",
    "--roughness",
    "6",
]


def test_a_program_that_is_too_rough_is_noted(
    slender: Scenario, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("shapely")
    assert main([*ROUGH_PROGRAM, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    roughness = theoretical_roughness(0.3, NOSE_RADIUS)
    assert result["totals"]["max_roughness"] == pytest.approx(roughness)
    assert any("above 0.24 mm/rev, limits.roughness" in note for note in result["notes"])


def test_an_adapted_program_uses_the_roughness_and_keeps_to_it(
    slender: Scenario, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("shapely")
    # Of the first cut nothing is left, so that its feed may change.
    first = PROGRAM.replace("F0.3", "F0.12").replace("X41.", "X44.")
    last = "G0 X46.\nZ2.\nX43.\nG1 Z-20. F0.1\nG0 X46.\nX42.\nG1 Z-150.\nG0 X100."
    Path("part.nc").write_text(first.replace("G0 X100.", last))
    assert main([*ROUGH_PROGRAM, "--adapt", "words", "--json"]) == 0
    adapted = json.loads(capsys.readouterr().out)["adapted"]
    assert 2.0 < adapted["totals"]["max_roughness"] <= ROUGHNESS + 1e-6


def test_a_roughness_needs_a_nose_radius() -> None:
    with pytest.raises(WorkshopError, match="needs the nose radius"):
        load("rough_turning", roughness=6.0)
