"""The records that the transition works on."""

from tests.turning_env.playing import slightly_different, variants
from turning_env import RoughTurningEnv, Scenario
from turning_env.physics.records import REPORT_FIELDS, parameter_records

# Read by what scores policies, and by what reads observations, not by the transition.
ELSEWHERE = {"limits.overload_allowance", "machine.rated_power"}


def test_no_configured_value_is_dead():
    nominal = parameter_records(Scenario()).tobytes()
    dead = {
        name for name, scenario in variants(Scenario(), slightly_different) if parameter_records(scenario).tobytes() == nominal
    }
    assert dead == ELSEWHERE


def test_the_specification_names_every_entry_of_info():
    specification = RoughTurningEnv.__doc__ or ""
    missing = [name for name in REPORT_FIELDS if f"`{name}`" not in specification and f"| {name} " not in specification]
    assert missing == []
