"""The table of quantities, and the records, info and specification that follow from it."""

from tests.turning_env.playing import changed, slightly_different, variants
from turning_env import RoughTurningEnv, Scenario
from turning_env.info import INFO_KEYS
from turning_env.physics.quantities import OBSERVATION
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
