"""The table of quantities, and the records, info and specification that follow from it."""

import pytest

from tests.turning_env.playing import changed, slightly_different, variants
from turning_env import RoughTurningEnv, Scenario
from turning_env.info import INFO_KEYS
from turning_env.physics.quantities import (
    INFO,
    OBS,
    OBSERVATION,
    REPORT,
    ROW,
    WIDTH,
    action_size,
    layout,
)
from turning_env.physics.records import parameter_records

FURTHER_LIMITS = ("radial_force", "torque", "roughness")

READ_ELSEWHERE = {
    # Read when a program or a shop is advised: losses of the spindle's drive, prices of money, the
    # bound of an advised feed, and what bends.
    "spindle.efficiency",
    "economics.machine_rate",
    "economics.operator_rate",
    "economics.insert_price",
    "economics.edges_per_insert",
    "tool.nose_radius",
    "tool.overhang",
    "tool.shank_diameter",
    "tool.shank_modulus",
    "workpiece.overhang",
}
for limit in FURTHER_LIMITS:
    # Further limits depend on feed, depth and hardness only; these exponents must be 0.
    absent = ("cutting_speed", "time", "wear", "wear_growth")
    READ_ELSEWHERE |= {f"limits.{limit}.{name}" for name in absent}


def test_every_configured_value_reaches_the_transition():
    law = {"coefficient": 1.0, "feed": 1.0, "depth_of_cut": 0.5}
    scenario = changed(Scenario(), limits=dict.fromkeys(FURTHER_LIMITS, law))
    parameters = parameter_records(scenario).tobytes()
    unread = set()
    for name, variant in variants(scenario, slightly_different):
        if parameter_records(variant).tobytes() == parameters:
            unread.add(name)
    assert unread == READ_ELSEWHERE


def test_the_specification_has_the_table_of_the_observation():
    rows_of_specification = []
    for line in (RoughTurningEnv.__doc__ or "").splitlines():
        cells = line.split("|")[1:-1]
        rows_of_specification.append([cell.strip() for cell in cells])
    entries = [entry for entry in OBSERVATION if entry.present(Scenario())]
    assert len(entries) == 11
    for i, entry in enumerate(entries):
        row = [str(i), entry.name, entry.meaning, f"{entry.low:g} to {entry.high:g}"]
        assert row in rows_of_specification


def test_the_specification_names_every_entry_of_info():
    specification = RoughTurningEnv.__doc__ or ""
    for name in INFO_KEYS:
        assert f"`{name}`" in specification or f"| {name} " in specification, name


ALWAYS = (
    ("power", -5.0, 15.0),
    ("thrust_force", -5.0, 15.0),
    ("cutting_speed", -1.0, 1.0),
    ("feed", -1.0, 1.0),
    ("commanded_cutting_speed", -1.0, 1.0),
    ("commanded_feed", -1.0, 1.0),
    ("cutting_time", 0.0, 12.0),
    ("nominal_wear", 0.0, 4.0),
    ("power_ratio", -5.0, 15.0),
    ("force_ratio", -5.0, 15.0),
    ("cutting", 0.0, 1.0),
)
# Entries of some scenarios, in order, with the values that show them.
OPTIONAL = (
    ("spindle_heat", 0.0, 4.0, {"spindle": {"short_time_load": 1.2}}),
    ("roughness_reference", -1.0, 1.0, {"control": {"aim": "roughness"}}),
    ("probed_depth", -5.0, 15.0, {"sensors": {"probe": True}}),
    (
        "removed_wear",
        0.0,
        4.0,
        {"sensors": {"inspects_edges": True}, "control": {"edge_changes": "automatic"}},
    ),
    ("tangles", 0.0, 4.0, {"sensors": {"counts_tangles": True}}),
)
HIDDEN = (
    ("hardness", -5.0, 15.0),
    ("depth_of_cut", -5.0, 15.0),
    ("wear", 0.0, 4.0),
    ("wear_factor", -5.0, 15.0),
    ("edge_strength", -5.0, 15.0),
)


def test_the_entries_of_an_observation_have_their_ranges() -> None:
    optional = [entry[:3] for entry in OPTIONAL]
    expected = [*ALWAYS, *optional, *HIDDEN]
    # Entries that have been added since then do not concern these.
    names = {name for name, _, _ in expected}
    listed = [(entry.name, entry.low, entry.high) for entry in OBSERVATION if entry.name in names]
    assert listed == expected
    assert layout(Scenario()) == tuple(name for name, _, _ in ALWAYS)


@pytest.mark.parametrize(("name", "low", "high", "sections"), OPTIONAL)
def test_a_scenario_shows_the_entries_that_it_has(
    name: str, low: float, high: float, sections: dict[str, dict[str, object]]
) -> None:
    scenario = Scenario()
    # Without validation: most of these entries need more than the one value.
    for section, values in sections.items():
        chosen = getattr(scenario, section).model_copy(update=values)
        scenario = scenario.model_copy(update={section: chosen})
    shown = layout(scenario)
    assert set(shown) - set(layout(Scenario())) == {name}
    assert low < high


def test_the_hidden_state_can_be_observed() -> None:
    shown = layout(changed(Scenario(), sensors={"observes_all": True}))
    assert shown[len(ALWAYS) :] == tuple(name for name, _, _ in HIDDEN)


@pytest.mark.parametrize(
    ("control", "size"),
    [
        ({"action": "incremental"}, 2),
        ({"action": "set_point"}, 2),
        ({"action": "override"}, 1),
        ({"action": "set_point", "edge_changes": "commanded"}, 3),
        ({"action": "override", "edge_changes": "commanded"}, 2),
        ({"action": "part", "passes_max": 3}, 8),
    ],
)
def test_an_action_has_as_many_numbers_as_it_sets(control: dict[str, object], size: int) -> None:
    scenario = Scenario()
    chosen = scenario.control.model_copy(update=control)
    assert action_size(scenario.model_copy(update={"control": chosen})) == size


def test_places_are_those_of_the_tables() -> None:
    assert OBS._fields == tuple(entry.name for entry in OBSERVATION)
    assert tuple(OBS) == tuple(range(len(OBSERVATION)))
    assert ROW._fields == tuple(quantity.name for quantity in REPORT)
    assert ROW.reward == len(INFO)
    assert WIDTH == 32
