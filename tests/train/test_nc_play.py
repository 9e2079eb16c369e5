"""A program, read back and played, repeats its original."""

import itertools
from functools import cache

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baselines import catalogue
from train.nc import interval_table, laws, simulate_law
from turning_env import Scenario
from turning_nc import schedule, simulate
from turning_nc.program import Block, NcError, Program
from turning_nc.read import read
from turning_nc.schedule import Segment, bars_of
from turning_nc.synchronous import LOAD, Law
from turning_nc.write import write

SCENARIO, OVERRIDES = Scenario.load("rough_turning"), Scenario.load("override")


def written_and_read(program: Program) -> Program:
    back = read(write(program))
    assert back == program
    return back


@pytest.mark.parametrize(
    ("preset", "rule", "bars", "tolerance"),
    [
        ("rough_turning", "rescaled_grid_search", 1, 0.0),
        pytest.param("rough_turning", "fixed_handbook", 30, 0.01, marks=pytest.mark.slow),  # to the end of the edge
        ("paper", "grid_search", 2, 0.01),
        pytest.param("override", "omative", 1, 0.01, marks=pytest.mark.slow),
    ],
)
def test_a_schedule_does_what_the_controller_did(preset: str, rule: str, bars: int, tolerance: float) -> None:
    scenario = Scenario.load(preset)
    program, original = schedule.play_schedule(catalogue.spec(rule, scenario).make, scenario, 11, bars, tolerance)
    simulated = simulate.simulate(written_and_read(program), scenario, 11)
    assert simulated.difference(original) < 0.01
    assert original.removed > 30.0
    assert len(program.bars) <= bars


def test_more_tolerance_means_fewer_blocks_that_end_at_the_same_place() -> None:
    make = catalogue.spec("rescaled_grid_search", SCENARIO).make
    programs = [schedule.play_schedule(make, SCENARIO, 11, 2, tolerance)[0] for tolerance in (0.0, 0.03, 1.0)]
    counts = [program.blocks for program in programs]
    assert counts[0] > counts[1] > counts[2] >= 2
    for program in programs:
        assert [bar[-1].z for bar in program.bars] == [-300.0, -300.0]
    assert {block.z for bar in programs[1].bars for block in bar} <= {block.z for bar in programs[0].bars for block in bar}


@pytest.mark.slow
@given(
    st.lists(st.tuples(st.floats(0.0005, 200), st.floats(50, 200), st.floats(0.06, 0.6)), min_size=1, max_size=30),
    st.floats(0, 0.2),
)
def test_blocks_cover_the_course_within_the_machines_range(course: list[tuple[float, float, float]], tolerance: float) -> None:
    segments = [Segment(length, length / (speed * feed), speed, feed) for length, speed, feed in course]
    path = sum(segment.length for segment in segments)
    bars = bars_of(SCENARIO, segments, tolerance)
    covered = sum(3.0 - bar[-1].z for bar in bars)
    assert covered == pytest.approx(path, abs=0.003)
    if bars:
        Program.of(SCENARIO, bars)  # raises where anything is outside the range
    speeds = [block.cutting_speed for bar in bars for block in bar]
    given = [speed for _, speed, _ in course]
    assert all(min(given) - 0.06 <= speed <= max(given) + 0.06 for speed in speeds)


def test_a_program_of_another_machine_or_bar_is_refused() -> None:
    block = Block(-300.0, 150.0, 0.3)
    fitting = Program.of(SCENARIO, ((block,),))
    for wrong, complaint in (
        (Program.of(OVERRIDES, ((Block(-100.0, 120.0, 0.3),),)), "diameter is 60.0 mm"),
        (Program(100.0, 2.0, 636.6, fitting.bars), "first position is 2.0 mm"),
        (Program(100.0, 3.0, 700.0, fitting.bars), "LIMS is 700.0 rev/min, but the machine's highest is 636.6"),
        (Program(100.0, 3.0, 636.6, ((Block(-300.0, 200.1, 0.3),),)), "cutting speed is 200.1, but the machine's range is 50"),
        (Program(100.0, 3.0, 636.6, ((Block(-300.0, 150.0, 0.601),),)), "feed is 0.601"),
        (Program(100.0, 3.0, 636.6, ((Block(-301.0, 150.0, 0.3),),)), "Z is -301.0"),
        (Program(100.0, 3.0, 636.6, ((Block(-200.0, 150.0, 0.3),), (block,))), "bar 1 ends at Z-200.0"),
        (Program(100.0, 3.0, 636.6, ()), "at least one bar"),
    ):
        with pytest.raises(NcError, match=complaint):
            simulate.simulate(wrong, SCENARIO, 1)
    assert simulate.simulate(fitting, SCENARIO, 1).removed > 100.0


@pytest.mark.parametrize(
    ("preset", "interval"),
    [pytest.param("rough_turning", None, marks=pytest.mark.slow), ("rough_turning", 1.0), ("paper", 0.5)],
)
def test_the_interval_table_does_on_nominal_bars_what_the_models_say(preset: str, interval: float | None) -> None:
    scenario = Scenario.load(preset)
    rows = interval_table.interval_table(scenario, interval)
    assert rows[0].start == 0.0
    for before, after in itertools.pairwise(rows):
        assert before.end == after.start
        assert before.wear < after.wear <= scenario.tool.wear_criterion
        assert (before.cutting_speed, before.feed) != (after.cutting_speed, after.feed)
    program, original = interval_table.program_of(scenario, rows)
    simulated = simulate.simulate(written_and_read(program), interval_table.without_spreads(scenario), 0)
    assert simulated.difference(original) < 0.005
    notes = [block.note for bar in program.bars for block in bar if block.note]
    assert len(notes) == len(rows)
    assert notes[-1].startswith(f"section {len(rows)}: ")


@pytest.mark.slow
@pytest.mark.parametrize("rule", laws.LAWS)
def test_a_law_does_what_the_rule_does(rule: str) -> None:
    program = written_and_read(laws.law_program(rule, OVERRIDES))
    compared = simulate_law.compare(program, catalogue.spec(rule, OVERRIDES).make, OVERRIDES, 11)
    assert compared.largest_difference < 0.5
    assert compared.mean_difference < 0.05
    assert compared.steps > 1000
    assert compared.simulated.difference(compared.original) < 0.005
    assert simulate_law.simulate_law(program, OVERRIDES, 11) == compared.simulated


@cache
def law_of(rule: str) -> Law:
    law = written_and_read(laws.law_program(rule, OVERRIDES)).law
    assert law is not None
    return law


def test_the_one_line_law_is_the_manuals_example() -> None:
    assert "FCTDEF(1,1.0,120.0,160.0,-2.0,0.0,0.0)\n" in write(laws.law_program("one_line_law", OVERRIDES))
    law = law_of("one_line_law")
    for load, override in ((10.0, 120.0), (30.0, 100.0), (55.0, 50.0), (79.9, 1.0), (100.0, 1.0)):
        assert law.cycle({LOAD: load}) == pytest.approx(max(override, 1.0))


@given(st.sampled_from(tuple(laws.LAWS)), st.lists(st.tuples(st.floats(0, 1000), st.floats(0, 500)), min_size=1, max_size=20))
def test_no_law_leaves_the_machines_range(rule: str, measured: list[tuple[float, float]]) -> None:
    law = law_of(rule)
    variables = law.variables() | {"$AA_S[1]": 710.0}
    machine = OVERRIDES.machine
    for load, velocity in measured:
        variables |= {LOAD: load, "$AC_VACTB": velocity}
        feed = 0.4 * 0.01 * law.cycle(variables)
        assert machine.feed_min - 1e-12 <= feed <= machine.feed_max + 1e-12


def test_a_law_that_leaves_the_range_or_divides_by_zero_is_refused_in_play() -> None:
    text = write(laws.law_program("one_line_law", OVERRIDES))
    for effect, complaint in (("$AC_OVR=0.5", "sets a feed of 0.002000"), ("$AC_OVR=1.0/$AC_PARAM[0]", "divides by 0")):
        wrong = read(text.replace("SYNFCT(1,$AC_OVR,$AA_LOAD[S1])", effect))
        with pytest.raises(NcError, match=complaint):
            simulate_law.simulate_law(wrong, OVERRIDES, 11)
