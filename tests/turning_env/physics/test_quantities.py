"""The table of quantities, and what follows from it: records, resets, info, observations and the tables of the specification."""

from tests.turning_env.playing import changed, slightly_different, variants
from turning_env import RoughTurningEnv, Scenario
from turning_env.info import INFO_KEYS
from turning_env.physics.quantities import OBSERVATION
from turning_env.physics.records import parameter_records

FURTHER = ("radial_force", "torque", "roughness")
# Read by what scores policies, and by what reads observations, not by the transition.
ELSEWHERE = {"limits.overload_allowance"}
# Prices of money, for advice alone.
ELSEWHERE |= {
    f"economics.{name}"
    for name in ("machine_rate", "operator_rate", "insert_price", "edges_per_insert")
}
ELSEWHERE.add("tool.nose_radius")  # bounds the feed that is advised


# Always 0.
ELSEWHERE |= {
    f"limits.{name}.{key}" for name in FURTHER for key in ("cutting_speed", "time", "wear")
}


def test_no_configured_value_is_dead():
    limited = changed(
        Scenario(),
        limits={name: {"coefficient": 1.0, "feed": 1.0, "depth_of_cut": 0.5} for name in FURTHER},
    )
    nominal = parameter_records(limited).tobytes()
    dead = {
        name
        for name, scenario in variants(limited, slightly_different)
        if parameter_records(scenario).tobytes() == nominal
    }
    assert dead == ELSEWHERE


def test_the_specification_has_the_table_of_the_observation():
    specification = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in (RoughTurningEnv.__doc__ or "").splitlines()
    ]
    entries = [entry for entry in OBSERVATION if entry.present(Scenario())]
    rows = [
        [str(i), entry.name, entry.meaning, f"{entry.low:g} to {entry.high:g}"]
        for i, entry in enumerate(entries)
    ]
    assert [row for row in rows if row not in specification] == []


def test_the_specification_names_every_entry_of_info():
    specification = RoughTurningEnv.__doc__ or ""
    assert [
        name
        for name in INFO_KEYS
        if f"`{name}`" not in specification and f"| {name} " not in specification
    ] == []
