"""Hardness and depth of cut as fields over the bar."""

import math
from typing import Any

import numpy as np
import pytest

from tests.turning_env.physics.one_env import AFTER, ENV, Records, put, records_of
from tests.turning_env.playing import NO_SPREAD, changed
from turning_env import Scenario
from turning_env.numerics.keyed_random import (
    BAR_CHANNEL,
    DEPTH_CHANNEL,
    HARDNESS_CHANNEL,
    standard_normals,
)
from turning_env.physics.workpiece import (
    add_gradient,
    add_skin,
    limit_of_section,
    look_up_fields,
    noise_between,
    position_in_row,
    probe_next_bar,
    section_at,
    set_depth_of_cut,
)
from turning_env.rendering.fields import Fields

WORKPIECE = Scenario().workpiece


def fields(scenario: Scenario, cuts):
    """Return relative hardness [-] and depth of cut [mm] at cut coordinates [mm]."""
    return Fields(scenario).along((0, 0), 0, np.asarray(cuts))


@pytest.mark.compiled
@pytest.mark.parametrize("along", [0.0, 137.3])
@pytest.mark.parametrize("kind", ["bar", "along"])
def test_spreads_are_those_of_the_scenario(along, kind):
    """Over 4000 bars the standard error of a standard deviation is 1.1 %."""
    cuts = np.arange(4000) * WORKPIECE.bar_length + along
    hardness_spread = getattr(WORKPIECE, f"hardness_{kind}_spread")
    depth_spread = getattr(WORKPIECE, f"depth_{kind}_spread")
    workpiece = NO_SPREAD | {
        f"hardness_{kind}_spread": hardness_spread,
        f"depth_{kind}_spread": depth_spread,
    }
    hardness, depth = fields(changed(Scenario(), workpiece=workpiece), cuts)
    log_hardness = np.log(hardness)
    assert log_hardness.std() == pytest.approx(hardness_spread, rel=0.05)
    assert depth.std() == pytest.approx(depth_spread, rel=0.05)
    assert log_hardness.mean() == pytest.approx(0.0, abs=0.1 * hardness_spread)
    assert depth.mean() == pytest.approx(WORKPIECE.depth_of_cut, abs=0.1 * depth_spread)


def test_bars_are_harder_where_the_cut_is_deeper():
    cuts = np.linspace(0.0, 5 * WORKPIECE.bar_length, 200)
    even, depth = fields(Scenario(), cuts)
    graded, _ = fields(changed(Scenario(), mismatch={"hardness_gradient": 0.3}), cuts)
    expected = np.exp(0.15 * (depth / WORKPIECE.depth_of_cut - 1))
    assert graded / even == pytest.approx(expected, rel=1e-9)


def bars(**parameters: Any) -> Records:
    """Return records of bars of 300 mm after 20 mm of air, all of them at one depth of 2 mm."""
    records = records_of()
    put(
        records.p,
        bar_length=300.0,
        approach=20.0,
        bar_pitch=320.0,
        bars_per_path=1.0 / 320.0,
        bars_per_cut=1.0 / 300.0,
        depth_of_cut=2.0,
        depth_bar_spread=0.0,
        depth_along_spread=0.0,
        hardness_bar_spread=0.0,
        hardness_along_spread=0.0,
        depth_nodes_per_length=1.0 / 25.0,
        hardness_nodes_per_length=1.0 / 40.0,
    )
    put(records.p, **parameters)
    put(records.state, seed=8, episode=3, bar=-1.0, pass_ceiling=math.inf)
    put(records.work, engaged=0.1)
    return records


def look_up(records: Records, cut: float) -> None:
    """Look up the fields at a length of metal [mm]."""
    put(records.work, middle=cut)
    look_up_fields(records.state, records.work, ENV, AFTER, records.p)


def normal(records: Records, channel: Any, bar: int, index: int) -> Any:
    """Return the first of the two normal numbers of a use."""
    return standard_normals(records.state, ENV, channel=channel, bar=bar, index=index)[0]


@pytest.mark.parametrize(
    ("path", "cut", "in_metal"),
    [
        pytest.param(0.0, 0.0, False, id="start"),
        pytest.param(19.0, 0.0, False, id="in the air before the first bar"),
        pytest.param(20.0, 0.0, True, id="at its beginning"),
        pytest.param(170.0, 150.0, True, id="in its middle"),
        pytest.param(320.0, 300.0, False, id="at its end"),
        pytest.param(335.0, 300.0, False, id="before the second bar"),
        pytest.param(650.0, 600.0, False, id="before the third"),
        pytest.param(670.0, 610.0, True, id="in the third"),
    ],
)
def test_air_and_metal_take_turns_along_the_path(path: float, cut: float, in_metal: bool) -> None:
    found, metal = position_in_row(bars().p, ENV, path)
    assert found == pytest.approx(cut)
    assert metal == in_metal


SECTIONS = {"depth_sections": 3, "bars_per_cut": 1.0 / 300.0}


@pytest.mark.parametrize(
    ("along", "by_length", "even"),
    [(0.0, 0, 0), (49.9, 0, 0), (50.0, 1, 0), (100.1, 1, 1), (201.0, 2, 2), (300.0, 2, 2)],
)
def test_sections_have_their_lengths_or_the_same(along: float, by_length: int, even: int) -> None:
    p = bars(**SECTIONS).p
    assert section_at(p, ENV, along) == even
    p.has_section_lengths = True
    p.section_starts[:3] = (0.0, 50.0, 200.0)
    assert section_at(p, ENV, along) == by_length


@pytest.mark.parametrize(
    ("path", "speed"),
    [(0.0, 100.0), (69.0, 100.0), (170.0, 120.0), (340.0 + 250.0, 140.0), (360.0, 100.0)],
)
def test_a_section_has_a_highest_speed(path: float, speed: float) -> None:
    p = bars(**SECTIONS).p
    p.section_speeds[:3] = (100.0, 120.0, 140.0)
    assert limit_of_section(p, ENV, path) == speed


def test_a_short_first_section_has_a_speed_of_its_own() -> None:
    p = bars(**SECTIONS, has_section_lengths=True).p
    p.section_starts[:3] = (0.0, 0.5, 200.0)
    p.section_speeds[:3] = (100.0, 120.0, 140.0)
    assert [limit_of_section(p, ENV, path) for path in (20.2, 20.7)] == [100.0, 120.0]


@pytest.mark.parametrize(("share", "noise"), [(0.0, 3.0), (0.5, 0.6 * 3 + 0.8 * -2), (1.0, -2.0)])
def test_noise_blends_two_nodes_along_a_quarter_circle(share: float, noise: float) -> None:
    """Half-way, the weights are those of the triangle of sides 3, 4 and 5."""
    assert noise_between(3.0, -2.0, share) == pytest.approx(noise)


def test_fields_are_offset_and_noise_between_the_nodes_of_a_bar() -> None:
    records = bars(
        hardness_bar_spread=0.08,
        hardness_along_spread=0.05,
        depth_bar_spread=0.25,
        depth_along_spread=0.3,
        log_hardness_mismatch=0.1,
    )
    # In steps, backwards too, so that nodes are kept, passed one by one, and jumped over.
    for cut in (5.0, 30.0, 62.0, 30.0, 130.0, 132.0, 20.0, 310.0, 312.0, 299.0):
        look_up(records, cut)
        bar, along = divmod(cut, 300.0)
        hardness_offset, depth_offset = standard_normals(
            records.state, ENV, channel=BAR_CHANNEL, bar=bar, index=0
        )
        noises = []
        for channel, length in ((HARDNESS_CHANNEL, 40.0), (DEPTH_CHANNEL, 25.0)):
            cell, rest = divmod(along, length)
            left = normal(records, channel, bar, cell)
            right = normal(records, channel, bar, cell + 1)
            angle = 2.0 * math.atan(rest / length)
            noises.append(left * math.cos(angle) + right * math.sin(angle))
        hardness = 0.1 + 0.08 * hardness_offset + 0.05 * noises[0]
        depth = 2.0 + 0.25 * depth_offset + 0.3 * noises[1]
        assert records.state.log_hardness[ENV] == pytest.approx(hardness)
        assert records.state.depth_of_cut[ENV] == pytest.approx(depth)
        assert records.work.along[ENV] == pytest.approx(along)


def test_in_air_the_values_of_the_last_cut_stay() -> None:
    records = bars(depth_along_spread=0.3, hardness_along_spread=0.05)
    put(records.work, engaged=0.0)
    put(records.state, depth_of_cut=1.5, log_hardness=0.2, log_skin_wear=0.3)
    put(records.p, has_skin=True, has_gradient=True, skin_thickness=0.5, skin_hardness=1.4)
    put(records.p, skin_wear=1.5, hardness_gradient=0.3)
    look_up(records, 70.0)
    assert records.state.depth_of_cut[ENV] == 1.5
    assert records.state.log_hardness[ENV] == 0.2
    assert records.state.log_skin_wear[ENV] == 0.3
    assert records.state.bar[ENV] == -1.0


def test_a_field_without_noise_along_the_bar_draws_no_node() -> None:
    records = bars(hardness_along_spread=0.05)
    look_up(records, 5.0)
    assert records.state.hardness_right[ENV] == normal(records, HARDNESS_CHANNEL, 0, 1)
    assert records.state.depth_right[ENV] == 0.0
    records = bars(depth_along_spread=0.05)
    look_up(records, 5.0)
    assert records.state.hardness_right[ENV] == 0.0
    assert records.state.depth_right[ENV] == normal(records, DEPTH_CHANNEL, 0, 1)


@pytest.mark.parametrize(("along", "depth"), [(10.0, 2.0), (150.0, 0.0), (290.0, 1.25)])
def test_sections_have_their_depths_and_0_is_air(along: float, depth: float) -> None:
    records = bars(**SECTIONS)
    records.p.depth_profile[:3] = (2.0, 0.0, 1.25)
    look_up(records, along)
    assert records.state.depth_of_cut[ENV] == depth


@pytest.mark.parametrize(
    ("blank", "floor", "ceiling", "depth"),
    [
        pytest.param(2.2, 0.0, math.inf, 2.2, id="whole blank"),
        pytest.param(2.2, 1.0, math.inf, 1.2, id="down to the floor"),
        pytest.param(2.2, 0.5, 1.5, 1.0, id="between floor and ceiling"),
        pytest.param(0.8, 1.0, math.inf, -0.2, id="air above the blank"),
        pytest.param(-1.0, 0.0, math.inf, 0.02, id="1 % of nominal is scraped"),
    ],
)
def test_a_pass_cuts_what_stands_between_its_floor_and_ceiling(
    blank: float, floor: float, ceiling: float, depth: float
) -> None:
    records = bars()
    put(records.work, blank_depth=blank, nominal_depth=2.0)
    put(records.state, pass_floor=floor, pass_ceiling=ceiling)
    set_depth_of_cut(records.state, records.work, ENV)
    assert records.state.depth_of_cut[ENV] == pytest.approx(depth)


def test_the_depth_ripples_as_the_spindle_turns() -> None:
    records = bars(ripples=True, depth_ripple=0.15, depth_ripples_per_turn=0.5)
    put(records.state, turns=0.5)  # a quarter of a ripple
    look_up(records, 5.0)
    assert records.state.depth_of_cut[ENV] == pytest.approx(2.0 * 1.15)


def test_the_depth_grows_as_the_machine_warms_up() -> None:
    records = bars(warms_up=True, thermal_growth=0.1, warm_up_time=30.0)
    put(records.state, clock=30.0)
    look_up(records, 5.0)
    assert records.state.depth_of_cut[ENV] == pytest.approx(2.0 + 0.1 * (1.0 - math.exp(-1.0)))


@pytest.mark.parametrize(
    ("nominal", "engaged", "change"),
    [
        # 0.5 * 0.3 * (3 / 2 - 1).
        pytest.param(2.0, 0.1, 0.075, id="deeper by half"),
        pytest.param(2.0, 0.0, 0.0, id="in air"),
        pytest.param(0.0, 0.1, 0.0, id="section of air"),
    ],
)
def test_deeper_cuts_are_harder(nominal: float, engaged: float, change: float) -> None:
    records = bars(hardness_gradient=0.3)
    put(records.work, nominal_depth=nominal, engaged=engaged)
    put(records.state, depth_of_cut=3.0, log_hardness=0.1)
    add_gradient(records.state, records.work, ENV, records.p)
    assert records.state.log_hardness[ENV] == pytest.approx(0.1 + change)


@pytest.mark.parametrize(
    ("floor", "ceiling", "depth", "share"),
    [
        # A blank of 2 mm, of which the outermost 0.5 mm are skin.
        pytest.param(0.0, math.inf, 2.0, 0.25, id="whole blank"),
        pytest.param(1.0, math.inf, 1.0, 0.5, id="first pass"),
        pytest.param(1.75, math.inf, 0.25, 1.0, id="within the skin"),
        pytest.param(1.0, 1.7, 0.7, 2.0 / 7.0, id="up to a ceiling in the skin"),
        pytest.param(0.0, 1.0, 1.0, 0.0, id="below the skin"),
        pytest.param(2.5, math.inf, -0.5, 0.0, id="above the blank"),
    ],
)
def test_skin_counts_by_its_share_of_the_cut(
    floor: float, ceiling: float, depth: float, share: float
) -> None:
    records = bars(skin_thickness=0.5, skin_hardness=1.4, skin_wear=1.8)
    put(records.work, blank_depth=2.0)
    put(records.state, depth_of_cut=depth, log_hardness=0.1, log_skin_wear=9.0)
    put(records.state, pass_floor=floor, pass_ceiling=ceiling)
    add_skin(records.state, records.work, ENV, records.p)
    assert records.state.log_hardness[ENV] == pytest.approx(0.1 + math.log(1.0 + 0.4 * share))
    assert records.state.log_skin_wear[ENV] == pytest.approx(math.log(1.0 + 0.8 * share))


def test_gradient_and_skin_count_where_the_scenario_has_them() -> None:
    plain = bars()
    look_up(plain, 5.0)
    assert plain.state.log_hardness[ENV] == 0.0
    full = bars(has_skin=True, skin_thickness=0.5, skin_hardness=1.4, skin_wear=1.8)
    put(full.p, has_gradient=True, hardness_gradient=0.3, ripples=True, depth_ripple=0.5)
    put(full.p, depth_ripples_per_turn=1.0)
    put(full.state, turns=0.25)
    look_up(full, 5.0)
    # The blank has 3 mm, half as much again: the gradient adds 0.075.
    expected = 0.075 + math.log(1.0 + 0.4 * 0.5 / 3.0)
    assert full.state.log_hardness[ENV] == pytest.approx(expected)


@pytest.mark.parametrize("path", [2.0 * 320.0 - 1e-6, 2.0 * 320.0 + 1e-6])
@pytest.mark.parametrize("spread", [0.25, 40.0, -40.0])
def test_the_next_blank_is_probed_between_parts(path: float, spread: float) -> None:
    records = bars(depth_bar_spread=spread)
    put(records.state, path=path)
    _, depth = standard_normals(records.state, ENV, channel=BAR_CHANNEL, bar=2, index=0)
    probe_next_bar(records.state, ENV, records.p)
    expected = max(2.0 + spread * depth, 0.02)
    assert records.state.probed_depth[ENV] == pytest.approx(expected)
