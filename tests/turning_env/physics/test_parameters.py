"""The table of parameters: names and units."""

import math
from operator import attrgetter
from typing import Any

import numpy as np
import pytest

from tests.turning_env.physics.one_env import ENV
from tests.turning_env.playing import changed
from turning_env import Scenario
from turning_env.physics.parameters import PARAMETERS, by_name
from turning_env.physics.quantities import AUTOMATIC, COMMANDED, END, OBS, OVERRIDE, WIDTH, layout
from turning_env.physics.records import parameter_records
from turning_env.physics.wear import CLOCK_TIME


def test_two_parameters_of_one_name_are_refused():
    (feed,) = [parameter for parameter in PARAMETERS if parameter.name == "feed_max"]
    other = feed._replace(field="swarf.feed_max")
    with pytest.raises(
        ValueError,
        match=r"two parameters are named 'feed_max': machine.feed_max and swarf.feed_max",
    ):
        by_name([feed, other])


def test_every_parameter_has_a_name_of_its_own():
    assert len(by_name(PARAMETERS)) == len(PARAMETERS)


def test_fields_have_the_units_of_their_sections():
    parameters = by_name(PARAMETERS)
    assert parameters["feed_max"].unit == "mm/rev"
    assert parameters["depth_profile"].unit == "mm"
    assert parameters["probe"].unit == "-"


@pytest.mark.parametrize("name", ["feed_max", "tangle_time", "overload_price", "warm_up_time"])
def test_a_field_is_read_from_its_section(name):
    parameter = by_name(PARAMETERS)[name]
    section, field = parameter.field.split(".")
    scenario = Scenario()
    expected = getattr(getattr(scenario, section), field)
    assert parameter_records(scenario)[name][0].tolist() == [expected] * WIDTH


def parameters_of(**sections: dict[str, Any]) -> Any:
    """Return the parameters of v0 with some values replaced."""
    return parameter_records(changed(Scenario(), **sections))[0]


DERIVED = [
    ("life_exponent", {}, 1.0 / 0.245),
    ("log_wear_criterion", {"tool": {"wear_criterion": 0.2}}, math.log(0.2)),
    (
        "initial_used_life",
        {"tool": {"wear_criterion": 0.4}, "mismatch": {"initial_wear": 0.1}},
        0.25 ** (1.0 / 0.245),
    ),
    ("initial_used_life", {}, 0.0),
    ("log_wear_mismatch", {"mismatch": {"wear_factor": 1.3}}, math.log(1.3)),
    ("log_hardness_mismatch", {"mismatch": {"hardness_factor": 1.2}}, math.log(1.2)),
    (
        "log_collapse_temperature",
        {"edge_failure": {"collapse_temperature": 900.0}},
        math.log(900.0),
    ),
    ("log_built_up_speed", {"edge_failure": {"built_up_speed": 90.0}}, math.log(90.0)),
    ("log_cutting_speed_min", {"machine": {"cutting_speed_min": 60.0}}, math.log(60.0)),
    ("log_feed_min", {"machine": {"feed_min": 0.08}}, math.log(0.08)),
    (
        "cutting_speed_scale",
        {"machine": {"cutting_speed_min": 50.0, "cutting_speed_max": 400.0}},
        2.0 / math.log(8.0),
    ),
    ("feed_scale", {"machine": {"feed_min": 0.1, "feed_max": 0.5}}, 2.0 / math.log(5.0)),
    # 1000 rev/min at 80 mm.
    (
        "reachable_cutting_speed",
        {"spindle": {"max_speed": 600.0}, "workpiece": {"diameter": 80.0}},
        0.048 * 1000.0 * math.pi,
    ),
    ("sub_step", {"control": {"interval": 3.0, "sub_steps": 6}}, 0.5 / 60.0),
    (
        "spindle_share",
        {
            "control": {"interval": 3.0, "sub_steps": 6},
            "machine": {"spindle_time_constant": 0.25},
        },
        1.0 - math.exp(-2.0),
    ),
    ("feed_share", {"machine": {"feed_time_constant": 0.0}}, 1.0),
    (
        "power_sensor_share",
        {"control": {"interval": 3.0, "sub_steps": 6}, "sensors": {"power_time_constant": 1.0}},
        1.0 - math.exp(-0.5),
    ),
    (
        "force_sensor_share",
        {"control": {"interval": 3.0, "sub_steps": 6}, "sensors": {"force_time_constant": 2.0}},
        1.0 - math.exp(-0.25),
    ),
    ("steps_late", {"control": {"interval": 2.0}, "machine": {"command_delay": 3.0}}, 1.5),
    # pi * 100 mm at 500 rev/min, in m/min.
    (
        "log_chatter_cutting_speed",
        {"machine": {"chatter_speed": 500.0}, "workpiece": {"diameter": 100.0}},
        math.log(50.0 * math.pi),
    ),
    # 10 N m at 50 rad/s over 120 m/min (80 mm).
    (
        "idle_power_per_speed",
        {"spindle": {"idle_torque": 10.0}, "workpiece": {"diameter": 80.0}},
        0.5 / 120.0,
    ),
    (
        "capacity_per_speed",
        {"spindle": {"base_speed": 400.0}, "workpiece": {"diameter": 100.0}},
        1.0 / (40.0 * math.pi),
    ),
    ("capacity_per_speed", {}, 1e9),
    # Torque over force 0.012 m / (2 pi 0.8), over current 1.5 * 3 * 0.1 N m/A.
    (
        "current_per_newton",
        {
            "feed_drive": {
                "screw_lead": 12.0,
                "efficiency": 0.8,
                "pole_pairs": 3,
                "flux_linkage": 0.1,
            }
        },
        0.012 / (1.6 * math.pi) / 0.45,
    ),
    # Friction of 100 N, and 1000 N preload * (1 - 0.9^2).
    (
        "no_load_current",
        {
            "feed_drive": {
                "screw_lead": 12.0,
                "efficiency": 0.8,
                "pole_pairs": 3,
                "flux_linkage": 0.1,
                "guide_friction": 100.0,
                "preload": 1000.0,
                "screw_efficiency": 0.9,
            }
        },
        290.0 * 0.012 / (1.6 * math.pi) / 0.45,
    ),
    ("current_ripple", {"feed_drive": {"ripple": 0.07}}, 0.07),
    ("ripples_per_path", {"feed_drive": {"ripples_per_turn": 6.0, "screw_lead": 12.0}}, 0.5),
    ("path_end", {"workpiece": {"bars": 4, "bar_length": 200.0, "approach": 5.0}}, 820.0),
    ("path_end", {"workpiece": {"bars": 0}}, math.inf),
    ("bar_pitch", {"workpiece": {"bar_length": 200.0, "approach": 5.0}}, 205.0),
    ("bars_per_path", {"workpiece": {"bar_length": 200.0, "approach": 5.0}}, 1.0 / 205.0),
    ("bars_per_cut", {"workpiece": {"bar_length": 200.0}}, 1.0 / 200.0),
    ("revolutions_per_metre", {"workpiece": {"diameter": 80.0}}, 12.5 / math.pi),
    ("log_depth_of_cut", {"workpiece": {"depth_of_cut": 2.0}}, math.log(2.0)),
    ("depth_nodes_per_length", {"workpiece": {"depth_correlation_length": 20.0}}, 0.05),
    ("hardness_nodes_per_length", {"workpiece": {"hardness_correlation_length": 50.0}}, 0.02),
    ("depth_ripples_per_turn", {"workpiece": {"depth_ripple_period": 4.0}}, 0.25),
    # 1 / (3 * 200 GPa * pi 40^4 / 64).
    (
        "bar_flexibility",
        {"workpiece": {"diameter": 40.0, "elastic_modulus": 200_000.0}},
        1.0 / (600_000.0 * math.pi * 40_000.0),
    ),
    ("log_reference_min", {"surface": {"reference_min": 1.5}}, math.log(1.5)),
    (
        "log_reference_span",
        {"surface": {"reference_min": 1.5, "reference_max": 6.0}},
        math.log(4.0),
    ),
    ("reference_time", {"surface": {"reference_time": 90.0}}, 1.5),
    # If edges are changed, the time passes, and is no part of the price.
    ("edge_price", {"economics": {"edge_cost": 4.0, "edge_change_time": 2.0}}, 360.0),
    (
        "edge_price",
        {
            "economics": {"edge_cost": 4.0, "edge_change_time": 2.0},
            "control": {"edge_changes": "automatic"},
        },
        240.0,
    ),
    ("breakage_price", {"economics": {"breakage_downtime": 7.0}}, 420.0),
    (
        "breakage_price",
        {
            "economics": {"breakage_downtime": 7.0},
            "control": {"edge_changes": "commanded"},
        },
        0.0,
    ),
    ("clock_limit", {"control": {"time_limit": 50.0}}, math.inf),
    (
        "clock_limit",
        {"control": {"time_limit": 50.0, "edge_changes": "automatic"}},
        50.0,
    ),
    ("thrust_force_limit", {"limits": {"thrust_force": 800.0}}, 800.0),
    ("per_thrust_force_limit", {"limits": {"thrust_force": 800.0}}, 1.0 / 800.0),
    ("power_limit", {"limits": {"power": 4.0}}, 4.0),
    ("per_power_limit", {"limits": {"power": 4.0}}, 0.25),
]


@pytest.mark.parametrize(("name", "sections", "expected"), DERIVED)
def test_derived_parameters_by_hand(
    name: str, sections: dict[str, dict[str, Any]], expected: float
) -> None:
    values = parameters_of(**sections)[name]
    assert float(values[ENV]) == pytest.approx(expected, rel=1e-9, abs=0.0)


SHARED = [
    ("wear_rule", {"tool": {"wear_rule": "clock_time"}}, CLOCK_TIME),
    ("action", {"control": {"action": "override"}}, OVERRIDE),
    ("edge_changes", {"control": {"edge_changes": "end"}}, END),
    ("edge_changes", {"control": {"edge_changes": "automatic"}}, AUTOMATIC),
    ("edge_changes", {"control": {"edge_changes": "commanded"}}, COMMANDED),
    ("heats", {"spindle": {"short_time_load": 1.0}}, False),
    ("heats", {"spindle": {"short_time_load": 1.01}}, True),
    ("reads_torque", {"spindle": {"reading": "torque"}}, True),
    ("reads_torque", {"spindle": {"reading": "power"}}, False),
    ("senses_current", {"sensors": {"force": "servo_current"}}, True),
    ("senses_current", {"sensors": {"force": "dynamometer"}}, False),
    ("holds_roughness", {"control": {"aim": "roughness", "action": "override"}}, True),
    ("holds_roughness", {}, False),
    ("bends", {"workpiece": {"support": "rigid"}}, False),
    ("bends", {"workpiece": {"support": "chuck"}}, True),
    ("depth_sections", {"workpiece": {"depth_profile": (1.0, 2.0)}}, 2),
    ("step_limit", {"control": {"interval": 2.0, "time_limit": 3.0}}, 90),
    (
        "step_limit",
        {"control": {"interval": 2.0, "time_limit": 3.0, "edge_changes": "automatic"}},
        0,
    ),
    ("further_limits", {}, 0),
    (
        "further_limits",
        {
            "limits": {
                "torque": {"coefficient": 3.0, "feed": 1.0},
                "roughness": {"coefficient": 2.0, "feed": 1.0},
            }
        },
        2,
    ),
    ("entries", {}, 11),
    ("entries", {"sensors": {"counts_tangles": True}}, 12),
]


@pytest.mark.parametrize(("name", "sections", "expected"), SHARED)
def test_choices_and_counts(
    name: str, sections: dict[str, dict[str, Any]], expected: float
) -> None:
    assert parameters_of(**sections)[name] == expected


FLAGS = {
    "fresh_edges_load": (),
    "has_phases": (
        "edge_failure.tertiary_rate",
        "edge_failure.running_in",
        "edge_failure.built_up_edge",
    ),
    "collapses": ("edge_failure.collapse_temperature",),
    "edges_chip": ("edge_failure.chipping_rate",),
    "notches": ("edge_failure.notch_growth",),
    "chips_tangle": ("swarf.tangle_rate",),
    "delays_commands": ("machine.command_delay",),
    "chips_lag": ("machine.chip_lag",),
    "chatters": ("machine.chatter",),
    "has_base_speed": ("spindle.base_speed",),
    "has_section_lengths": (),
    "has_section_speeds": (),
    "ripples": ("workpiece.depth_ripple",),
    "has_gradient": ("mismatch.hardness_gradient",),
    "has_skin": ("mismatch.skin_thickness",),
    "warms_up": ("mismatch.power_drift", "mismatch.force_drift", "mismatch.thermal_growth"),
}
SMALL = {"command_delay": 1.0, "collapse_temperature": 900.0, "base_speed": 300.0}


@pytest.mark.parametrize("flag", FLAGS)
def test_an_effect_is_on_where_one_of_its_fields_is(flag: str) -> None:
    assert not parameters_of()[flag]
    for field in FLAGS[flag]:
        section, name = field.split(".")
        assert parameters_of(**{section: {name: SMALL.get(name, 0.01)}})[flag], field


def test_sections_of_a_path_have_starts_and_speeds() -> None:
    sections = {
        "bar_length": 300.0,
        "depth_profile": (1.0, 0.0, 2.0),
        "section_lengths": (50.0, 100.0, 150.0),
        "section_speeds": (100.0, 120.0, 90.0),
    }
    p = parameters_of(workpiece=sections)
    assert p.section_starts[:4].tolist() == [0.0, 50.0, 150.0, 0.0]
    assert p.section_speeds[:4].tolist() == [100.0, 120.0, 90.0, 0.0]
    assert p.depth_profile[:4].tolist() == [1.0, 0.0, 2.0, 0.0]
    assert p.has_section_lengths
    assert p.has_section_speeds


def test_a_further_limit_is_relative_to_its_response() -> None:
    law = {"coefficient": 3.0, "feed": 0.5, "depth_of_cut": 2.0, "hardness": 0.25, "most": 8.0}
    p = parameters_of(limits={"torque": law | {"reference_depth_of_cut": 2.0}})
    (log_share, feed, depth, hardness) = p.further_laws[0]
    # 3 / 2^2 / 8 at f = d = H = 1.
    assert log_share == pytest.approx(math.log(3.0 / 32.0))
    assert (feed, depth, hardness) == (0.5, 2.0, 0.25)


def test_without_a_collapse_temperature_no_edge_is_too_hot() -> None:
    assert parameters_of().log_collapse_temperature[ENV] > 700.0


def test_the_layout_names_the_scenarios_entries_in_order() -> None:
    scenario = changed(Scenario(), sensors={"counts_tangles": True})
    p = parameter_records(scenario)[0]
    places = p.observation_layout[: p.entries].tolist()
    assert places == [getattr(OBS, name) for name in layout(scenario)]
    assert places[-1] == OBS.tangles


@pytest.mark.parametrize(
    "parameter", [line for line in PARAMETERS if line.field], ids=lambda line: line.name
)
def test_every_field_is_read_from_its_section(parameter: Any) -> None:
    scenario = Scenario()
    value = parameter_records(scenario)[parameter.name][0]
    expected = attrgetter(parameter.field)(scenario)
    if np.ndim(expected) == 0:
        assert np.all(value == expected)
    assert parameter.name == parameter.field.split(".")[-1]
